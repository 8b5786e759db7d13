"""Symmetric matrices scaled to a unit diagonal: the units of the parameters have no say then."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robotmodels.common.arrays import Array

ROUNDING = 1e-12
"""Relative eigenvalues up to this are zero: rounding leaves those of unit diagonals near 1e-15."""
SPREAD = 1.0 / (16 * np.finfo(float).eps)
"""Beyond this ratio of sensitivities, 2.8e14, the smaller one is lost in rounding."""


def symmetric_matrix(entries: Iterable[float]) -> Array:
    """Return the matrix (3, 3) of xx, xy, xz, yy, yz, zz."""
    xx, xy, xz, yy, yz, zz = entries
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def unit_diagonal_scaling(matrices: NDArray[Any], spread: float = np.inf) -> Array:
    """Return s, (..., p), such that s_i H_ij s_j has a diagonal of ones, or zero where H_ii is.

    Ranks, inverses and determinants of the scaled matrices do not depend on a parameter's unit.
    Sensitivities that are smaller than the largest by more than `spread` count as zero.
    """
    diagonal = np.abs(np.diagonal(matrices, axis1=-2, axis2=-1))
    usable = diagonal > diagonal.max(axis=-1, keepdims=True) / spread / spread
    return np.where(usable, 1.0 / np.sqrt(np.where(usable, diagonal, 1.0)), 0.0)


def scaled_eigh(matrix: Array, spread: float = np.inf) -> tuple[Array, Array, Array]:
    """Return the scaling s (p,), then eigenvalues (p,) and vectors (p, p) of the scaled matrix."""
    s = unit_diagonal_scaling(matrix, spread)
    eigenvalues, vectors = np.linalg.eigh(s[:, None] * matrix * s)
    return s, eigenvalues, vectors


def scaled_inverse(matrices: NDArray[Any]) -> NDArray[Any]:
    """Return inverses (..., p, p) of regular matrices, computed at a unit diagonal."""
    s = unit_diagonal_scaling(matrices)
    outer = s[..., :, None] * s[..., None, :]
    return np.asarray(np.linalg.inv(matrices * outer) * outer)


def scaled_pinv(matrix: Array, rcond: float = 1e-15) -> Array:
    """Return the pseudoinverse (p, p) of the scaled matrix, scaled back: zero where it is blind."""
    s = unit_diagonal_scaling(matrix)
    outer = np.outer(s, s)
    return np.asarray(np.linalg.pinv(matrix * outer, hermitian=True, rcond=rcond) * outer)
