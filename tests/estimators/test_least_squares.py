import numpy as np
import pytest
from mass_springs import OMEGA, POSITIONS, MassSprings
from test_frf_estimate import full_covariance

from estimators import (
    FrfEstimate,
    covariance,
    fit,
    optimal_weights,
    reweighted,
    simulate_frf,
    user_weights,
)
from robotmodels import InvalidInput, NoEquilibrium, RelativeNoise, frequency_response

MODEL = MassSprings()
TRUTH = MODEL.parameters.values


def exact(covariance=None):
    response = frequency_response(MODEL, POSITIONS, OMEGA)
    if covariance is None:
        covariance = RelativeNoise().variance(response)
    return FrfEstimate(POSITIONS, OMEGA, response, covariance, np.ones(3, dtype=int))


def noisy(seed=0, noise=RelativeNoise(0.03, 0.01)):  # noqa: B008
    return simulate_frf(MODEL, POSITIONS, OMEGA, noise, np.random.default_rng(seed))


@pytest.mark.parametrize("weights", ["user", "optimal"])
@pytest.mark.parametrize("residual", ["nls", "lls", "lls_magnitude"])
def test_exact_data_give_exact_parameters(residual, weights):
    start = TRUTH * [1.2, 0.8, 1.2, 0.7, 1.4, 1.3]
    found = fit(MODEL, exact(), residual, weights, start=start)
    assert found.converged
    assert np.abs(np.log(found.parameters.values / TRUTH)).max() < 1e-6
    assert found.cost < 1e-8
    assert (found.start == start).all()


@pytest.mark.parametrize("residual", ["nls", "lls", "lls_magnitude"])
def test_exact_data_with_a_full_covariance(residual):
    estimate = exact(full_covariance((3, 23, 2, 2)))
    found = fit(MODEL, estimate, residual, "optimal", start=TRUTH * 1.2)
    assert found.converged
    assert np.abs(np.log(found.parameters.values / TRUTH)).max() < 1e-6


def response_of(fitted):
    return frequency_response(MODEL, POSITIONS, OMEGA, fitted.parameters.values)


@pytest.mark.parametrize("residual", ["nls", "lls"])
def test_the_cost_is_wm_4b_and_stationary(residual):
    estimate = noisy()
    found = fit(MODEL, estimate, residual, "optimal")
    # Weights of log residuals are evaluated at the fit's own FRF, a search before its end.
    weights = found.weights
    assert np.allclose(weights, optimal_weights(estimate, residual, response_of(found)), rtol=0.02)

    def cost(ln_theta):
        G = frequency_response(MODEL, POSITIONS, OMEGA, np.exp(ln_theta))
        error = estimate.response - G if residual == "nls" else np.log(estimate.response / G)
        return np.sum(weights * np.abs(error) ** 2)

    x = np.log(found.parameters.values)
    assert np.isclose(cost(x), found.cost)
    for i in range(6):
        step = np.eye(6)[i] * 1e-4
        assert cost(x + step) > found.cost
        assert cost(x - step) > found.cost


def test_elements_without_weight_may_be_zero():
    estimate = exact()
    response = estimate.response.copy()
    response[1, 4, 0, 1] = 0
    broken = FrfEstimate(POSITIONS, OMEGA, response, estimate.covariance, estimate.repetitions)
    with pytest.raises(InvalidInput, match=r"measured FRF.*position 1, frequency 4"):
        fit(MODEL, broken, "lls", np.ones(response.shape))
    weights = user_weights(broken)
    assert weights[1, 4, 0, 1] == 0
    found = fit(MODEL, broken, "lls", weights, start=TRUTH * 1.1)
    assert np.allclose(found.parameters.values, TRUTH)


def test_magnitudes_are_no_data_for_residuals_with_phases():
    estimate = exact()
    magnitudes = FrfEstimate(
        POSITIONS, OMEGA, abs(estimate.response), estimate.covariance, estimate.repetitions
    )
    for residual in ("nls", "lls"):
        with pytest.raises(InvalidInput, match=f"magnitudes without phases, and {residual} comp"):
            fit(MODEL, magnitudes, residual)
    estimate_of_magnitudes = fit(MODEL, magnitudes, "lls_magnitude", start=TRUTH * 1.1)
    assert np.allclose(estimate_of_magnitudes.parameters.values, TRUTH)


def test_a_bound_that_stops_the_search_is_told():
    found = fit(MODEL, exact(), start=TRUTH * 1.5, bounds=(1.2, 2.0))
    assert "at a bound: k1" in found.message
    assert (found.parameters.values >= 1.2 * TRUTH).all()


def test_running_out_of_evaluations_is_not_convergence():
    found = fit(MODEL, exact(), start=TRUTH * 1.5, max_evaluations=2)
    assert not found.converged
    assert found.status == 0
    assert "NOT converged" in str(found)


def test_the_report_names_parameters_and_units():
    text = str(fit(MODEL, noisy()))
    assert "lls fit: converged" in text
    assert "c12" in text
    assert "N m s/rad" in text


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"residual": "log"}, "residual 'log' is unknown"),
        ({"weights": "use"}, "did you mean 'user'"),
        ({"bounds": (2.0, 1.0)}, "bounds: .* are not factors"),
        ({"bounds": np.ones((3, 6))}, r"bounds: shape \(3, 6\); two factors or \(2, 6\) values"),
        ({"bounds": np.outer([2, 1], TRUTH)}, "bounds: k1 between 1800 and 900; 0 < low < high"),
        ({"start": TRUTH * 1e4}, r"start: k1 = 9e\+06 lies outside its bounds"),
        ({"start": TRUTH[:3]}, r"\(6,\) is needed"),
        ({"weights": np.zeros((3, 23, 2, 2))}, "6 parameters but only 0 real data"),
        ({"positions": [0, 2, 0]}, "positions: 0 is given twice"),
        ({"positions": [0.5]}, "positions: .* numbers of positions, from 0"),
        ({"positions": [True, False, True]}, "positions: .* numbers of positions, from 0"),
        ({"max_evaluations": 0}, "max_evaluations: 0; a whole number"),
        ({"max_evaluations": 2.5}, r"max_evaluations: 2\.5; a whole number"),
        ({"tolerance": 0.0}, r"tolerance: 0\.0; 2\.2e-16 to less than 1"),
        ({"tolerance": np.nan}, "tolerance: nan"),
    ],
)
def test_faults_are_named(arguments, message):
    with pytest.raises(InvalidInput, match=message):
        fit(MODEL, exact(), **arguments)


def test_magnitudes_count_once_as_data():
    weights = np.zeros((3, 23, 2, 2))
    weights[0, :3, 0, 0] = 1
    with pytest.raises(InvalidInput, match="only 3 real data"):
        fit(MODEL, exact(), "lls_magnitude", weights)
    weights[0, 3:6, 0, 0] = 1
    fit(MODEL, exact(), "lls_magnitude", weights)


def test_reweighting_at_the_model_removes_the_bias_of_noisy_log_residuals():
    """At 1/4 relative noise, log fits weighted at the measured FRF drift from the truth."""
    rng, before, after = np.random.default_rng(0), [], []
    for _ in range(20):
        estimate = simulate_frf(MODEL, POSITIONS, OMEGA, RelativeNoise(0.25, 0.0), rng)
        first = fit(MODEL, estimate, "lls", optimal_weights(estimate, "lls"))
        second = reweighted(first, rounds=1)
        G = frequency_response(MODEL, POSITIONS, OMEGA, first.parameters.values)
        assert np.allclose(second.weights, np.abs(G) ** 2 / estimate.variance)
        for fits, found in ((before, first), (after, second)):
            std = np.sqrt(np.diag(covariance(found).covariance))
            fits.append(np.log(found.parameters.values / TRUTH) / std)
    bias = [np.sum(np.mean(z, axis=0) ** 2) * len(z) for z in (before, after)]
    assert bias[0] > 2 * bias[1]


def test_a_trial_step_without_equilibrium_shortens_the_step():
    refused = []

    class Weak(MassSprings):
        def network(self, positions, parameters=None):
            try:
                return super().network(positions, parameters)
            except NoEquilibrium:
                refused.append(parameters)
                raise

    found = fit(Weak(weakest=899.9), exact(), "nls", "user", start=TRUTH * 1.3)
    assert refused
    assert found.converged
    assert np.allclose(found.parameters.values, TRUTH, rtol=1e-3)


def test_bounds_of_each_parameter():
    bounds = np.outer([0.5, 2.0], TRUTH)
    bounds[:, 0] = 950.0, 1200.0
    found = fit(MODEL, exact(), start=TRUTH * 1.1, bounds=bounds)
    assert np.isclose(found.parameters.values[0], 950.0)
    assert "at a bound: k1" in found.message
