"""Find candidates that are equal but for rounding; they would only spread weight."""

import numpy as np

from robotmodels.arrays import Array, IntArray

# In whitened coordinates matrices are of order one; equal ones differ by rounding only.
_DUPLICATE = 1e-9


def distinct(flat: Array) -> IntArray:
    """Return the index of the first of each group of equal rows of (n, k)."""
    # Equal rows have equal projections: only neighbours in this order need comparing.
    direction = np.random.default_rng(0).standard_normal(flat.shape[1])
    keys = flat @ (direction / np.linalg.norm(direction))
    order = np.argsort(keys, kind="stable")
    apart = np.diff(keys[order]) > _DUPLICATE * np.sqrt(flat.shape[1])
    alone = np.append(True, apart) & np.append(apart, True)
    kept: list[int] = order[alone].tolist()
    near = order[~alone]
    for group in np.split(near, np.flatnonzero(np.append(True, apart)[~alone])[1:]):
        remaining = np.sort(group)
        while len(remaining):
            kept.append(int(remaining[0]))
            away = np.abs(flat[remaining] - flat[remaining[0]]).max(axis=1) > _DUPLICATE
            remaining = remaining[away]
    return np.sort(np.array(kept))
