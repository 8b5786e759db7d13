import numpy as np
import pytest
from mass_springs import OMEGA, POSITIONS
from scipy.stats import kstest
from test_frf_estimate import full_covariance
from test_least_squares import MODEL

from estimators import FrfEstimate, fit, simulate_frf
from estimators.uncertainty.misfit import misfit
from robotmodels import InvalidInput, RelativeNoise, frequency_response

TRUTH = frequency_response(MODEL, POSITIONS[:1], OMEGA)


def known(rng):
    return simulate_frf(MODEL, POSITIONS[:1], OMEGA, RelativeNoise(0.02, 0.01), rng)


def correlated(rng, blocks=None):
    """Errors that are correlated between elements; the covariance known, or estimated."""
    shape = TRUTH.shape
    covariance = 1e-3 * full_covariance(shape)
    root = np.linalg.cholesky(covariance * (blocks or 1) / 2)
    z = rng.standard_normal((2, blocks or 1, *shape[:2], 4, 1))
    samples = (root @ (z[0] + 1j * z[1]))[..., 0]
    mean = samples.mean(axis=0)
    if blocks is not None:
        apart = samples - mean
        covariance = np.einsum("bqfi,bqfj->qfij", apart, apart.conj()) / (blocks * (blocks - 1))
    response = TRUTH + np.swapaxes(mean.reshape(*shape[:2], 2, 2), -1, -2)
    return FrfEstimate(POSITIONS[:1], OMEGA, response, covariance, np.ones(1, dtype=int))


@pytest.mark.parametrize(
    ("experiment", "residual", "weights", "blocks"),
    [
        (known, "nls", "optimal", None),
        (known, "lls", "user", None),
        (known, "lls_magnitude", "optimal", None),
        (correlated, "nls", "optimal", None),
        (correlated, "nls", "optimal_diagonal", None),
        (lambda rng: correlated(rng, 12), "nls", "optimal", 12),
    ],
)
def test_probabilities_of_right_models_are_uniform(experiment, residual, weights, blocks):
    found = [
        misfit(fit(MODEL, experiment(np.random.default_rng(s)), residual, weights), blocks)
        for s in range(30)
    ]
    probabilities = [m.probability for m in found]
    assert kstest(probabilities, "uniform").pvalue > 1e-3
    # Estimated weights let a fit follow the noise a little more, and log residuals are left out
    # where the measured FRF, not the true one, is small.
    beside = 0.0 if blocks is None and residual != "lls" else 0.04
    data = TRUTH.size * (1 if residual == "lls_magnitude" else 2)
    within = beside + 4 * np.sqrt(2 / (data - 6) / 30)
    assert np.mean([m.ratio for m in found]) == pytest.approx(1.0, abs=within)


def test_estimated_covariances_taken_for_known_ones_look_like_a_model_error():
    found = fit(MODEL, correlated(np.random.default_rng(0), 12), "nls", "optimal")
    assert misfit(found).probability < 1e-6
    assert misfit(found, 12).probability > 1e-3
    with pytest.raises(InvalidInput, match="blocks: 6 tell nothing of the scatter of 4 elements"):
        misfit(found, 6)
