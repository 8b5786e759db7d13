"""How far a design can be from the optimum: a bound that does not care who made the design."""

import numpy as np

from oed.criteria import criterion as named_criterion
from oed.criteria import sensitivities
from robotmodels.arrays import Array
from robotmodels.errors import InvalidInput


def optimality_gap(weights: Array, matrices: Array, criterion: str = "D") -> float:
    """Return max_i tr(W H_i) / tr(W M) - 1; for D, max_i tr(M^-1 H_i)/p - 1.

    It is zero at an optimum and positive elsewhere, the equivalence theorem (Kiefer and
    Wolfowitz 1960); infinite where the design leaves a parameter open.

    Parameters
    ----------
    weights : (Q,) shares of the experiments, none negative; they are scaled to sum to one.
    matrices : (Q, p, p) information of one experiment in each candidate position.
    criterion : name of the criterion.

    Raises
    ------
    InvalidInput : if the weights do not fit, one is negative or not finite, or all are zero.
    """
    shares = checked_weights(weights, len(matrices))
    information = np.tensordot(shares, matrices, axes=1)
    gradient = named_criterion(criterion).gradient(information)
    if not np.isfinite(gradient).all():
        return np.inf
    largest = sensitivities(gradient, matrices).max()
    return float(largest / np.vdot(gradient, information) - 1.0)


def efficiency_bound(gap: float) -> float:
    """Return the least D-efficiency, (det M / det M_optimal)^(1/p), of a design with that gap.

    By the inequality of the means det(M^-1 M_opt)^(1/p) <= tr(M^-1 M_opt)/p <= 1 + gap.
    """
    return 1.0 / (1.0 + gap)


def checked_weights(weights: Array, n_candidates: int) -> Array:
    """Return `weights` as a (Q,) array that sums to one.

    Raises
    ------
    InvalidInput : if the weights do not fit, one is negative or not finite, or all are zero.
    """
    array = np.asarray(weights, dtype=float)
    if array.shape != (n_candidates,):
        raise InvalidInput(
            f"weights: shape {array.shape}, one weight for each of {n_candidates} candidates "
            "is needed"
        )
    wrong = ~(np.isfinite(array) & (array >= 0))
    if wrong.any():
        i = int(np.argmax(wrong))
        raise InvalidInput(f"weights: {array[i]:g} of candidate {i} is not a number >= 0")
    if array.sum() == 0:
        raise InvalidInput("weights: all are zero; at least one candidate must be used")
    return np.asarray(array / array.sum())
