"""The exact design: how many whole experiments go to each candidate position.

Efficient rounding of the relaxed shares gives a start, exchanges over all candidates improve it,
and the relaxed optimum bounds how much better any other plan could be.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np

from oed.certificate import checked_weights, efficiency_bound, optimality_gap
from oed.criteria import criterion as named_criterion
from oed.criteria import sensitivities
from oed.information_set import InformationSet
from oed.null_space import weak_directions
from oed.relaxed import Design, optimal_design, whiten
from robotmodels.arrays import Array, IntArray, read_only
from robotmodels.errors import InvalidInput, NotIdentifiable

# Keeps determinants finite while a plan is still singular; whitened information is of order one.
_RIDGE = 1e-9
_BATCH = 32


@dataclass(frozen=True, eq=False)
class ExactDesign:
    """Whole experiments per candidate, with a certified efficiency.

    Attributes
    ----------
    repetitions : (Q,) experiments in each candidate position.
    efficiency : lower bound on (det M / det M_best)^(1/p) against every plan of as many
        experiments, whole or not, taken from the relaxed design and its gap.
    value : log det of the information per experiment, comparable with `Design.value`.
    support : indices of the candidates used.
    information : (p, p) of the whole plan, sum_i n_i H_i.
    names : p parameter names.
    """

    repetitions: IntArray
    efficiency: float
    value: float
    support: IntArray
    information: Array
    names: tuple[str, ...]

    @property
    def n_experiments(self) -> int:
        """Number of experiments of the plan."""
        return int(self.repetitions.sum())


def exact_design(
    info: InformationSet, n_experiments: int = 15, design: Design | None = None
) -> ExactDesign:
    """Return a D-efficient plan of `n_experiments` whole experiments.

    Parameters
    ----------
    info : information of each candidate.
    n_experiments : number of experiments.
    design : relaxed design of the same candidates; computed if None. Its gap is certified anew.

    Raises
    ------
    InvalidInput : if `n_experiments` is not a positive whole number, or `design` does not fit.
    NotIdentifiable : naming the parameters, if so few experiments leave a direction open (and
        how many are needed), or all candidates together do.
    """
    whole = isinstance(n_experiments, (int, np.integer)) and not isinstance(n_experiments, bool)
    if not whole or n_experiments < 1:
        raise InvalidInput(f"n_experiments: {n_experiments!r} is not a whole number >= 1")
    relaxed = optimal_design(info) if design is None else design
    weights = checked_weights(relaxed.weights, len(info))
    gap = optimality_gap(weights, info.matrices)
    reference = np.tensordot(weights, info.matrices, axes=1)
    if not np.isfinite(gap):
        raise NotIdentifiable(info.unidentifiable(reference), "the relaxed design is singular")
    whitened = whiten(info.matrices, reference)
    largest_rank = _largest_rank(whitened)
    plans = [
        _exchange(whitened, start, largest_rank)
        for start in _starts(whitened, weights, int(n_experiments), largest_rank)
    ]
    counts = max(plans, key=lambda plan: _value(whitened, plan))
    total = np.tensordot(counts, info.matrices, axes=1)
    if weak_directions(total).shape[1]:
        raise NotIdentifiable(
            info.unidentifiable(total), _too_few(whitened, int(n_experiments), largest_rank)
        )
    log_det = named_criterion("D").value
    value = log_det(total / n_experiments)
    ratio = float(np.exp((value - log_det(reference)) / len(info.names)))
    return ExactDesign(
        repetitions=read_only(counts),
        efficiency=min(1.0, ratio * efficiency_bound(gap)),
        value=value,
        support=read_only(np.flatnonzero(counts)),
        information=read_only(total),
        names=info.names,
    )


def efficient_rounding(weights: Array, n_experiments: int) -> IntArray:
    """Return whole numbers (Q,) near `weights` times `n_experiments`.

    No other rounding of the weights alone guarantees more (Pukelsheim and Rieder 1992); it needs
    at least one experiment per supported candidate.

    Raises
    ------
    InvalidInput : if there are fewer experiments than supported candidates.
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


def _starts(
    matrices: Array, weights: Array, n_experiments: int, largest_rank: int
) -> Iterator[IntArray]:
    if n_experiments >= np.count_nonzero(weights):
        yield efficient_rounding(weights, n_experiments)
    chosen = list(islice(_additions(matrices, largest_rank), n_experiments))
    yield np.bincount(chosen, minlength=len(matrices)).astype(np.int64)


def _additions(matrices: Array, largest_rank: int) -> Iterator[int]:
    """Yield the candidate that adds most, again and again; an endless plan."""
    information = _RIDGE * np.eye(matrices.shape[-1])
    while True:
        best, _ = _best_addition(matrices, information, largest_rank)
        information = information + matrices[best]
        yield best


def _exchange(matrices: Array, start: IntArray, largest_rank: int) -> IntArray:
    """Return a plan (Q,) that no exchange of one experiment for another improves."""
    counts = start.copy()
    ridge = _RIDGE * np.eye(matrices.shape[-1])
    value = _value(matrices, counts)
    improved = True
    while improved:
        improved = False
        for leaving in np.flatnonzero(counts):
            counts[leaving] -= 1
            rest = np.tensordot(counts, matrices, axes=1) + ridge
            entering, new_value = _best_addition(matrices, rest, largest_rank)
            if new_value > value + 1e-9:
                value, improved = new_value, True
                counts[entering] += 1
            else:
                counts[leaving] += 1
    return counts


def _best_addition(matrices: Array, information: Array, largest_rank: int) -> tuple[int, float]:
    """Return the candidate that adds most to `information` (p, p), and the new log det.

    log det(I + X) <= r log(1 + tr X/r) for X of rank r spares most candidates their determinant.
    """
    L = np.linalg.cholesky(information)
    T = np.linalg.inv(L)
    traces = sensitivities(T.T @ T, matrices)
    bounds = largest_rank * np.log1p(np.maximum(traces, 0.0) / largest_rank)
    order = np.argsort(-traces, kind="stable")
    best, most = int(order[0]), -np.inf
    for first in range(0, len(order), _BATCH):
        batch = order[first : first + _BATCH]
        if bounds[batch[0]] <= most:
            break
        gains = np.linalg.slogdet(np.eye(len(T)) + T @ matrices[batch] @ T.T).logabsdet
        if gains.max() > most:
            best, most = int(batch[np.argmax(gains)]), float(gains.max())
    return best, 2 * float(np.log(np.diagonal(L)).sum()) + most


def _value(matrices: Array, counts: IntArray) -> float:
    information = np.tensordot(counts, matrices, axes=1) + _RIDGE * np.eye(matrices.shape[-1])
    return float(np.linalg.slogdet(information).logabsdet)


def _largest_rank(matrices: Array) -> int:
    """Return the largest rank of one whitened candidate."""
    first = matrices[np.argmax(np.trace(matrices, axis1=1, axis2=2))]
    # Usually one look is enough, and a thousand times cheaper than all.
    if not weak_directions(first).shape[1]:
        return len(first)
    eigenvalues = np.linalg.eigvalsh(matrices)
    return int(np.max((eigenvalues > 1e-12 * eigenvalues[:, -1:]).sum(axis=1)))


def _too_few(matrices: Array, n_experiments: int, largest_rank: int) -> str:
    """Return the remedy for a plan with too few experiments."""
    p = matrices.shape[-1]
    information = np.zeros((p, p))
    # Additions raise the rank every time, as all candidates together have full rank.
    enough = 0
    for added in _additions(matrices, largest_rank):
        information += matrices[added]
        enough += 1
        if not weak_directions(information).shape[1]:
            break
    least = max(-(-p // largest_rank), 2)
    few = f"n_experiments: {n_experiments} is too few"
    if least == enough:
        return f"{few}, {enough} are needed"
    if least > n_experiments:
        return f"{few}, at least {least} are needed and {enough} suffice"
    return f"{few}, {enough} suffice"
