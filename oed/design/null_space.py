"""What information matrices leave open, whatever the units of the parameters."""

from collections.abc import Sequence

import numpy as np

from robotmodels.arrays import Array

# Rounding leaves a singular information matrix of unit diagonal with eigenvalues near 1e-15.
_RANK_TOLERANCE = 1e-12


def unit_diagonal_scaling(matrices: Array) -> Array:
    """Return s, (..., p), such that s_i H_ij s_j has a diagonal of ones, or zero where H_ii is.

    A parameter's unit then has no say in ranks, inverses and determinants.
    """
    diagonal = np.abs(np.diagonal(matrices, axis1=-2, axis2=-1))
    # Sensitivities that are zero but for rounding, 1e-16 of the largest, stay zero.
    floor = (16 * np.finfo(float).eps) ** 2 * diagonal.max(axis=-1, keepdims=True)
    usable = (diagonal > floor) & (diagonal > 0)
    return np.where(usable, 1.0 / np.sqrt(np.where(usable, diagonal, 1.0)), 0.0)


def weak_directions(matrix: Array) -> Array:
    """Return an orthonormal basis, (p, k), of the null space of the scaled information (p, p)."""
    s = unit_diagonal_scaling(matrix)
    eigenvalues, vectors = np.linalg.eigh(s[:, None] * matrix * s)
    return np.asarray(vectors[:, eigenvalues <= _RANK_TOLERANCE * max(eigenvalues[-1], 1.0)])


def unidentifiable(matrix: Array, names: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the parameters on which `matrix` (p, p) leaves a direction open."""
    part = np.linalg.norm(weak_directions(matrix), axis=1)
    return tuple(name for name, share in zip(names, part, strict=True) if share > 0.01)
