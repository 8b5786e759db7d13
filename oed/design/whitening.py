"""Scaling of a design problem to order one, and its restriction to a few candidates."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from oed.criteria.objective import Objective
from oed.design.coordinates import Coordinates
from oed.design.problem import DesignProblem, ScaledProblem
from robotmodels.common.arrays import Array, BoolArray, IntArray

# An active set must determine every direction at least this well beside all candidates.
_WEAKEST = 1e-6
# Candidates to begin with, and to add in a round, for each parameter: more make the small problems
# larger, fewer take more passes over all candidates.
_BATCH = 4
# Room of a row, of its scale, below which it is an equation.
_TIGHT = 1e-6


@dataclass(frozen=True, eq=False)
class Whitening:
    """The map between a problem and white problems over a few candidates.

    Their variables are shares of the budget beyond the lower weights.

    Attributes
    ----------
    problem : DesignProblem
        As it is.
    coordinates : Coordinates
        Coordinates in which information is of order one.
    objective : Objective
        Objective in these coordinates.
    constant : float
        What its log value lacks to the problem's.
    base : tuple of ndarray
        Base for each sample, (r, r), information of the lower weights and the prior.
    units : ndarray, (Q,)
        What a share of one means for the weight.
    bounds, interior : ndarray, (m,)
        Of the rows, beyond the lower weights, and shares (Q,) that leave room.
    """

    problem: DesignProblem
    coordinates: Coordinates
    objective: Objective
    constant: float
    base: tuple[Array, ...]
    units: Array
    bounds: Array
    interior: Array

    @classmethod
    def of(cls, problem: DesignProblem) -> "Whitening":
        """Return the map, after the rank check.

        Raises
        ------
        NotIdentifiable
            Naming the parameters that all candidates together leave open.
        """
        allowed, candidates = problem.allowed, problem.candidates
        room = max(float(allowed.slack[0]), 1e-12 * float(allowed.bounds[0]))
        units = room / allowed.rows[0]
        usable = allowed.upper > allowed.lower
        equal = np.where(usable, units, 0.0) / max(int(usable.sum()), 1)
        base = _samples(problem.information(allowed.lower))
        reference = base + _samples(candidates.combined(equal))
        coordinates = Coordinates.whitening(reference, problem.objective, candidates.names)
        white = tuple(matrix[0] for matrix in coordinates.matrices(base[None]))
        bounds, interior = allowed.interior(units)
        objective, constant = coordinates.objective(problem.objective)
        return cls(problem, coordinates, objective, constant, white, units, bounds, interior)

    @property
    def batch(self) -> int:
        """How many candidates an active set begins with, and how many a round adds."""
        return _BATCH * len(self.problem.candidates.names)

    @property
    def closed(self) -> BoolArray:
        """Which weights cannot move, (Q,)."""
        return self.problem.allowed.upper <= self.problem.allowed.lower

    def few(self, active: IntArray) -> ScaledProblem:
        """Return the problem over the active candidates."""
        allowed, units = self.problem.allowed, self.units[active]
        rows, scales = allowed.rows[:, active] * units, self.row_scales(active)
        rows, bounds = rows / scales[:, None], self.bounds / scales
        caps = (allowed.upper - allowed.lower)[active] / units
        # The budget alone keeps shares below one.
        caps = np.where(caps < 1.0, caps, np.inf)
        start = _inside(rows, bounds, caps, self.interior[active])
        return ScaledProblem(
            self.objective, self.base, self.white(active), rows, bounds, caps, start
        )

    def row_scales(self, active: IntArray) -> Array:
        """Return what the rows over the active candidates are divided by, (m,)."""
        rows = self.problem.allowed.rows[:, active] * self.units[active]
        scales = np.maximum(np.abs(rows).max(axis=1), np.abs(self.bounds))
        return np.asarray(np.where(scales > 0, scales, 1.0))

    def weights(self, active: IntArray, shares: Array) -> Array:
        """Return weights (Q,) of the active candidates' shares (n,)."""
        weights = self.problem.allowed.lower.copy()
        weights[active] += shares * self.units[active]
        return weights

    def first_active(self) -> IntArray:
        """Return some candidates of largest trace that determine everything and obey the rows."""
        allowed, K = self.problem.allowed, len(self.base)
        derivatives = self.directional_derivatives([np.eye(len(M)) for M in self.base])
        active = self.distinct(largest(derivatives, 2 * self.batch), self.batch)
        if len(allowed.rows) > 1 or np.isfinite(allowed.upper).any():
            vertex = allowed.best_extreme_point(
                np.where(self.closed, 0.0, derivatives) / self.units
            )[0]
            needed = ((vertex > allowed.lower) | (self.interior > 0)) & ~self.closed
            active = np.union1d(active, np.flatnonzero(needed))
        open_count = int((~self.closed).sum())
        while len(active) < open_count and not self.determined(active):
            # Candidates that inform on the directions still open have the largest derivatives.
            mean = self._mean(active)
            derivatives = self.directional_derivatives(
                [np.linalg.inv(M + _WEAKEST * np.eye(len(M))) / K for M in mean]
            )
            derivatives[active] = -np.inf
            active = np.concatenate([active, largest(derivatives, max(self.batch // 4, 1))])
        return np.asarray(active)

    def determined(self, active: IntArray) -> bool:
        """Return whether the active candidates determine every direction well enough."""
        return min(float(np.linalg.eigvalsh(M)[0]) for M in self._mean(active)) > _WEAKEST

    def _mean(self, active: IntArray) -> list[Array]:
        pairs = zip(self.base, self.white(active), strict=True)
        return [base + H.mean(axis=0) for base, H in pairs]

    def distinct(self, indices: IntArray, count: int) -> IntArray:
        """Return the first `count` candidates of `indices` without equals among them.

        Equal candidates only spread weight, but where each has a limit they are needed.
        """
        allowed = self.problem.allowed
        if np.isfinite((allowed.upper - allowed.lower)[indices]).any():
            return indices[:count]
        rows = allowed.rows[1:, indices] * self.units[indices]
        sizes = np.maximum(np.abs(rows).max(axis=1, initial=0.0), 1e-300)
        parts = [H.reshape(len(indices), -1) for H in self.white(indices)]
        first = distinct(np.concatenate([*parts, (rows / sizes[:, None]).T], axis=1))
        return np.asarray(indices[first[:count]])

    def white(self, indices: IntArray) -> tuple[Array, ...]:
        """Return some candidates' information for a share of one, (n, r, r) for each sample."""
        H = self.problem.candidates.take(indices)
        p = H.shape[-1]
        stack = H.reshape(len(H), -1, p, p) * self.units[indices, None, None, None]
        return self.coordinates.matrices(np.asarray(stack))

    def directional_derivatives(self, white: Sequence[Array]) -> Array:
        """Return tr(W_k H_ik) of a share of each candidate, summed over samples k, (Q,).

        -inf where the weight cannot grow.
        """
        pairs = zip(self.coordinates.transforms, white, strict=True)
        weight = np.stack([T.T @ W @ T for T, W in pairs])
        candidates = self.problem.candidates
        derivatives: Array = (
            candidates.directional_derivatives(weight if len(weight) > 1 else weight[0])
            * self.units
        )
        derivatives[self.closed] = -np.inf
        return derivatives


def _inside(rows: Array, bounds: Array, caps: Array, inside: Array) -> Array:
    """Return positive shares with room in every row, beside shares (n,) that may be zero.

    They lie half way to equal ones, as far as there is room. Equations, rows that leave hardly any,
    are kept by changing the larger shares, unless a smaller one would vanish.
    """
    equal: Array = np.minimum(0.9 / rows.shape[1], 0.5 * caps)
    if len(rows) == 1:
        return equal
    room, straight = bounds - rows @ inside, equal - inside
    tight = rows[room < _TIGHT]
    scale = np.maximum(inside, 1e-3 * equal)
    turn = scale * np.linalg.lstsq(tight * scale, tight @ straight, rcond=1e-12)[0]
    for step in (straight - turn, straight):
        values = np.concatenate([room, inside, caps - inside])
        moves = np.concatenate([rows @ step, -step, step])
        falling = moves > 0
        longest = float(np.min(values[falling] / moves[falling], initial=1.0))
        shares: Array = inside + 0.5 * longest * step
        if shares.min() > 0:
            break
    return shares


def _samples(information: Array) -> Array:
    return information if information.ndim == 3 else information[None]


# In whitened coordinates matrices are of order one; equal ones differ by rounding only.
_DUPLICATE = 1e-9


def distinct(flat: Array) -> IntArray:
    """Return the index of the first of each group of equal rows of (n, k)."""
    # Equal rows have equal projections: only neighbours in this order need comparing.
    direction = np.random.default_rng(0).standard_normal(flat.shape[1])
    keys = flat @ (direction / np.linalg.norm(direction))
    order = np.argsort(keys, kind="stable")
    separated = np.diff(keys[order]) > _DUPLICATE * np.sqrt(flat.shape[1])
    single = np.append(True, separated) & np.append(separated, True)
    first: list[int] = order[single].tolist()
    near = order[~single]
    for group in np.split(near, np.flatnonzero(np.append(True, separated)[~single])[1:]):
        remaining = np.sort(group)
        while len(remaining):
            first.append(int(remaining[0]))
            differs = np.abs(flat[remaining] - flat[remaining[0]]).max(axis=1) > _DUPLICATE
            remaining = remaining[differs]
    return np.sort(np.array(first))


def largest(values: Array, count: int) -> IntArray:
    """Return the indices of the largest finite values, largest first; equal ones in order."""
    count = min(count, int((values > -np.inf).sum()))
    if count == 0:
        return np.zeros(0, dtype=np.int64)
    some = np.argpartition(-values, count - 1)[:count]
    # Of equal values at the end the partition takes any; here the first ones count.
    last = values[some].min()
    above = np.flatnonzero(values > last)
    ties = np.flatnonzero(values == last)[: count - len(above)]
    some = np.concatenate([above, ties])
    return np.asarray(some[np.argsort(-values[some], kind="stable")])
