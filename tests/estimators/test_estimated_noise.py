"""Theorem 1 with a covariance that is a sample's own, against repeated fits."""

import numpy as np
import pytest
from scipy.stats import chi2
from test_least_squares import MODEL, TRUTH, noisy
from test_misfit import correlated

from estimators import covariance, fit, reweighted, user_weights
from estimators.uncertainty.misfit import misfit
from robotmodels import InvalidInput


def few_blocks(seed, blocks):
    return correlated(np.random.default_rng(seed), blocks)


@pytest.mark.parametrize(
    ("blocks", "weights", "n"),
    [
        (9, "optimal", 25),
        pytest.param(12, "optimal", 50, marks=pytest.mark.slow),
        (5, "optimal_diagonal", 50),
        (5, "user", 25),
    ],
)
def test_standard_deviations_are_those_of_repeated_fits(blocks, weights, n):
    """The negative control takes the sample covariance for the true one."""
    squares, taken = [], []
    for seed in range(n):
        estimate = few_blocks(seed, blocks)
        found = fit(MODEL, estimate, "nls", weights, tolerance=1e-7)
        error = np.log(found.parameters.values / TRUTH)
        for said, given in ((squares, blocks), (taken, None)):
            said.append(np.mean((error / covariance(found, blocks=given).std) ** 2))
    # Six parameters that correlate: as sure as three independent ones.
    low, high = chi2.ppf([0.001, 0.999], 3 * n) / (3 * n)
    assert low < np.mean(squares) < high
    assert (low < np.mean(taken) < high) == (weights == "user")


def test_single_elements_by_the_inverse_gamma_distribution():
    """E[1/s^2]/E[1/s] of s Gamma distributed of shape nu and mean one: nu/(nu - 2)."""
    found = fit(MODEL, noisy(), "lls", "optimal_diagonal")
    ratio = covariance(found, blocks=8).covariance / covariance(found).covariance
    assert np.allclose(ratio, 7 / 5)
    again = reweighted(found)  # by the model's FRF, not the measured one
    assert np.allclose(covariance(again, blocks=8).std / covariance(again).std, np.sqrt(7 / 5))


def test_weights_that_are_no_inverse_are_left_alone():
    estimate = noisy()
    for weights in ("user", user_weights(estimate, off_diagonal=0.5), "combined"):
        found = fit(MODEL, estimate, "lls", weights)
        assert np.array_equal(covariance(found, blocks=8).std, covariance(found).std)
        assert misfit(found, 8).ratio == misfit(found).ratio


def test_the_scale_of_the_noise_is_judged_by_blocks_too():
    found = fit(MODEL, few_blocks(1, 12), "nls", "optimal")
    ratio = covariance(found, "scaled", blocks=12).std / covariance(found, blocks=12).std
    assert np.allclose(ratio, np.sqrt(misfit(found, 12).ratio))


def test_what_is_refused():
    estimate = few_blocks(0, 12)
    found = fit(MODEL, estimate, "nls", "optimal")
    with pytest.raises(InvalidInput, match=r"blocks: 6 leave the scatter .* at least 7 are needed"):
        covariance(found, blocks=6)
    with pytest.raises(InvalidInput, match="'empirical' asks nothing of the estimate's covariance"):
        covariance(found, "empirical", blocks=12)
    with pytest.raises(InvalidInput, match="lags = 3 are used by 'empirical', not 'theorem1'"):
        covariance(found, lags=3)
    robust = fit(MODEL, estimate, "nls", "optimal", loss="huber")
    with pytest.raises(InvalidInput, match="blocks: the loss is 'huber'"):
        covariance(robust, blocks=12)
    magnitudes = fit(MODEL, estimate, "lls_magnitude", "optimal")
    with pytest.raises(InvalidInput, match="magnitudes with full weights"):
        covariance(magnitudes, blocks=12)
