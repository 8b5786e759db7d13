"""Whole plans, improved by exchanging one experiment for another until no exchange helps.

Most candidates never matter. Exchanges are made within a pool of promising ones; then all others
are priced: a concave function lies below its tangent, so that an experiment in i instead of l can
only help if its price is higher. The few that pass are tried, and join the pool if they do help.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from oed.criteria.objective import Objective
from oed.design.polytope import Polytope
from oed.exact.gain_bounds import best_addition
from oed.information_sets.candidates import Candidates, sensitivities
from robotmodels.common.arrays import Array, BoolArray, IntArray

# Keeps values finite while a plan is still singular, beside the relaxed optimum's information.
_RIDGE = 1e-9
_IMPROVED = 1e-10  # of a log value
_SLACK = 1e-9  # of a constraint
_BLOCK = 2048


@dataclass(frozen=True, eq=False)
class WholeProblem:
    """Maximise objective(prior + sum_i n_i H_i) over whole numbers n_i that are allowed.

    Attributes
    ----------
    candidates : Candidates
        As in a relaxed design.
    objective : Objective
        As in a relaxed design.
    allowed : Polytope
        Weights in experiments.
    reference : ndarray, (p, p) or (K, p, p)
        Information of the relaxed optimum, prior included.
    prior : ndarray or None
        Prior of that shape, or None.
    """

    candidates: Candidates
    objective: Objective
    allowed: Polytope
    reference: Array
    prior: Array | None = None

    @property
    def base(self) -> Array:
        """The prior and a little of the reference, so that every plan has a finite value."""
        ridge = _RIDGE * self.reference
        return ridge if self.prior is None else ridge + self.prior

    @cached_property
    def least(self) -> IntArray:
        """Least whole numbers, (Q,)."""
        return np.ceil(self.allowed.lower - _SLACK).astype(np.int64)

    def information(self, counts: IntArray) -> Array:
        """Return prior + sum_i n_i H_i."""
        own = self.candidates.combined(counts.astype(float))
        return own if self.prior is None else own + self.prior

    def value(self, counts: IntArray) -> float:
        """Return the log value, a little information added."""
        return self.objective.log_value(self.information(counts) + _RIDGE * self.reference)

    def feasible(self, counts: IntArray) -> bool:
        """Return whether whole numbers (Q,) are allowed."""
        return self.allowed.violation(counts.astype(float)) <= _SLACK

    def room(self, counts: IntArray, among: IntArray, mending: bool = False) -> BoolArray:
        """Return for which of the candidates `among` one more experiment is allowed.

        With `mending` also those that lessen the violation of a row and worsen none.
        """
        allowed, used = self.allowed, np.flatnonzero(counts)
        left = allowed.bounds - allowed.rows[:, used] @ counts[used]
        left = (left + _SLACK * np.maximum(np.abs(allowed.bounds), 1.0))[:, None]
        rows = allowed.rows[:, among]
        fits = rows <= left
        violated = left < 0
        if mending and violated.any():
            mends = ((rows < 0) & violated).any(axis=0)
            fits = (fits | (violated & (rows <= 0))) & mends
        limits = counts[among] + 1 <= allowed.upper[among] + _SLACK
        return np.asarray(fits.all(axis=0) & limits)


class Pool:
    """Candidates whose matrices are at hand."""

    def __init__(self, problem: WholeProblem, indices: IntArray) -> None:
        self.problem = problem
        self.indices = np.unique(indices)
        self.matrices = problem.candidates.take(self.indices)

    def add(self, indices: IntArray) -> None:
        """Let more candidates in."""
        new = np.setdiff1d(indices, self.indices)
        self.indices = np.concatenate([self.indices, new])
        self.matrices = np.concatenate([self.matrices, self.problem.candidates.take(new)])

    def place(self, index: int) -> int:
        """Return where a candidate is in the pool."""
        return int(np.flatnonzero(self.indices == index)[0])


def fill(pool: Pool, counts: IntArray) -> IntArray:
    """Return `counts` and the best additions, one by one, until the constraints leave no room."""
    problem, counts = pool.problem, counts.copy()
    information = problem.information(counts) + _RIDGE * problem.reference
    while True:
        room = problem.room(counts, pool.indices, mending=True)
        if not room.any():
            return counts
        best, _ = best_addition(problem.objective, information, pool.matrices, room)
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
        counts = _within(pool, counts)
        better = _outside(pool, counts)
        if not len(better):
            return counts
        pool.add(better)


def _within(pool: Pool, counts: IntArray) -> IntArray:
    """Return a plan that no exchange within the pool improves."""
    problem, counts = pool.problem, fill(pool, counts)
    value, prices = _tangent(problem, counts)
    mine = sensitivities(prices, pool.matrices)
    tried: set[int] = set()
    while True:
        support = np.flatnonzero(counts > problem.least)
        left = [int(i) for i in support if int(i) not in tried]
        if not left:
            return counts
        # What is worth least now is the first to go.
        leaving = min(left, key=lambda i: mine[pool.place(i)])
        tried.add(leaving)
        ceilings = value + mine - mine[pool.place(leaving)]
        entering = _better(problem, counts, leaving, pool.indices, pool.matrices, value, ceilings)
        if entering is None:
            continue
        counts[leaving] -= 1
        counts[entering] += 1
        if len(problem.allowed.rows) > 1 or problem.allowed.rows.min() < 1:
            counts = fill(pool, counts)  # a shorter experiment may have made room for another
        value, prices = _tangent(problem, counts)
        mine = sensitivities(prices, pool.matrices)
        tried.clear()


def _tangent(problem: WholeProblem, counts: IntArray) -> tuple[float, Array]:
    """Return the log value of a plan, and the slope that prices candidates."""
    information = problem.information(counts) + _RIDGE * problem.reference
    slope = problem.objective.price(problem.objective.witness(information), information.shape)
    return problem.objective.log_value(information), slope


def _better(
    problem: WholeProblem,
    counts: IntArray,
    leaving: int,
    indices: IntArray,
    matrices: Array,
    value: float,
    ceilings: Array | None = None,
) -> int | None:
    """Return the best candidate to take the place of `leaving`, if the plan's value then grows."""
    counts = counts.copy()
    counts[leaving] -= 1
    room = problem.room(counts, indices)
    if not room.any():
        return None
    rest = problem.information(counts) + _RIDGE * problem.reference
    best, _ = best_addition(problem.objective, rest, matrices, room, value + _IMPROVED, ceilings)
    if best < 0:
        return None
    entering = int(indices[best])
    counts[entering] += 1
    # Computed from the plan alone, values rise strictly, so that exchanges come to an end.
    return entering if problem.value(counts) > value + _IMPROVED else None


def _outside(pool: Pool, counts: IntArray) -> IntArray:
    """Return candidates outside the pool with which an exchange would improve the plan."""
    problem = pool.problem
    value, slope = _tangent(problem, counts)
    prices = problem.candidates.prices(slope)
    leaving = np.flatnonzero(counts > problem.least)
    if not len(leaving):
        return np.empty(0, dtype=np.int64)
    passing = (prices > prices[leaving].min() + _IMPROVED) & (problem.allowed.upper >= 1)
    passing[pool.indices] = False
    better: list[int] = []
    for block in np.array_split(
        np.flatnonzero(passing), np.arange(_BLOCK, int(passing.sum()), _BLOCK)
    ):
        if not len(block):
            continue
        matrices = problem.candidates.take(block)
        for index in leaving:
            ceilings = value + prices[block] - prices[index]
            entering = _better(problem, counts, int(index), block, matrices, value, ceilings)
            if entering is not None:
                better.append(entering)
    return np.unique(np.array(better, dtype=np.int64))
