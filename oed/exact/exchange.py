"""Whole plans, improved by exchanging one experiment for another until no exchange helps.

Most candidates never matter. Exchanges are made within a pool of promising ones; then all others
are checked: a concave function lies below its tangent, so that an experiment in i instead of l can
only help if its directional derivative tr(W H_i) is larger. Those that pass are tried, and join the
pool if they do help.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from oed.design.problem import DesignProblem
from oed.exact.gain_bounds import best_addition
from oed.information_sets.candidates import sensitivities
from robotmodels.common.arrays import Array, BoolArray, IntArray

# Keeps values finite while a plan is still singular, beside the relaxed optimum's information.
_RIDGE = 1e-9
_IMPROVED = 1e-10  # of a log value
_SLACK = 1e-9  # of a constraint
_BLOCK = 2048


@dataclass(frozen=True, eq=False)
class ExactProblem(DesignProblem):
    """The same problem over whole numbers n_i of experiments instead of weights.

    Attributes
    ----------
    reference : ndarray, (p, p) or (K, p, p)
        Information of the relaxed optimum, prior included.
    """

    reference: Array = field(kw_only=True)

    @property
    def base(self) -> Array:
        """The prior and a little of the reference, so that every plan has a finite value."""
        ridge = _RIDGE * self.reference
        return ridge if self.prior is None else ridge + self.prior

    @cached_property
    def least(self) -> IntArray:
        """Least whole numbers, (Q,)."""
        return np.ceil(self.allowed.lower - _SLACK).astype(np.int64)

    def value(self, counts: IntArray) -> float:
        """Return the log value, a little information added."""
        return self.objective.log_value(self.information(counts) + _RIDGE * self.reference)

    def feasible(self, counts: IntArray) -> bool:
        """Return whether whole numbers (Q,) are allowed."""
        return self.allowed.violation(counts.astype(float)) <= _SLACK

    def can_add(self, counts: IntArray, among: IntArray, allow_repair: bool = False) -> BoolArray:
        """Return for which of the candidates `among` one more experiment is allowed.

        With `allow_repair` also those that lessen the violation of a row and worsen none.
        """
        allowed, used = self.allowed, np.flatnonzero(counts)
        slack = allowed.bounds - allowed.rows[:, used] @ counts[used]
        slack = (slack + _SLACK * np.maximum(np.abs(allowed.bounds), 1.0))[:, None]
        rows = allowed.rows[:, among]
        allowed_rows = rows <= slack
        violated = slack < 0
        if allow_repair and violated.any():
            repairs = ((rows < 0) & violated).any(axis=0)
            allowed_rows = (allowed_rows | (violated & (rows <= 0))) & repairs
        limits = counts[among] + 1 <= allowed.upper[among] + _SLACK
        return np.asarray(allowed_rows.all(axis=0) & limits)


class Pool:
    """Candidates whose matrices are in memory, the ones that exchanges are tried with."""

    def __init__(self, problem: ExactProblem, indices: IntArray) -> None:
        self.problem = problem
        self.indices = np.unique(indices)
        self.matrices = problem.candidates.take(self.indices)

    def add(self, indices: IntArray) -> None:
        """Add candidates and their matrices."""
        new = np.setdiff1d(indices, self.indices)
        self.indices = np.concatenate([self.indices, new])
        self.matrices = np.concatenate([self.matrices, self.problem.candidates.take(new)])

    def row_of(self, index: int) -> int:
        """Return the row of a candidate in `indices` and `matrices`."""
        return int(np.flatnonzero(self.indices == index)[0])


def complete_greedily(pool: Pool, counts: IntArray) -> IntArray:
    """Return `counts` and the best additions, one by one, until the constraints allow no more."""
    problem, counts = pool.problem, counts.copy()
    information = problem.information(counts) + _RIDGE * problem.reference
    while True:
        addable = problem.can_add(counts, pool.indices, allow_repair=True)
        if not addable.any():
            return counts
        best, _ = best_addition(problem.objective, information, pool.matrices, addable)
        if best < 0:
            return counts
        counts[pool.indices[best]] += 1
        information = information + pool.matrices[best]


def exchange(pool: Pool, counts: IntArray) -> IntArray:
    """Return a plan that no exchange of one experiment for another improves, all candidates tried.

    `counts` must be allowed; the plan is.
    """
    pool.add(np.flatnonzero(counts))
    while True:
        counts = _exchange_within(pool, counts)
        better = _entering_outside(pool, counts)
        if not len(better):
            return counts
        pool.add(better)


def _exchange_within(pool: Pool, counts: IntArray) -> IntArray:
    """Return a plan that no exchange within the pool improves."""
    problem, counts = pool.problem, complete_greedily(pool, counts)
    value, gradient = _tangent(problem, counts)
    derivatives = sensitivities(gradient, pool.matrices)
    tried: set[int] = set()
    while True:
        support = np.flatnonzero(counts > problem.least)
        untried = [int(i) for i in support if int(i) not in tried]
        if not untried:
            return counts
        # The candidate of the least derivative is the first to go.
        leaving = min(untried, key=lambda i: derivatives[pool.row_of(i)])
        tried.add(leaving)
        ceilings = value + derivatives - derivatives[pool.row_of(leaving)]
        entering = _better(problem, counts, leaving, pool.indices, pool.matrices, value, ceilings)
        if entering is None:
            continue
        counts[leaving] -= 1
        counts[entering] += 1
        if len(problem.allowed.rows) > 1 or problem.allowed.rows.min() < 1:
            counts = complete_greedily(
                pool, counts
            )  # a shorter experiment may have made room for another
        value, gradient = _tangent(problem, counts)
        derivatives = sensitivities(gradient, pool.matrices)
        tried.clear()


def _tangent(problem: ExactProblem, counts: IntArray) -> tuple[float, Array]:
    """Return the log value of a plan, and its derivative W by the information."""
    information = problem.information(counts) + _RIDGE * problem.reference
    gradient = problem.objective.log_gradient(information)
    return problem.objective.log_value(information), gradient


def _better(
    problem: ExactProblem,
    counts: IntArray,
    leaving: int,
    indices: IntArray,
    matrices: Array,
    value: float,
    ceilings: Array | None = None,
) -> int | None:
    """Return the best candidate to replace `leaving`, if the plan's value then grows."""
    counts = counts.copy()
    counts[leaving] -= 1
    addable = problem.can_add(counts, indices)
    if not addable.any():
        return None
    without = problem.information(counts) + _RIDGE * problem.reference
    best, _ = best_addition(
        problem.objective, without, matrices, addable, value + _IMPROVED, ceilings
    )
    if best < 0:
        return None
    entering = int(indices[best])
    counts[entering] += 1
    # Computed from the plan alone, values rise strictly, so that exchanges come to an end.
    return entering if problem.value(counts) > value + _IMPROVED else None


def _entering_outside(pool: Pool, counts: IntArray) -> IntArray:
    """Return candidates outside the pool with which an exchange would improve the plan."""
    problem = pool.problem
    value, gradient = _tangent(problem, counts)
    derivatives = problem.candidates.directional_derivatives(gradient)
    leaving = np.flatnonzero(counts > problem.least)
    if not len(leaving):
        return np.empty(0, dtype=np.int64)
    passing = (derivatives > derivatives[leaving].min() + _IMPROVED) & (problem.allowed.upper >= 1)
    passing[pool.indices] = False
    better: list[int] = []
    for block in np.array_split(
        np.flatnonzero(passing), np.arange(_BLOCK, int(passing.sum()), _BLOCK)
    ):
        if not len(block):
            continue
        matrices = problem.candidates.take(block)
        for index in leaving:
            ceilings = value + derivatives[block] - derivatives[index]
            entering = _better(problem, counts, int(index), block, matrices, value, ceilings)
            if entering is not None:
                better.append(entering)
    return np.unique(np.array(better, dtype=np.int64))
