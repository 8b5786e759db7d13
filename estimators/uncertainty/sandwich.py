"""The sandwich of [WM] (5) from its bread and meat, refused where the bread is singular."""

import numpy as np

from robotmodels.arrays import Array
from robotmodels.errors import NotIdentifiable

# Relative eigenvalues of the scaled information below this are rounding errors of the FRFs:
# a standard deviation a million times that of a parameter alone.
SINGULAR = 1e-12


def sandwich(bread: Array, meat: Array, names: tuple[str, ...]) -> Array:
    """Return bread^-1 meat bread^-1, scaled to unit diagonals before inverting.

    Raises
    ------
    NotIdentifiable : if the bread is singular.
    """
    remedy = "add positions or frequencies, free fewer parameters, or fix one of them"
    size = np.sqrt(np.diag(bread))
    # Sensitivities that are zero but for rounding stay zero.
    blind = ~(size > 16 * np.finfo(float).eps * size.max())
    if blind.any():
        raise NotIdentifiable(tuple(n for n, b in zip(names, blind, strict=True) if b), remedy)
    values, vectors = np.linalg.eigh(bread / np.outer(size, size))
    null = vectors[:, values < SINGULAR * values[-1]]
    if null.size:
        share = np.abs(null).max(axis=1)
        guilty = share > 0.1 * share.max()
        raise NotIdentifiable(tuple(n for n, g in zip(names, guilty, strict=True) if g), remedy)
    inverse = (vectors / values) @ vectors.T
    scaled = inverse @ (meat / np.outer(size, size)) @ inverse
    result = scaled / np.outer(size, size)
    return np.asarray((result + result.T) / 2)
