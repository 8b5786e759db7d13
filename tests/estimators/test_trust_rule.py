"""The rule of recommended intervals and verdicts: its parts against laws, draws and refits."""

from dataclasses import replace

import numpy as np
import pytest
from derivatives import circular
from noisy_runs import MODEL, TRUTH, noisy_runs
from scipy.stats import chi2, ks_1samp, norm, t as student
from trust_cells import Cell, linearisation_of, one_step, simulate

import estimators
import robotmodels
from estimators.trust.directed_tests import Directions, directed_tests
from estimators.trust.intervals import VERDICTS
from estimators.trust.line_correlation import white_errors
from estimators.trust.line_scatter import line_scatter
from estimators.trust.linearised_fit import LinearisedFit
from estimators.trust.residual_size import line_probabilities, residual_size
from estimators.trust.rule import gather_evidence, judge, with_columns, with_prior

Q, F, K, P = 2, 20, 2, 3


def fit_of(rng, nu=np.inf, jacobian=None, prior=None):
    """Return a fit after its linear step, and the step."""
    J = circular(np.random.default_rng(99), Q, F, K, P) if jacobian is None else jacobian
    p = J.shape[-1]
    deviations = None
    variance = np.ones((Q, F, K))
    if np.isfinite(nu):
        deviations = circular(rng, Q, int(nu), F, K) / np.sqrt(nu)
        variance = (np.abs(deviations) ** 2).sum(axis=1)
    fit = LinearisedFit(
        names=tuple("abcdef"[:p]),
        residuals=circular(rng, Q, F, K),
        jacobian=J,
        weights=np.ones((Q, F, K)),
        noise_weights=np.ones((Q, F, K)),
        covariance=variance,
        deviations=deviations,
        degrees_of_freedom=np.full(Q, float(nu)),
        line_correlation=np.empty(0),
        prior=np.zeros((p, p)) if prior is None else prior,
    )
    step = fit.estimates(fit.rows, fit.residuals)
    return replace(fit, residuals=fit.residuals - fit.jacobian @ step), step


def test_declared_noise_gives_theorem_1():
    fit, _ = fit_of(np.random.default_rng(0))
    flat = fit.jacobian.reshape(-1, P)
    information = 2 * (flat.conj().T @ flat).real
    scatter = line_scatter(fit, fit.rows, white_errors(F))
    np.testing.assert_allclose(scatter.variance, np.diag(np.linalg.inv(information)))
    assert np.isinf(scatter.degrees_of_freedom).all()


def test_errors_of_parameters_are_no_size_of_residuals():
    """Weights that heed imprecise elements leave errors that precise elements show."""
    sizes = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        fit, _ = fit_of(rng)
        std = np.where(np.arange(F) % 2, 1.0, 1e-3)[:, None]
        noisy = replace(
            fit,
            residuals=circular(rng, Q, F, K) * std,
            covariance=fit.covariance * std**2,
            noise_weights=fit.noise_weights / std**2,
        )
        step = noisy.estimates(noisy.rows, noisy.residuals)
        noisy = replace(noisy, residuals=noisy.residuals - noisy.jacobian @ step)
        sizes.append(residual_size(noisy, white_errors(F)))
        assert noisy.squares > 100 * noisy.noise_fit.squares
    assert np.mean([size.ratio for size in sizes]) == pytest.approx(1.0, abs=0.05)
    assert min(size.probability for size in sizes) > 1e-3


def test_a_single_line_has_its_own_degrees_of_freedom():
    rng = np.random.default_rng(1)
    fit, _ = fit_of(rng, nu=3)
    rows = np.zeros((2, Q, F, K), complex)
    rows[0, 1, 4, 0] = 1.0
    rows[1] = 1.0
    dof = line_scatter(fit, rows, white_errors(F)).degrees_of_freedom
    assert dof[0] == pytest.approx(2 * 3)
    assert 2 * 3 * 20 < dof[1] <= 2 * 3 * Q * F


def test_probabilities_of_magnitudes_with_declared_noise():
    """Once they were no numbers, and every fit of magnitudes had an outlier."""
    fit, _ = fit_of(np.random.default_rng(2))
    real = replace(fit, residuals=fit.residuals.real, jacobian=fit.jacobian.real, real=True)
    expected = 2 * norm.sf(np.sqrt(2) * np.abs(real.residuals))
    np.testing.assert_allclose(line_probabilities(real), expected, rtol=1e-6)


@pytest.mark.parametrize("nu", [1, 2, 5])
def test_errors_over_the_scatter_of_one_line_follow_the_t_law(nu):
    rng = np.random.default_rng(2)
    ratios = []
    for _ in range(400):
        fit, _ = fit_of(rng, nu=nu)
        rows = np.zeros((1, Q, F, K), complex)
        rows[0, 0, 3] = [1.0, 2j]
        scatter = line_scatter(fit, rows, white_errors(F))
        error = fit.estimates(rows, circular(rng, Q, F, K))[0]
        ratios.append(error / np.sqrt(scatter.variance[0]))
    assert ks_1samp(ratios, student(2 * nu).cdf).pvalue > 1e-4
    if nu == 1:
        assert ks_1samp(ratios, student(1e6).cdf).pvalue < 1e-2  # negative control


@pytest.mark.parametrize("nu", [1, 2, 5, np.inf])
def test_single_residuals_have_the_exact_law(nu):
    rng = np.random.default_rng(3)
    fit, _ = fit_of(rng, nu=nu)
    probabilities = []
    for _ in range(20):
        other, _ = fit_of(rng, nu=nu)
        other = replace(other, residuals=circular(rng, Q, F, K))
        probabilities.append(line_probabilities(other).ravel())
    pooled = np.concatenate(probabilities)
    assert ks_1samp(pooled, lambda p: p).pvalue > 1e-4
    assert len(fit.names) == P


@pytest.mark.parametrize("nu", [1, 2, 3, 20, np.inf])
def test_the_size_of_residuals_fires_as_often_as_stated(nu):
    runs, fired, former = 600, 0, 0
    rng = np.random.default_rng(4)
    for _ in range(runs):
        fit, _ = fit_of(rng, nu=nu)
        size = residual_size(fit, white_errors(F))
        fired += size.probability < 0.05
        statistic = 2 * (np.abs(fit.residuals) ** 2 / fit.element_variances).sum()
        former += chi2.sf(statistic, fit.data - P) < 0.05
    assert 0.01 < fired / runs < 0.09
    if nu < 20:
        assert former / runs > 0.3  # negative control: chi-square for an estimated covariance


@pytest.mark.parametrize("nu", [3, np.inf])
def test_the_expectation_of_the_residuals_size_allows_for_the_fit(nu):
    rng = np.random.default_rng(5)
    J = circular(rng, Q, F, K, 6)
    ratios = [residual_size(fit_of(rng, nu, J)[0], white_errors(F)).ratio for _ in range(400)]
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("nu", [4, np.inf])
def test_a_directed_test_is_a_refit_with_one_more_parameter(nu):
    rng = np.random.default_rng(6)
    fit, _ = fit_of(rng, nu=nu)
    column = circular(rng, Q, F, K, 1)
    directions = Directions(("x",), ("-",), column, np.zeros((Q, F, K, P), complex))
    std = np.sqrt(line_scatter(fit, fit.rows, white_errors(F)).variance)
    test = directed_tests(fit, directions, white_errors(F), std)
    wider = with_columns(fit, "x", column)
    estimate = wider.estimates(wider.rows, fit.residuals)
    assert test.estimates[0] == pytest.approx(estimate[-1])
    variance = line_scatter(wider, wider.rows, white_errors(F)).variance
    # With estimated noise the test is not more certain than neighbouring lines allow.
    assert test.std[0] >= np.sqrt(variance[-1]) * (1 - 1e-12)
    if not np.isfinite(nu):
        assert test.std[0] == pytest.approx(np.sqrt(variance[-1]))
    moved = int(test.moved[0])
    shift = np.abs(fit.shifts(column)[moved, 0]) * 5.3 * test.std[0] / std[moved]
    assert test.shift[0] == pytest.approx(shift)


@pytest.mark.parametrize(("gain", "noise"), [(5e-5, 1e-6), (0.02, 1e-3)])
def test_shifts_by_errors_of_the_model_are_those_of_refits(gain, noise):
    """Against the estimates by the same noise without the error; none if no test fires."""
    data = noisy_runs(np.random.default_rng(1), 2, noise, noise)
    factors = np.where(np.arange(data.inputs.shape[3]) == 0, 1 + gain, 1.0)
    right = estimators.fit(MODEL, data, start=TRUTH)
    wrong = estimators.fit(MODEL, replace(data, inputs=data.inputs * factors), start=TRUTH)
    assert wrong.verdict == "model error"
    moved = np.abs(np.log(wrong.parameters.values / right.parameters.values))
    assert (wrong.trust.model_error > 0.85 * moved).all()
    assert wrong.trust.model_error.max() < 2 * moved.max()
    assert not right.trust.model_error.any()


def test_directions_of_the_parameters_are_not_tested():
    rng = np.random.default_rng(7)
    fit, _ = fit_of(rng)
    columns = np.concatenate([fit.jacobian[..., :1], circular(rng, Q, F, K, 1)], axis=-1)
    directions = Directions(("a again", "x"), ("-", "-"), columns, np.zeros_like(fit.jacobian))
    tests = directed_tests(fit, directions, white_errors(F), np.ones(P))
    assert tests.names == ("x",)


def test_a_prior_is_as_certain_as_it_says():
    """Where data say nothing of a parameter, its variance is the prior's."""
    rng = np.random.default_rng(8)
    J = circular(rng, Q, F, K, P)
    J[..., 2] = 0
    prior = np.diag([0.0, 30.0, 4.0])
    fit, _ = fit_of(rng, jacobian=J, prior=prior)
    scatter = with_prior(fit, line_scatter(fit, fit.rows, white_errors(F)))
    flat = J.reshape(-1, P)
    exact = np.diag(np.linalg.inv(2 * (flat.conj().T @ flat).real + prior))
    np.testing.assert_allclose(scatter.variance, exact, rtol=1e-9)
    assert scatter.variance[2] == pytest.approx(0.25)


def evidence_of(**changes):
    """Return evidence with which nothing is wrong, but for changes."""
    rng = np.random.default_rng(0)
    fit, _ = fit_of(rng)
    column = circular(rng, Q, F, K, 1)
    direction = Directions(("x",), ("-",), column, np.zeros((Q, F, K, P), complex))
    evidence = gather_evidence(fit, direction)
    return replace(
        evidence,
        correlation=white_errors(F),
        size=replace(evidence.size, probability=0.5, probability_below=0.5),
        tests=fired_tests(evidence, 0.5),
        explanation=None,
        correlated_excess=False,
        outlier=None,
        **changes,
    )


def fired_tests(evidence, probability):
    names = np.array([0])
    return replace(
        evidence.tests,
        names=("delay",),
        units=("s",),
        index=names,
        estimates=np.array([1.0]),
        std=np.array([0.1]),
        probabilities=np.array([probability]),
        moved=names,
        shift=np.array([1.0]),
        degrees_of_freedom=np.array([np.inf]),
    )


def verdicts_of(evidence):
    return {str(verdict) for verdict in judge(evidence)}


def test_the_gravest_verdict_comes_first():
    evidence = evidence_of()
    assert verdicts_of(evidence) == {"trustworthy"}
    order = [
        {"correlation": replace(evidence.correlation, probability=1e-9)},
        {"size": replace(evidence.size, probability=1e-9)},
        {"scatter": replace(evidence.scatter, variance=np.full(P, 1.1))},
        {"tests": fired_tests(evidence, 1e-9)},
        {"has_degrees_of_freedom": False},
        {"converged": False},
    ]
    for change, verdict in zip(order, reversed(VERDICTS[:-1]), strict=True):
        evidence = replace(evidence, **change)
        assert verdicts_of(evidence) == {verdict}


def test_noise_that_is_understated_may_leave_nothing_identifiable():
    evidence = evidence_of()
    size = replace(evidence.size, probability=1e-9, ratio=100.0)
    scatter = replace(evidence.scatter, variance=np.array([1e-3, 0.011, 0.011]))
    verdicts = judge(replace(evidence, size=size, scatter=scatter))
    assert [str(one) for one in verdicts] == ["noise understated", *2 * ["not identifiable"]]
    assert verdicts[1].reason.endswith("as residuals are 100 times what noise explains")


@pytest.mark.parametrize("number", [np.nan, 0.0])
def test_evidence_that_is_not_a_number_is_never_trusted(number):
    evidence = evidence_of()
    for change in (
        {"correlation": replace(evidence.correlation, probability=number)},
        {"size": replace(evidence.size, probability=number)},
        {"tests": fired_tests(evidence, number)},
        {"outlier": (0, 3, 1)},
        {"scatter": replace(evidence.scatter, variance=np.full(P, number or np.nan))},
    ):
        assert "trustworthy" not in verdicts_of(replace(evidence, **change))


def test_verdicts_are_words_with_a_reason():
    verdict = judge(evidence_of())[0]
    assert verdict == "trustworthy"
    assert verdict.reason.startswith("noise explains")
    slightly = replace(white_errors(F), probability=1e-3)
    verdict = judge(replace(evidence_of(), correlation=slightly))[0]
    assert verdict == "noise correlated"
    assert "are a little correlated (p = 0.001)" in verdict.reason


def test_a_damper_at_its_bound_has_one_end():
    chains = robotmodels.CoupledChains(
        np.array([[1.0, 2.0, 1.5]]), np.array([[900.0, 500.0]]), np.zeros((1, 1)),
        np.array([[2.0, 1.0]]),
    )  # fmt: skip
    omega = np.linspace(5, 70, 40)
    estimate = estimators.simulate_frf(
        chains, np.zeros((1, 1)), omega, robotmodels.RelativeNoise(), np.random.default_rng(1)
    )
    values = chains.parameters.values
    bounds = np.stack([values / 100, values * 100])
    bounds[0, 2] = 1.3 * values[2]
    fit = estimators.fit(chains, estimate, "nls", "optimal", bounds[0] * 1.5, bounds)
    damper = fit.intervals()[2]
    assert damper.name == "c1"
    if fit.verdict != "model error":
        assert damper.low is None
        assert damper.high > damper.value
        assert damper.verdict == "not identifiable"
    else:
        assert damper.low is damper.high is None


def test_one_step_reproduces_a_converged_fit():
    """The engine's linear step against `estimators.fit`, to second order in the errors."""
    cell = Cell("chain", 4)
    at = linearisation_of(cell)
    differences = []
    for seed in range(5):
        estimate = simulate(cell, at, np.random.default_rng(seed))
        _, step = one_step(cell, at, estimate)
        model = robotmodels_of(cell)
        fit = estimators.fit(model, estimate, "nls", "optimal")
        error = np.log(fit.parameters.values / model.parameters.values)
        differences.append(np.abs(step - error).max() / fit.trust.std.max())
    assert max(differences) < 0.4


def robotmodels_of(cell):
    from trust_systems import system

    return system(cell.system).model


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("nu", [4, np.inf])
def test_an_outlier_is_found_where_it_is(nu, seed):
    """Also where the outlier alone makes the residuals many times too large."""
    rng = np.random.default_rng(seed)
    fit, _ = fit_of(rng, nu=nu)
    column = circular(rng, Q, F, K, 1)
    direction = Directions(("x",), ("-",), column, np.zeros((Q, F, K, P), complex))
    residuals = fit.residuals.copy()
    residuals[1, 7, 1] = 30 * np.sqrt(fit.element_variances[1, 7, 1])
    evidence = gather_evidence(replace(fit, residuals=residuals), direction)
    assert evidence.outlier == (1, 7, 1)
    assert verdicts_of(evidence) == {"model error"}
