"""Pick the best few of very many candidates."""

import numpy as np

from robotmodels.arrays import Array, IntArray


def largest(values: Array, count: int) -> IntArray:
    """Return the indices of the largest finite values, largest first; equal ones in order."""
    count = min(count, int((values > -np.inf).sum()))
    if count == 0:
        return np.zeros(0, dtype=np.int64)
    some = np.argpartition(-values, count - 1)[:count]
    # Of equal values at the end the partition takes any; the first ones are wanted.
    last = values[some].min()
    above = np.flatnonzero(values > last)
    ties = np.flatnonzero(values == last)[: count - len(above)]
    some = np.concatenate([above, ties])
    return np.asarray(some[np.argsort(-values[some], kind="stable")])
