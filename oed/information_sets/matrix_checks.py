"""Refuse what is no information matrix, naming the candidate."""

import numpy as np
from numpy.typing import ArrayLike

from robotmodels.common.arrays import Array, real_numbers
from robotmodels.common.errors import InvalidInput
from robotmodels.common.symmetric_matrices import SPREAD, unit_diagonal_scaling

_SYMMETRY_TOLERANCE = 1e-9
_MOST_SCALED = 1e100
_PART = 64
"""Matrices that are checked at once: they stay in the cache."""


def candidate_rows(positions: ArrayLike) -> Array:
    """Return candidate positions, (Q, n), at least one.

    Raises
    ------
    InvalidInput
        If there is none, or one is no real number.
    """
    rows = np.atleast_2d(real_numbers(positions, "positions", copy=False))
    if rows.size == 0:
        raise InvalidInput("positions: none given; at least one candidate position is needed")
    return rows


def check_positions(positions: Array) -> None:
    """Refuse positions (Q, n) that are not finite, naming the candidate."""
    _refuse(~np.isfinite(positions).all(axis=1), "a position that is not finite", 0)


def check_matrices(matrices: Array, first: int = 0, of_sums: bool = False) -> None:
    """Refuse matrices (n, p, p) that are no information; the first one is candidate `first`.

    Sums of squares (`of_sums`) are semidefinite where they are finite.

    Raises
    ------
    InvalidInput
        Naming the candidate, if one is not finite, symmetric or positive semidefinite, all to
        rounding.
    """
    if of_sums and np.isfinite(matrices.sum()):
        return
    # The candidate at fault is searched only if there is one.
    parts = range(0, len(matrices), _PART)
    if all(_is_definite(matrices[start : start + _PART]) for start in parts):
        return
    _refuse(~np.isfinite(matrices).all(axis=(1, 2)), "a matrix that is not finite", first)
    s = unit_diagonal_scaling(matrices, SPREAD)
    # What is zero but for rounding is judged against the largest entry.
    least = np.where(s > 0, s, np.inf).min(axis=1, keepdims=True)
    s = np.where(s > 0, s, np.where(np.isfinite(least), least, 1.0))
    scaled = _scaled(matrices, s)
    skew = np.abs(scaled - np.swapaxes(scaled, 1, 2)).max(axis=(1, 2))
    _refuse(skew > _SYMMETRY_TOLERANCE, "a matrix that is not symmetric", first)
    lowest = np.linalg.eigvalsh(scaled)[:, 0]
    _refuse(
        lowest < -0.5 * _SYMMETRY_TOLERANCE, "a matrix that is not positive semidefinite", first
    )


def _is_definite(matrices: Array) -> bool:
    """Return whether matrices are finite, symmetric and positive definite, all to rounding.

    One factorisation of all is much cheaper than their eigenvalues.
    """
    diagonal = np.einsum("qii->qi", matrices)
    if not (np.isfinite(matrices).all() and np.all(diagonal > 0)):
        return False
    s = 1.0 / np.sqrt(diagonal)
    scaled = _scaled(matrices, s)
    skew = np.abs(scaled - np.swapaxes(scaled, 1, 2)).max(initial=0.0)
    if not skew <= _SYMMETRY_TOLERANCE:
        return False
    diagonal_of_scaled = np.einsum("qii->qi", scaled)
    diagonal_of_scaled += _SYMMETRY_TOLERANCE
    try:
        np.linalg.cholesky(scaled)
    except np.linalg.LinAlgError:
        return False
    return True


def _scaled(matrices: Array, s: Array) -> Array:
    """Return s_i H_ij s_j; entries beyond all information stay finite, so that they are judged."""
    with np.errstate(over="ignore"):
        return np.clip(s[:, :, None] * matrices * s[:, None, :], -_MOST_SCALED, _MOST_SCALED)


def _refuse(wrong: ArrayLike, what: str, first: int) -> None:
    wrong = np.asarray(wrong)
    if wrong.any():
        index, count = first + int(np.argmax(wrong)), int(wrong.sum())
        raise InvalidInput(f"candidate {index} has {what} ({count} of {len(wrong)} do)")
