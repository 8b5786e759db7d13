"""Several rivals of one spring: the probability that none of them fits better."""

import numpy as np
import pytest
from scipy.special import ndtr

from estimators.structure.power import all_above, rivalry


def _rivals(count, spread, rng):
    """Unit vectors of length 40: the right spring's regressor, and rivals close to it."""
    right = np.eye(40)[0]
    rivals = right + spread * rng.standard_normal((count, 40))
    return right, rivals / np.linalg.norm(rivals, axis=1)[:, None]


def test_rivals_win_as_often_as_in_drawn_noise():
    rng = np.random.default_rng(4)
    right, rivals = _rivals(5, 0.05, rng)
    size, limit = 5.0, 3.5
    noise = rng.standard_normal((40_000, 40))
    test, others = size + noise @ right, size * rivals @ right + noise @ rivals.T
    hits = (test > limit) & (test > others.max(axis=1))
    by_rivals = size * (right - (rivals @ right)[:, None] * rivals)
    misfits = np.square(by_rivals).sum(axis=1)
    margins, correlation = rivalry(size * right, list(by_rivals), misfits)
    predicted = all_above(np.append(size - limit, margins), correlation)
    assert predicted == pytest.approx(hits.mean(), abs=0.01)
    # The best rival alone promises too much.
    assert ndtr(size - limit) * ndtr(margins.min()) > predicted + 0.1


@pytest.mark.parametrize(("correlation", "expected"), [(0.0, ndtr(1.0) ** 3), (1.0, ndtr(1.0))])
def test_independent_and_equal_rivals_have_closed_forms(correlation, expected):
    matrix = np.full((3, 3), correlation) + (1 - correlation) * np.eye(3)
    assert all_above(np.full(3, 1.0), matrix) == pytest.approx(expected, abs=1e-4)


def test_margins_that_noise_does_not_reach_are_certain():
    assert all_above(np.array([40.0, np.inf]), np.eye(2)) == 1.0
    assert all_above(np.array([0.5, 40.0]), np.eye(2)) == pytest.approx(ndtr(0.5), abs=1e-12)
