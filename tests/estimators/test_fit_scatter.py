"""Fits of simulated data scatter about the truth as Theorem 1 claims, for every residual x weight.

Small versions always run; `make slow` runs enough fits to tell every variance to within 10 %.
"""

import numpy as np
import pytest
from scipy.special import exp1
from scipy.stats import chi2
from two_chains import OMEGA, POSITIONS, drawn, one_chain, truth, two_chains, with_errors

from estimators import covariance, fit, information, optimal_weights, simulate_frf
from robotmodels import RelativeNoise, sensitivity

MODEL = two_chains()
TRUTH = MODEL.parameters.values
FRF = truth(MODEL)
NOISE = RelativeNoise(0.02, 0.005)
RESIDUALS = ("nls", "lls", "lls_magnitude")
WEIGHTS = ("user", "optimal", "combined")
FULL = 0.6  # correlation of neighbouring elements of vec(G)


def scatter(residual, weights, n, seed, full=False):
    """Return ln errors (n, p) of fits, and Theorem 1's mean covariance."""
    rng = np.random.default_rng(seed)
    errors, claimed = [], 0.0
    for _ in range(n):
        estimate = correlated(rng) if full else drawn(FRF, rng, NOISE)
        found = fit(MODEL, estimate, residual, weights, tolerance=1e-7)
        assert found.converged
        errors.append(np.log(found.parameters.values / TRUTH))
        claimed = claimed + covariance(found).covariance / n
    return np.array(errors), claimed


def correlated(rng):
    """FRFs whose elements' errors are correlated within a line."""
    std = np.sqrt(NOISE.variance(FRF))
    vector = np.swapaxes(std, -1, -2).reshape(*std.shape[:2], -1)
    lag = np.abs(np.subtract.outer(np.arange(4), np.arange(4)))
    law = FULL**lag * np.exp(0.3j * np.subtract.outer(np.arange(4), np.arange(4)))
    full = vector[..., :, None] * law * vector[..., None, :]
    root = np.linalg.cholesky(full)
    z = rng.standard_normal((2, *vector.shape, 1))
    errors = (root @ (z[0] + 1j * z[1]))[..., 0] / np.sqrt(2)
    return with_errors(FRF, np.swapaxes(errors.reshape(*std.shape[:2], 2, 2), -1, -2), full)


@pytest.mark.parametrize("weights", WEIGHTS)
@pytest.mark.parametrize("residual", RESIDUALS)
def test_fits_scatter_as_claimed(residual, weights):
    n = 25
    errors, claimed = scatter(residual, weights, n, seed=1)
    squares = np.sum(errors * np.linalg.solve(claimed, errors.T).T)
    low, high = chi2.ppf([0.001, 0.999], 4 * n)
    assert low < squares < high
    assert not low < squares / 0.4 < high  # negative control: two fifths of the covariance


def test_full_covariance_scatters_as_claimed():
    n = 25
    for weights in ("optimal", "user"):
        errors, claimed = scatter("nls", weights, n, seed=2, full=True)
        squares = np.sum(errors * np.linalg.solve(claimed, errors.T).T)
        low, high = chi2.ppf([0.001, 0.999], 4 * n)
        assert low < squares < high


@pytest.mark.slow
@pytest.mark.parametrize("weights", WEIGHTS)
@pytest.mark.parametrize("residual", RESIDUALS)
def test_every_variance_is_claimed_within_a_tenth(residual, weights):
    errors, claimed = scatter(residual, weights, 3000, seed=3)
    ratio = errors.var(axis=0) / np.diag(claimed)
    assert (np.abs(ratio - 1) < 0.1).all()
    assert not (np.abs(ratio / 1.25 - 1) < 0.1).all()  # negative control
    # The Cramer-Rao bound: attained with optimal weights and phases, exceeded otherwise.
    _, J = sensitivity(MODEL, POSITIONS, OMEGA)
    bound = np.linalg.inv(information(J, 1 / NOISE.variance(FRF)).sum(axis=0))
    over_bound = errors.var(axis=0) / np.diag(bound)
    if weights == "optimal" and residual != "lls_magnitude":
        assert (np.abs(over_bound - 1) < 0.1).all()
    else:
        assert (over_bound > 0.93).all()
        assert over_bound.max() > 1.15


@pytest.mark.slow
def test_every_variance_of_correlated_noise_is_claimed_within_a_tenth():
    for weights in ("optimal", "optimal_diagonal"):
        errors, claimed = scatter("lls", weights, 3000, seed=4, full=True)
        assert (np.abs(errors.var(axis=0) / np.diag(claimed) - 1) < 0.1).all()


def test_wrong_weights_exceed_the_bound_as_theorem_1_says():
    rng = np.random.default_rng(5)
    estimate = drawn(FRF, rng, NOISE)
    _, J = sensitivity(MODEL, POSITIONS, OMEGA)
    bound = np.linalg.inv(information(J, 1 / NOISE.variance(FRF)).sum(axis=0))
    best = covariance(fit(MODEL, estimate, "nls", optimal_weights(estimate, "nls"))).covariance
    assert np.allclose(best, bound, rtol=0.1)
    # The worst weights there are: the inverse of the best.
    worst = covariance(fit(MODEL, estimate, "nls", NOISE.variance(FRF))).covariance
    assert np.linalg.eigvalsh(worst - bound)[0] > -0.1 * np.diag(bound).max()
    assert (np.diag(worst) > 2 * np.diag(bound)).all()


def log_bias(variance):
    """Return E ln|1 + e| of circular complex normal e of that variance: E1(1/variance)/2."""
    return exp1(1 / variance) / 2


@pytest.mark.parametrize(("decibel", "biased"), [(0.0, True), (13.0, False)])
def test_log_fits_are_biased_below_10_db_only(decibel, biased):
    """With all masses free, errors of ln|G| by b in all elements shift every parameter by -b."""
    model, omega, n = one_chain(), np.linspace(2.0, 30.0, 40), 40
    variance = 10 ** (-decibel / 10)
    noise, rng = RelativeNoise(np.sqrt(variance), 0.0), np.random.default_rng(6)
    errors = {"lls": []} if biased else {"lls": [], "nls": []}
    for _ in range(n):
        estimate = simulate_frf(model, POSITIONS, omega, noise, rng)
        weights = {"lls": np.ones((1, 40, 1, 1)), "nls": 1 / estimate.variance}
        for residual in errors:
            found = fit(model, estimate, residual, weights[residual], tolerance=1e-6)
            errors[residual].append(np.log(found.parameters.values / model.parameters.values))
    # The common factor of all parameters: least disturbed by what else the noise does.
    mean = {key: np.median(np.array(e), axis=0) for key, e in errors.items()}
    std = {key: 1.25 * np.array(e).std(axis=0) / np.sqrt(n) for key, e in errors.items()}
    expected = -log_bias(variance)
    assert (np.abs(mean["lls"] - expected) < 4 * std["lls"]).all()
    assert (np.abs(mean["lls"]) > 4 * std["lls"]).any() == biased
    assert (np.abs(expected) > 1e-3) == biased
    if not biased:
        assert (np.abs(mean["nls"]) < 4 * std["nls"]).all()
