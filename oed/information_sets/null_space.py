"""What information matrices leave open, whatever the units of the parameters."""

from collections.abc import Sequence

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.common.symmetric_matrices import (
    ROUNDING,
    SPREAD,
    scaled_eigh,
    unit_diagonal_scaling,
)

# Of parts that are equal but for rounding the first is taken, on every processor.
_TIE = 1e-6


def weak_directions(matrix: Array, tolerance: float = ROUNDING) -> Array:
    """Return an orthonormal basis, (p, k), of the null space of the scaled information (p, p).

    Eigenvalues up to `tolerance` of the largest one count as zero.
    """
    _, eigenvalues, vectors = scaled_eigh(matrix, SPREAD)
    return np.asarray(vectors[:, eigenvalues <= tolerance * max(eigenvalues[-1], 1.0)])


def unidentifiable(
    matrix: Array, names: Sequence[str], tolerance: float = ROUNDING
) -> tuple[str, ...]:
    """Return the names of the parameters on which `matrix` (p, p) leaves a direction open."""
    part = np.linalg.norm(weak_directions(matrix, tolerance), axis=1)
    return tuple(name for name, share in zip(names, part, strict=True) if share > 0.01)


def open_combinations(matrix: Array, names: Sequence[str]) -> tuple[str, ...]:
    """Return what `matrix` (p, p) leaves open in words, one for each open direction: "a - 0.5 b".

    Each parameter may move by its factor, all of them together, and no experiment would tell.
    """
    from scipy.linalg import qr

    # From scaled coordinates to parameters; one without any information is a unit vector.
    s = unit_diagonal_scaling(matrix, SPREAD)
    basis = weak_directions(matrix) * np.where(s > 0, s, 1.0)[:, None]
    count = basis.shape[1]
    if not count:
        return ()
    # In echelon form each direction has a parameter that no other has, and few others.
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
