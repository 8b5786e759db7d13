"""A design's problem, and the part of it over a few candidates in numbers of order one."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from oed.design.certificate import Candidates
from oed.design.coordinates import Coordinates
from oed.design.duplicates import distinct
from oed.design.inner_problem import InnerProblem
from oed.design.objective import Objective
from oed.design.polytope import Polytope
from oed.design.ranking import largest
from robotmodels.arrays import Array, BoolArray, IntArray

# An active set must determine every direction at least this well beside all candidates.
_WEAKEST = 1e-6
# Candidates to begin with, and to add in a round, for each parameter: more make the small problems
# larger, fewer take more passes over all candidates. What is not smooth is left to slower solvers.
_BATCH, _BATCH_NOT_SMOOTH = 4, 2


@dataclass(frozen=True, eq=False)
class Problem:
    """Maximise objective(prior + sum_i w_i H_i) over the allowed weights."""

    candidates: Candidates
    objective: Objective
    allowed: Polytope
    prior: Array | None = None

    def information(self, weights: Array) -> Array:
        """Return the prior and sum_i w_i H_i, (p, p) or (K, p, p)."""
        own = self.candidates.combined(weights)
        return own if self.prior is None else own + self.prior


@dataclass(frozen=True, eq=False)
class ScaledProblem:
    """The problem in variables v_i: shares of the budget beyond the lower weights.

    Attributes
    ----------
    problem, objective : as given, and the objective in these coordinates.
    coordinates : in which information is of order one.
    base : (K, p, p) information of the lower weights and the prior.
    units : (Q,) what a share of one means for the weight.
    """

    problem: Problem
    coordinates: Coordinates
    objective: Objective
    base: Array
    units: Array

    @classmethod
    def of(cls, problem: Problem) -> "ScaledProblem":
        """Return the problem in shares and coordinates of order one, after the rank check.

        Raises
        ------
        NotIdentifiable : naming the parameters that all candidates together leave open.
        """
        allowed, candidates = problem.allowed, problem.candidates
        room = max(float(allowed.room[0]), 1e-12 * float(allowed.bounds[0]))
        units = room / allowed.rows[0]
        usable = allowed.upper > allowed.lower
        equal = np.where(usable, units, 0.0) / max(int(usable.sum()), 1)
        base = _samples(problem.information(allowed.lower))
        reference = base + _samples(candidates.combined(equal))
        coordinates = Coordinates.whitening(reference, problem.objective, candidates.names)
        return cls(problem, coordinates, coordinates.objective(problem.objective), base, units)

    @property
    def batch(self) -> int:
        """How many candidates an active set begins with, and how many a round adds."""
        each = _BATCH if self.objective.smooth else _BATCH_NOT_SMOOTH
        return each * self.parameters

    @property
    def parameters(self) -> int:
        """Number p of parameters."""
        return len(self.problem.candidates.names)

    @property
    def closed(self) -> BoolArray:
        """Which weights cannot move, (Q,)."""
        return self.problem.allowed.upper <= self.problem.allowed.lower

    def inner(self, active: IntArray) -> tuple[InnerProblem, Array]:
        """Return the problem over the active candidates, and what its rows were divided by."""
        allowed, units = self.problem.allowed, self.units[active]
        rows = allowed.rows[:, active] * units
        bounds = allowed.room
        scales = np.maximum(np.abs(rows).max(axis=1), np.abs(bounds))
        scales = np.where(scales > 0, scales, 1.0)
        rows, bounds = rows / scales[:, None], bounds / scales
        caps = (allowed.upper - allowed.lower)[active] / units
        # The budget alone keeps shares below one.
        capped = np.flatnonzero(caps < 1.0)
        unit = np.eye(len(active))[capped]
        inner = InnerProblem(
            self.objective,
            self._white_base(),
            self._white(active),
            np.concatenate([rows, unit]),
            np.concatenate([bounds, caps[capped]]),
        )
        return inner, scales

    def first_active(self) -> IntArray:
        """Return some candidates of largest trace that determine everything and obey the rows."""
        allowed, K = self.problem.allowed, len(self.base)
        price = self._prices([np.eye(len(T)) for T in self.coordinates.transforms])
        active = self.distinct(largest(price, 2 * self.batch), self.batch)
        if len(allowed.rows) > 1 or np.isfinite(allowed.upper).any():
            vertex = allowed.best(np.where(self.closed, 0.0, price) / self.units)[0]
            more = np.flatnonzero((vertex > allowed.lower) & ~self.closed)
            active = np.union1d(active, more)
        open_count = int((~self.closed).sum())
        while len(active) < open_count:
            pairs = zip(self._white_base(), self._white(active), strict=True)
            mean = [base + H.mean(axis=0) for base, H in pairs]
            if min(np.linalg.eigvalsh(M)[0] for M in mean) > _WEAKEST:
                break
            # What the chosen ones leave open is priced highest.
            price = self._prices([np.linalg.inv(M + _WEAKEST * np.eye(len(M))) / K for M in mean])
            price[active] = -np.inf
            active = np.concatenate([active, largest(price, max(self.batch // 4, 1))])
        return np.asarray(active)

    def distinct(self, indices: IntArray, count: int) -> IntArray:
        """Return the first `count` candidates of `indices` without equals among them.

        Equal candidates only spread weight, but where each has a limit they are needed.
        """
        allowed = self.problem.allowed
        if np.isfinite((allowed.upper - allowed.lower)[indices]).any():
            return indices[:count]
        rows = allowed.rows[1:, indices] * self.units[indices]
        sizes = np.maximum(np.abs(rows).max(axis=1, initial=0.0), 1e-300)
        parts = [H.reshape(len(indices), -1) for H in self._white(indices)]
        kept = distinct(np.concatenate([*parts, (rows / sizes[:, None]).T], axis=1))
        return np.asarray(indices[kept[:count]])

    def _white(self, indices: IntArray) -> tuple[Array, ...]:
        """Return some candidates' information for a share of one, (n, r, r) for each sample."""
        H = self.problem.candidates.take(indices)
        p = H.shape[-1]
        stack = H.reshape(len(H), -1, p, p) * self.units[indices, None, None, None]
        return self.coordinates.matrices(np.asarray(stack))

    def _white_base(self) -> tuple[Array, ...]:
        return tuple(matrix[0] for matrix in self.coordinates.matrices(self.base[None]))

    def _prices(self, white: Sequence[Array]) -> Array:
        """Return what a share of each candidate is worth, (Q,), -inf where there is no room."""
        pairs = zip(self.coordinates.transforms, white, strict=True)
        weight = np.stack([T.T @ W @ T for T, W in pairs])
        candidates = self.problem.candidates
        prices = candidates.prices(weight if candidates.samples > 1 else weight[0]) * self.units
        return np.asarray(np.where(self.closed, -np.inf, prices))


def _samples(information: Array) -> Array:
    return information if information.ndim == 3 else information[None]
