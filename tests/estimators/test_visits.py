"""Visits of one position averaged, judged by scatter and by hand."""

import numpy as np
import pytest

from estimators.frf.distortion import Distortion
from estimators.frf.frf_estimate import FrfEstimate
from estimators.frf.repeated_visits import merge_distortion, merge_visits, visits_of

POSITIONS = np.array([[0.1, 0.2], [0.3, 0.0], [0.1, 0.2 + 1e-12], [0.1, 0.2]])
COUNTS = np.array([2, 5, 2, 4])


def covariances(rng, full):
    L = rng.standard_normal((4, 3, 4, 4)) + 1j * rng.standard_normal((4, 3, 4, 4))
    C = L @ np.conj(np.swapaxes(L, -1, -2)) / COUNTS[:, None, None, None]
    diagonal = np.diagonal(C, axis1=-2, axis2=-1).real.reshape(4, 3, 2, 2)
    return C if full else diagonal


def estimate(rng, full):
    response = rng.standard_normal((4, 3, 2, 2)) + 1j * rng.standard_normal((4, 3, 2, 2))
    return FrfEstimate(POSITIONS, np.arange(1.0, 4), response, covariances(rng, full), COUNTS)


def test_visits_are_found_in_order():
    assert [v.tolist() for v in visits_of(POSITIONS)] == [[0, 2, 3], [1]]


@pytest.mark.parametrize("full", [True, False])
def test_mean_and_its_covariance(full):
    given = estimate(np.random.default_rng(2), full)
    merged = merge_visits(given)
    assert merged.repetitions.tolist() == [8, 5]
    G, C = given.response, given.covariance
    assert merged.response[0] == pytest.approx((2 * G[0] + 2 * G[2] + 4 * G[3]) / 8)
    assert merged.covariance[0] == pytest.approx((4 * C[0] + 4 * C[2] + 16 * C[3]) / 64)
    assert np.array_equal(merged.response[1], G[1])
    assert np.array_equal(merged.covariance[1], C[1])


def test_covariance_is_that_of_the_scatter():
    rng = np.random.default_rng(5)
    stated = covariances(rng, full=False)[:, :1, :1, :1]
    runs = 4000  # one at each frequency
    real, imaginary = rng.standard_normal((2, 4, runs)) * np.sqrt(stated[:, :, 0, 0] / 2)
    response = (real + 1j * imaginary)[:, :, None, None]
    many = np.repeat(stated, runs, axis=1)
    merged = merge_visits(FrfEstimate(POSITIONS, np.arange(1.0, 1 + runs), response, many, COUNTS))
    scatter = np.mean(np.abs(merged.response[0]) ** 2)
    assert scatter == pytest.approx(merged.covariance[0, 0, 0, 0], rel=0.1)
    assert scatter < 0.7 * stated[[0, 2, 3]].mean()  # one visit's would be wrong


def test_nothing_to_merge_is_left_alone():
    given = estimate(np.random.default_rng(2), True).subset([0, 1])
    assert merge_visits(given) is given


def test_levels_of_distortion():
    rng = np.random.default_rng(3)

    def level(*shape):
        return rng.uniform(1, 2, (4, *shape))

    found = Distortion(
        POSITIONS,
        np.arange(1.0, 4),
        level(3, 2, 2),
        level(3, 2, 2),
        COUNTS,
        level(3, 2),
        np.ones(2),
        np.ones(1),
        *(level(n, 2) for n in (2, 1, 2, 1, 2, 1)),
    )
    merged = merge_distortion(found)
    share = np.array([2, 2, 4]) / 8
    for name in ("noise", "total"):
        expected = np.einsum("v,v...->...", share**2, getattr(found, name)[[0, 2, 3]])
        assert getattr(merged, name)[0] == pytest.approx(expected)
    odd = np.sqrt(np.einsum("v,v...->...", share, found.odd[[0, 2, 3]] ** 2))
    assert merged.odd[0] == pytest.approx(odd)
    assert merged.blocks.tolist() == [8, 5]
    assert len(merged.even_raw) == 2
    same = merge_distortion(merged)
    assert same is merged
