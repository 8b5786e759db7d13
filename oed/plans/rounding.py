"""From shares to whole numbers."""

import numpy as np

from robotmodels.arrays import Array, IntArray
from robotmodels.errors import InvalidInput


def efficient_rounding(weights: Array, n_experiments: int) -> IntArray:
    """Return whole numbers (Q,) near `weights` times `n_experiments`.

    No other rounding of the weights alone guarantees more (Pukelsheim and Rieder 1992); it needs
    at least one experiment per supported candidate.

    Raises
    ------
    InvalidInput
        If there are fewer experiments than supported candidates.
    """
    support = np.flatnonzero(weights)
    if n_experiments < len(support):
        raise InvalidInput(
            f"n_experiments: {n_experiments} cannot be shared by {len(support)} positions; "
            f"efficient rounding needs at least {len(support)}"
        )
    shares = weights[support]
    counts = np.ceil((n_experiments - len(support) / 2) * shares)
    while counts.sum() < n_experiments:
        counts[np.argmin(counts / shares)] += 1
    while counts.sum() > n_experiments:
        counts[np.argmax((counts - 1) / shares)] -= 1
    rounded = np.zeros(len(weights), dtype=np.int64)
    rounded[support] = counts
    return rounded
