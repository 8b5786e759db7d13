"""What information matrices leave open, whatever the units of the parameters."""

from collections.abc import Sequence

import numpy as np

from robotmodels.common.arrays import Array

# Rounding leaves a singular information matrix of unit diagonal with eigenvalues near 1e-15.
_RANK_TOLERANCE = 1e-12
SPREAD = 1.0 / (16 * np.finfo(float).eps)
"""Beyond this ratio of sensitivities, 2.8e14, the smaller one cannot be told from rounding."""
# Of parts that are equal but for rounding the first is taken, on every processor.
_TIE = 1e-6


def unit_diagonal_scaling(matrices: Array, spread: float = np.inf) -> Array:
    """Return s, (..., p), such that s_i H_ij s_j has a diagonal of ones, or zero where H_ii is.

    A parameter's unit then has no say in ranks, inverses and determinants. Sensitivities that are
    smaller than the largest by more than `spread` count as zero.
    """
    diagonal = np.abs(np.diagonal(matrices, axis1=-2, axis2=-1))
    usable = diagonal > diagonal.max(axis=-1, keepdims=True) / spread / spread
    return np.where(usable, 1.0 / np.sqrt(np.where(usable, diagonal, 1.0)), 0.0)


def weak_directions(matrix: Array, tolerance: float = _RANK_TOLERANCE) -> Array:
    """Return an orthonormal basis, (p, k), of the null space of the scaled information (p, p).

    Eigenvalues up to `tolerance` of the largest one count as zero.
    """
    s = unit_diagonal_scaling(matrix, SPREAD)
    eigenvalues, vectors = np.linalg.eigh(s[:, None] * matrix * s)
    return np.asarray(vectors[:, eigenvalues <= tolerance * max(eigenvalues[-1], 1.0)])


def unidentifiable(
    matrix: Array, names: Sequence[str], tolerance: float = _RANK_TOLERANCE
) -> tuple[str, ...]:
    """Return the names of the parameters on which `matrix` (p, p) leaves a direction open."""
    part = np.linalg.norm(weak_directions(matrix, tolerance), axis=1)
    return tuple(name for name, share in zip(names, part, strict=True) if share > 0.01)


def open_combinations(matrix: Array, names: Sequence[str]) -> tuple[str, ...]:
    """Return what `matrix` (p, p) leaves open in words, one for each open direction: "a - 0.5 b".

    Each parameter may move by its factor, all of them together, and no experiment would tell.
    """
    from scipy.linalg import qr

    # From scaled coordinates to the parameters' own; one not informed on at all is a unit there.
    s = unit_diagonal_scaling(matrix, SPREAD)
    basis = weak_directions(matrix) * np.where(s > 0, s, 1.0)[:, None]
    count = basis.shape[1]
    if not count:
        return ()
    # In echelon form each direction has a parameter of its own, and as few others as can be.
    pivots = qr(basis.T * np.linspace(1, 1 - _TIE, len(basis)), mode="r", pivoting=True)[1][:count]
    basis = basis @ np.linalg.inv(basis[pivots])
    return tuple(_in_words(direction, names) for direction in basis.T[np.argsort(pivots)])


def _in_words(direction: Array, names: Sequence[str]) -> str:
    sizes = np.abs(direction)
    factors = direction / direction[np.argmax(sizes > (1 - _TIE) * sizes.max())]
    words = ""
    for name, factor in zip(names, factors, strict=True):
        if abs(factor) > 0.01:
            size = "" if abs(abs(factor) - 1) < 5e-3 else f"{abs(factor):.2g} "
            sign = (" - " if factor < 0 else " + ") if words else ("-" if factor < 0 else "")
            words += f"{sign}{size}{name}"
    return words
