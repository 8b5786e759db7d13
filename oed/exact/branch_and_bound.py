"""Branch and bound over the repetitions of candidates, with relaxed designs as bounds."""

import heapq
from dataclasses import dataclass, field, replace
from itertools import count

import numpy as np

from oed.design.active_set import solve
from oed.design.design import Design
from oed.design.polytope import Polytope
from oed.design.problem import DesignProblem
from oed.design.solvers import design_solvers
from oed.exact.exchange import ExactProblem
from oed.information_sets.candidates import Candidates, Matrices
from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.errors import IdentificationError
from robotmodels.common.progress import Progress

_TOLERANCE = 1e-7  # of log values: plans closer than that are equally good
_GAP = 1e-7
_WHOLE = 1e-6


@dataclass(order=True)
class _Node:
    """Plans between two limits, (n,) each; sorted by bound, the largest first."""

    rank: float
    number: int
    lower: IntArray = field(compare=False)
    upper: IntArray = field(compare=False)


class BranchAndBound:
    """The best plans of a problem, and a bound on all others.

    Attributes
    ----------
    plans : dict of bytes to tuple of (float, ndarray of int)
        log value and repetitions of the best plans so far, by their bytes.
    nodes : int
        Relaxed problems solved.
    considered : int
        Candidates that the first bound does not exclude.
    complete : bool
        Whether every plan was considered or ruled out.
    exhausted : bool
        Whether there are fewer plans than `n_plans`.
    """

    def __init__(
        self,
        problem: ExactProblem,
        n_plans: int,
        max_nodes: int,
        progress: Progress | None,
    ) -> None:
        self.problem, self.n_plans, self.max_nodes = problem, n_plans, max_nodes
        self.progress = progress
        self.plans: dict[bytes, tuple[float, IntArray]] = {}
        self.nodes = self.considered = 0
        self.complete = self.exhausted = False
        rows, bounds = problem.allowed.rows, problem.allowed.bounds
        counted = len(rows) == 1 and bool((rows == 1).all())
        # Experiments alone are limited: a plan uses all of them.
        self.total = int(bounds[0] + _WHOLE) if counted else None

    @property
    def worst(self) -> float:
        """Log value that a plan must exceed to be one of the best `n_plans`."""
        if len(self.plans) < self.n_plans:
            return -np.inf
        return min(value for value, _ in self.plans.values())

    def offer(self, counts: IntArray) -> None:
        """Store a plan (Q,) if it is feasible and one of the best so far."""
        if not self.problem.feasible(counts) or (counts < self.problem.least).any():
            return
        if self.total is not None and counts.sum() != self.total:
            return
        value = self.problem.objective.log_value(self.problem.information(counts))
        key = counts.tobytes()
        if value > -np.inf and key not in self.plans and value > self.worst:
            self.plans[key] = value, counts.copy()
            if len(self.plans) > self.n_plans:
                del self.plans[min(self.plans, key=lambda k: self.plans[k][0])]

    def run(self) -> float:
        """Search; return an upper bound on the log value of every plan."""
        allowed, info = self.problem.allowed, self.problem.candidates
        lower = self.problem.least
        most = np.inf if self.total is None else float(self.total)
        upper = np.floor(np.minimum(allowed.upper, most) + _WHOLE)
        upper = np.minimum(upper, _by_rows(allowed)).astype(np.int64)
        constant, derivatives = self._tangent(self.problem.reference, info)
        lower, upper = self._tightened(allowed, constant, derivatives, lower, upper)
        used = np.flatnonzero(upper > 0)
        self.considered = len(used)
        few = Matrices(info.names, info.take(used))
        part = replace(allowed, rows=allowed.rows[:, used])
        number = count()
        heap = [_Node(-np.inf, next(number), lower[used], upper[used])]
        while heap:
            node = heapq.heappop(heap)
            if -node.rank <= self.worst + _TOLERANCE:
                heap.clear()
                break
            if self.nodes >= self.max_nodes:
                return -node.rank
            for child_bound, low, high in self._branches(node, few, part, used):
                if child_bound > self.worst + _TOLERANCE:
                    heapq.heappush(heap, _Node(-child_bound, next(number), low, high))
        self.complete, self.exhausted = True, len(self.plans) < self.n_plans
        return max((value for value, _ in self.plans.values()), default=np.inf)

    def _branches(
        self, node: _Node, few: Matrices, allowed: Polytope, used: IntArray
    ) -> list[tuple[float, IntArray, IntArray]]:
        """Solve a node; return the bound and the limits of each of its branches."""
        lower, upper = node.lower, node.upper
        part = replace(allowed, lower=lower.astype(float), upper=upper.astype(float))
        if (part.slack < -_WHOLE).any() and len(part.rows) == 1:
            return []
        if self.total is not None and upper.sum() < self.total:
            return []
        if (lower == upper).all() or (self.total is not None and lower.sum() == self.total):
            self._offer_part(lower, used)
            return []
        self.nodes += 1
        if self.progress is not None:
            self.progress(self.nodes, self.max_nodes)
        bound = -node.rank
        weights = np.asarray(0.5 * (lower + np.minimum(upper, lower + 1)), dtype=float)
        design = self._solved(few, part)
        if design is not None:
            weights, information = design.weights, design.information
            value = self.problem.objective.log_value(information)
            bound = min(bound, value + float(np.log1p(max(design.gap, 0.0))))
            tangent, derivatives = self._tangent(information, few)
            lower, upper = self._tightened(part, tangent, derivatives, lower, upper)
            self._offer_part(self._rounded(weights, lower, upper), used)
        return [(bound, *limits) for limits in _split(weights, lower, upper)]

    def _solved(self, few: Matrices, allowed: Polytope) -> Design | None:
        problem = DesignProblem(few, self.problem.objective, allowed, self.problem.prior)
        fastest = design_solvers("auto", None, problem.objective)[:1]
        try:
            design = solve(problem, _GAP, 20, fastest, trim=False)
        except IdentificationError:
            return None  # the bound of the node before holds on
        return design if np.isfinite(design.gap) else None

    def _tangent(self, information: Array, candidates: Candidates) -> tuple[float, Array]:
        """Return a and g, (n,), with log value <= a + g'n for every plan n."""
        objective, prior = self.problem.objective, self.problem.prior
        gradient = objective.log_gradient(information)
        constant = objective.log_value(information) - float(np.vdot(gradient, information))
        if prior is not None:
            constant += float(np.vdot(gradient, prior))
        return constant, candidates.directional_derivatives(gradient)

    def _tightened(
        self,
        allowed: Polytope,
        constant: float,
        derivatives: Array,
        lower: IntArray,
        upper: IntArray,
    ) -> tuple[IntArray, IntArray]:
        """Return limits without the plans that the tangent shows to be worse than the best ones."""
        if self.worst == -np.inf:
            return lower, upper
        part = replace(allowed, lower=lower.astype(float), upper=upper.astype(float))
        y = (
            part.best_extreme_point(derivatives)[1]
            if len(part.rows) > 1
            else np.array([_multiplier(part, derivatives)])
        )
        reduced = derivatives - y @ part.rows
        most = constant + float(y @ part.bounds)
        most += float(np.where(reduced > 0, reduced * upper, reduced * lower).sum())
        spare = max(most - self.worst, 0.0) + 1e-12
        with np.errstate(divide="ignore"):
            steps = np.floor(np.minimum(spare / np.abs(reduced), 1e9) + _WHOLE).astype(np.int64)
        high = np.where(reduced < 0, np.minimum(upper, lower + steps), upper)
        low = np.where(reduced > 0, np.maximum(lower, upper - steps), lower)
        return low, high

    def _rounded(self, weights: Array, lower: IntArray, upper: IntArray) -> IntArray:
        counts = np.clip(np.floor(weights + _WHOLE).astype(np.int64), lower, upper)
        if self.total is not None:
            for i in np.argsort(counts - weights, kind="stable"):
                if counts.sum() >= self.total:
                    break
                counts[i] = min(counts[i] + 1, upper[i])
        return counts

    def _offer_part(self, counts: IntArray, used: IntArray) -> None:
        whole = np.zeros(len(self.problem.candidates), dtype=np.int64)
        whole[used] = counts
        self.offer(whole)


def _split(weights: Array, lower: IntArray, upper: IntArray) -> list[tuple[IntArray, IntArray]]:
    """Return the limits of the parts, split at the candidate whose weight is the least whole."""
    free = upper > lower
    if not free.any():
        return [(lower, upper)]
    away = np.where(free, np.abs(weights - np.round(weights)), -1.0)
    i = int(np.argmax(away))
    whole = away[i] < _WHOLE
    if whole:
        i = int(np.argmax(np.where(free, weights, -1.0)))
    middle = int(np.clip(round(weights[i]) if whole else np.floor(weights[i]), lower[i], upper[i]))
    cuts = [(lower[i], middle - 1), (middle, middle), (middle + 1, upper[i])]
    if not whole:
        cuts = [(lower[i], middle), (middle + 1, upper[i])]
    parts = []
    for low, high in cuts:
        if low <= high:
            new_lower, new_upper = lower.copy(), upper.copy()
            new_lower[i], new_upper[i] = low, high
            parts.append((new_lower, new_upper))
    return parts


def _multiplier(allowed: Polytope, derivatives: Array) -> float:
    """Return the budget's multiplier: the derivative per cost at which the budget runs out."""
    cost = allowed.rows[0]
    order = np.argsort(-derivatives / cost, kind="stable")
    filled = np.cumsum((cost * (allowed.upper - allowed.lower))[order])
    last = int(np.searchsorted(filled, allowed.slack[0] - _WHOLE))
    return max(float((derivatives / cost)[order[min(last, len(order) - 1)]]), 0.0)


def _by_rows(allowed: Polytope) -> Array:
    """Return how often each candidate fits into the budget alone."""
    return np.asarray(np.floor(allowed.bounds[0] / allowed.rows[0] + _WHOLE))
