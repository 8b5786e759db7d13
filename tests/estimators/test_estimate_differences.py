"""Differences of estimates that share data, against repeated draws of the data."""

from types import SimpleNamespace

import numpy as np
import pytest

from estimators.trust.linearised_fit import LinearisedFit
from estimators.uncertainty.estimate_differences import shared_correlation

Q, F, K, P = 4, 5, 2, 2
COLUMNS = [[0, 1], [0, 1]]


def linear_fit(jacobian, variance, weights):
    return LinearisedFit(
        names=("g1.stiffness", "g1.damping"),
        residuals=np.zeros(variance.shape, dtype=complex),
        jacobian=jacobian,
        weights=weights,
        noise_weights=1 / variance,
        covariance=variance,
        deviations=None,
        degrees_of_freedom=np.full(len(variance), np.inf),
        line_correlation=np.zeros(0),
        prior=np.zeros((P, P)),
    )


@pytest.fixture(scope="module")
def fits():
    """Two fits: the second has two of the first's positions, in another order, and one more."""
    rng = np.random.default_rng(4)
    shape = (Q + 1, F, K)
    jacobian = rng.normal(size=(*shape, P)) + 1j * rng.normal(size=(*shape, P))
    variance = rng.uniform(0.5, 2.0, shape)
    first, second = [0, 1, 2, 3], [3, 4, 1]
    one = linear_fit(jacobian[first], variance[first], 1 / variance[first])
    other = linear_fit(jacobian[second], variance[second], np.ones((3, F, K)))
    return SimpleNamespace(one=one, other=other, first=first, second=second, variance=variance)


def test_correlation_is_that_of_repeated_draws(fits):
    rng = np.random.default_rng(5)
    size = (4000, *fits.variance.shape)
    errors = np.sqrt(fits.variance / 2) * (rng.normal(size=size) + 1j * rng.normal(size=size))
    drawn = [
        fit.estimates(fit.rows, errors[:, positions])
        for fit, positions in ((fits.one, fits.first), (fits.other, fits.second))
    ]
    pairs = np.array([[3, 0], [1, 2]])
    said = shared_correlation(fits.one, fits.other, pairs, COLUMNS)
    for i in range(P):
        scatter = np.corrcoef(drawn[0][:, i], drawn[1][:, i])[0, 1]
        assert said[i] == pytest.approx(scatter, abs=4 / np.sqrt(4000))
        assert abs(said[i]) > 0.2  # so that none at all would be seen


def test_the_same_estimate_of_the_same_data_is_wholly_correlated(fits):
    pairs = np.stack([np.arange(Q)] * 2, axis=1)
    assert shared_correlation(fits.one, fits.one, pairs, COLUMNS) == pytest.approx([1.0, 1.0])


def test_no_data_in_common_no_correlation(fits):
    pairs = np.zeros((0, 2), dtype=int)
    assert shared_correlation(fits.one, fits.other, pairs, COLUMNS) == pytest.approx([0.0, 0.0])
