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
    NotIdentifiable
        If the bread is singular, with every parameter that is in its null space.
    """
    size = np.sqrt(np.diag(bread))
    # Sensitivities that are zero but for rounding stay zero.
    blind = ~(size > 16 * np.finfo(float).eps * size.max())
    size = np.where(blind, 1.0, size)
    scaled = np.where(blind | blind[:, None], 0.0, bread / np.outer(size, size))
    values, vectors = np.linalg.eigh(scaled)
    # Without any information at all, all are blind and all eigenvalues zero.
    null = values <= SINGULAR * values[-1]
    if null.any():
        share = np.linalg.norm(vectors[:, null], axis=1)  # in any basis of the null space
        guilty = share > 0.1 * share.max()
        raise NotIdentifiable(
            tuple(name for name, one in zip(names, guilty, strict=True) if one),
            "add positions or frequencies, free fewer parameters, or fix one of them",
        )
    inverse = (vectors / values) @ vectors.T
    result = inverse @ (meat / np.outer(size, size)) @ inverse / np.outer(size, size)
    return np.asarray((result + result.T) / 2)
