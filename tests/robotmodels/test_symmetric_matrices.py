"""Inverses and eigenvalues do not depend on units; blind parameters stay blind."""

import numpy as np
import pytest

from robotmodels.common.symmetric_matrices import (
    SPREAD,
    scaled_eigh,
    scaled_inverse,
    scaled_pinv,
    unit_diagonal_scaling,
)

UNITS = np.array([1e-7, 1.0, 1e7])


@pytest.fixture
def matrix():
    A = np.random.default_rng(3).standard_normal((6, 3))
    return A.T @ A


def test_inverses_are_as_exact_in_any_units(matrix):
    exact = np.linalg.inv(matrix) / np.outer(UNITS, UNITS)
    scaled = matrix * np.outer(UNITS, UNITS)
    np.testing.assert_allclose(scaled_inverse(scaled), exact, rtol=1e-10)
    np.testing.assert_allclose(scaled_inverse(np.stack([scaled] * 2))[1], exact, rtol=1e-10)
    np.testing.assert_allclose(scaled_pinv(scaled), exact, rtol=1e-10)
    with np.testing.assert_raises(AssertionError):  # without the scaling, small ones vanish
        np.testing.assert_allclose(np.linalg.pinv(scaled, hermitian=True), exact, rtol=1e-10)


def test_eigenvalues_are_those_of_the_correlation(matrix):
    values = scaled_eigh(matrix * np.outer(UNITS, UNITS))[1]
    size = np.sqrt(np.diag(matrix))
    np.testing.assert_allclose(values, np.linalg.eigvalsh(matrix / np.outer(size, size)))


def test_what_is_not_informed_on_is_zero(matrix):
    matrix[1] = matrix[:, 1] = 0.0
    assert unit_diagonal_scaling(matrix)[1] == 0
    inverse = scaled_pinv(matrix)
    assert not inverse[1].any()
    others = np.ix_([0, 2], [0, 2])
    np.testing.assert_allclose(inverse[others], np.linalg.inv(matrix[others]))
    tiny = np.diag([1.0, (0.5 / SPREAD) ** 2])
    assert unit_diagonal_scaling(tiny)[1] > 0
    assert unit_diagonal_scaling(tiny, SPREAD)[1] == 0


def test_hermitian_matrices():
    A = np.random.default_rng(4).standard_normal((2, 5, 3, 2)).view(complex)[..., 0]
    H = np.conj(np.swapaxes(A, -1, -2)) @ A
    np.testing.assert_allclose(
        scaled_inverse(H) @ H, np.broadcast_to(np.eye(3), H.shape), atol=1e-9
    )
