"""Which candidate adds most to an information matrix, with as few evaluations as bounds allow."""

from collections.abc import Callable

import numpy as np

from oed.criteria import matrix_means
from oed.criteria.objective import Objective
from oed.information_sets.candidates import sensitivities
from robotmodels.common.arrays import Array, BoolArray, IntArray
from robotmodels.common.symmetric_matrices import unit_diagonal_scaling

# Usually the first few decide.
_FIRST, _BATCH = 4, 32

Evaluate = Callable[[IntArray], Array]


def best_addition(
    objective: Objective,
    information: Array,
    matrices: Array,
    usable: BoolArray,
    least: float = -np.inf,
    ceilings: Array | None = None,
) -> tuple[int, float]:
    """Return the candidate with the largest log value of information + H_i, and that value.

    Candidates are tried in the order of upper bounds until no other can be better. For D
    log det(I + X) <= p log(1 + tr X / p); any other concave function lies below its tangent.

    Parameters
    ----------
    objective : Objective
        What is maximised.
    information : ndarray, (p, p), or (K, p, p)
        Information so far, the latter with samples of theta.
    matrices : ndarray, (n, p, p) or (n, K, p, p)
        Information of each candidate.
    usable : ndarray of bool, (n,)
        Candidates that may be taken.
    least : float
        Values up to this one do not matter.
    ceilings : ndarray, (n,), optional
        Further upper bounds on the values.

    Returns
    -------
    tuple of (int, float)
        Index and value; -1 and `least` if no usable candidate has a larger value.
    """
    bounded = _log_det if is_plain_d(objective) else _any
    bounds, evaluate = bounded(objective, information, matrices)
    if ceilings is not None:
        bounds = np.minimum(bounds, ceilings)
    bounds = np.where(usable, bounds, -np.inf)
    order = np.argsort(-bounds, kind="stable")
    best, most = -1, least
    first, size = 0, _FIRST
    while first < len(order):
        batch = order[first : first + size]
        batch = batch[bounds[batch] > most]
        first, size = first + size, _BATCH
        if not len(batch):
            break
        values = evaluate(batch)
        k = int(np.argmax(values))
        if values[k] > most:
            best, most = int(batch[k]), float(values[k])
    return best, most


def is_plain_d(objective: Objective) -> bool:
    """Return whether the log value is log det M / p but for a constant."""
    mean = objective.terms[0].mean
    return len(objective.terms) == 1 and mean.kind == "D" and mean.combinations is None


def _log_det(objective: Objective, information: Array, matrices: Array) -> tuple[Array, Evaluate]:
    shape, p = information.shape, information.shape[-1]
    L = np.linalg.cholesky(information.reshape(p, p))
    T = np.linalg.inv(L)
    shift = objective.terms[0].mean.offset - float(objective.log_references[0])
    start = 2 * float(np.log(np.diagonal(L)).sum()) / p + shift
    traces = sensitivities((T.T @ T).reshape(shape), matrices)

    def evaluate(batch: IntArray) -> Array:
        white = T @ matrices[batch].reshape(-1, p, p) @ T.T
        return np.asarray(start + np.linalg.slogdet(np.eye(p) + white).logabsdet / p)

    return start + np.log1p(np.maximum(traces, 0.0) / p), evaluate


def _any(objective: Objective, information: Array, matrices: Array) -> tuple[Array, Evaluate]:
    value = objective.log_value(information)
    bounds = np.full(len(matrices), np.inf)
    if value > -np.inf:
        gradient = objective.log_gradient(information)
        bounds = value + sensitivities(gradient, matrices)

    def evaluate(batch: IntArray) -> Array:
        return log_values(objective, information + matrices[batch])

    return bounds, evaluate


def log_values(objective: Objective, stack: Array) -> Array:
    """Return the log value of each of `stack`, (n, p, p) or (n, K, p, p), many at a time."""
    return np.asarray(np.min(group_log_values(objective, stack), axis=1))


def group_log_values(objective: Objective, stack: Array) -> Array:
    """Return the log values of the objective's groups, (n, G), the least of which counts."""
    p = stack.shape[-1]
    by_sample = stack.reshape(len(stack), -1, p, p)
    logs = np.empty((len(stack), len(objective.terms)))
    try:
        for k, terms in objective.by_sample.items():
            means = [objective.terms[i].mean for i in terms]
            logs[:, terms] = matrix_means.log_values(means, _inverse_roots(by_sample[:, k]))
    except np.linalg.LinAlgError:  # one of them is singular
        references = objective.log_references
        return np.array([objective.group_values(one) - references for one in stack])
    return objective.shared(logs) - objective.log_references


def _inverse_roots(stack: Array) -> Array:
    """Return T, lower triangular, with T'T the inverses of positive definite matrices (n, p, p)."""
    s = unit_diagonal_scaling(stack[0])
    if not s.all():
        raise np.linalg.LinAlgError
    L = np.linalg.cholesky(s[:, None] * stack * s)
    if np.diagonal(L, axis1=1, axis2=2).min() < 1e-6:
        raise np.linalg.LinAlgError
    return np.asarray(np.linalg.inv(L) * s)
