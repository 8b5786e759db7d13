from concurrent.futures import ThreadPoolExecutor
from statistics import NormalDist

import numpy as np
import pytest
from iminuit import Minuit
from mass_springs import OMEGA, POSITIONS
from scipy.optimize import minimize
from test_frf_estimate import full_covariance
from test_least_squares import MODEL, TRUTH, exact

from estimators import covariance, fit, profile_likelihood, simulate_frf
from estimators.sampling.likelihood import Noise
from estimators.sampling.log_posterior import log_posterior, posterior_density
from estimators.sampling.log_posterior_gradient import slope
from estimators.sampling.profile_likelihood import adjustments
from estimators.sampling.profile_search import Deviance
from estimators.sampling.student_t_proposal import laplace
from robotmodels import InvalidInput, RelativeNoise


def noisy(relative=0.03, floor=0.01, seed=2):
    rng = np.random.default_rng(seed)
    return simulate_frf(MODEL, POSITIONS[:2], OMEGA[2::5], RelativeNoise(relative, floor), rng)


NOISES = Noise(), Noise("unknown")


@pytest.mark.parametrize(
    ("residual", "weights", "noise"),
    [
        (residual, weights, noise)
        for residual in ("nls", "lls", "lls_magnitude")
        for weights in ("optimal", "full")
        for noise in NOISES
    ],
)
def test_gradients_are_those_of_finite_differences(residual, weights, noise):
    given = full_covariance((3, 23, 2, 2)) if weights == "full" else None
    target = log_posterior(fit(MODEL, exact(given), residual, "optimal"), noise)
    x = np.log(MODEL.parameters.values) + 0.02
    found, h = slope(target, x), 1e-5 * np.eye(6)
    expected = -(target(x + h) - target(x - h)) / 2e-5
    assert found.value == pytest.approx(-target(x)[0], rel=1e-9)
    assert found.gradient == pytest.approx(expected, rel=1e-5, abs=1e-5 * np.abs(expected).max())
    assert np.linalg.eigvalsh(found.hessian).min() > 0


@pytest.mark.parametrize(("residual", "weights"), [("nls", "optimal"), ("lls", "user")])
def test_profiles_of_good_data_are_as_wide_as_theorem_1(residual, weights):
    found = fit(MODEL, noisy(0.003, 0.0), residual, weights)
    profiles = profile_likelihood(found)
    assert [p.std for p in profiles] == pytest.approx(covariance(found).std, rel=0.03)
    assert all(p.sides == ("found", "found") for p in profiles)
    assert not any(p.flat for p in profiles)


def test_flat_directions_are_shown():
    found = fit(MODEL, noisy(0.6, 0.6), "nls", "optimal", bounds=(1e-2, 1e2))
    told = []
    (profile,) = profile_likelihood(
        found, ["c12"], points=7, progress=lambda done, total: told.append((done, total))
    )
    assert profile.flat
    assert profile.sides[0] == "flat"
    assert profile.lower == pytest.approx(1e-2 * 1.0)
    assert profile.asymmetry < 0.5
    assert "flat up to the bound" in str(profile)
    assert profile.curve.shape == (2, 7)
    assert profile.curve[1, 0] < 3.84
    assert told == [(1, 1)]


def deviance(found, name):
    """Return -2 log p in standard deviations, as the profile of a parameter takes it."""
    density = posterior_density(found)
    start, i = laplace(found, density), found.parameters.index(name)
    factor = adjustments(found, density.noise.scale)[i]
    unit = np.sqrt(np.sum(start.root**2, axis=1) * factor)
    return Deviance(density, start.center, unit, 2 / factor), i


def scaled_ends(found, profile):
    x, i = deviance(found, profile.name)
    return (np.log([profile.lower, profile.upper]) - x.center[i]) / x.unit[i]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("residual", ["nls", "lls"])
def test_ends_are_those_of_minos(residual, seed):
    found = fit(MODEL, noisy(0.2, 0.05, seed), residual, "optimal", bounds=(1e-2, 1e2))
    judged = 0
    for profile in profile_likelihood(found):
        x, i = deviance(found, profile.name)
        search = Minuit(lambda at: x(at).value, x.center * 0, grad=lambda at: x(at).gradient)  # noqa: B023
        search.limits, search.errordef = x.limits.T, 1.0
        search.migrad()
        if not search.valid or profile.sides != ("found", "found"):
            continue
        search.minos(i, cl=0.95)
        error = search.merrors[f"x{i}"]
        if not error.is_valid:
            continue
        expected = search.values[i] + np.array([error.lower, error.upper])
        assert scaled_ends(found, profile) == pytest.approx(expected, abs=0.02)
        judged += 1
    assert judged


def bounded(seed):
    """Return a fit one of whose dampers is weaker than its bounds allow."""
    bounds = np.outer((1e-2, 1e2), MODEL.parameters.values)
    c12 = MODEL.parameters.index("c12")
    bounds[0, c12] = 2 * TRUTH[c12]
    start = np.maximum(MODEL.parameters.values, 1.1 * bounds[0])
    return fit(MODEL, noisy(0.05, 0.02, seed), "nls", "optimal", start, bounds=bounds)


def rise(found, profile, end):
    """Return the rise of -2 log p from its minimum to the profile at `end`, by scipy."""
    x, i = deviance(found, profile.name)

    def least(bounds):
        inside = np.clip(np.zeros(len(bounds)), *bounds.T)
        result = minimize(
            lambda at: x(at).value, inside, jac=lambda at: x(at).gradient, bounds=bounds,
            method="L-BFGS-B", options={"ftol": 1e-15, "gtol": 1e-9, "maxiter": 2000},
        )  # fmt: skip
        return result.fun

    held = x.limits.T.copy()
    held[i] = end
    return least(held) - least(x.limits.T)


@pytest.mark.parametrize("seed", range(3))
def test_a_parameter_at_a_bound_has_a_one_sided_interval_and_leaves_the_others_theirs(seed):
    found = bounded(seed)
    profiles = profile_likelihood(found)
    chi2 = NormalDist().inv_cdf(0.975) ** 2
    for profile in profiles:
        ends = scaled_ends(found, profile)
        at_bound = profile.name == "c12"
        assert profile.sides == ("bound" if at_bound else "found", "found")
        for end in ends[1:] if at_bound else ends:
            assert rise(found, profile, end) == pytest.approx(chi2, abs=0.01)
            assert abs(rise(found, profile, 0.98 * end) - chi2) > 0.05  # a judge that can tell
    (c12,) = (p for p in profiles if p.name == "c12")
    assert c12.mode == pytest.approx(found.bounds[0, found.parameters.index("c12")])
    assert c12.lower == c12.mode < c12.upper
    assert c12.asymmetry == np.inf
    assert "the mode is at this bound" in str(c12)


def test_parameters_without_any_information_are_flat_on_both_sides():
    from test_covariance import Blind, _exponents

    model = Blind(_exponents("absent"))
    data = simulate_frf(model, POSITIONS, OMEGA, RelativeNoise(), np.random.default_rng(0))
    (c2,) = profile_likelihood(fit(model, data, "nls", "optimal"), ["c2"])
    assert c2.sides == ("flat", "flat")


def test_profiles_do_not_depend_on_the_executor():
    found = fit(MODEL, noisy(), "nls", "optimal")
    with ThreadPoolExecutor(2) as executor:
        parallel = profile_likelihood(found, executor=executor)
    serial = profile_likelihood(found, ["k12"])
    assert parallel[2].upper == serial[0].upper


def test_what_cannot_be_profiled_is_named():
    found = fit(MODEL, noisy(), "nls", "optimal")
    with pytest.raises(InvalidInput, match="'k3' is not among the free parameters"):
        profile_likelihood(found, ["k3"])
    with pytest.raises(InvalidInput, match=r"profile: level 1\.0 does"):
        profile_likelihood(found, level=1.0)
    robust = fit(MODEL, noisy(), "nls", "optimal", loss="huber")
    with pytest.raises(InvalidInput, match="loss 'huber' is no likelihood"):
        profile_likelihood(robust)
