"""Constraints of a design: experiments, time, positions, groups of them, and linear rows."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from oed.design.polytope import Polytope
from robotmodels.common.arrays import Array, check_above_zero, real_numbers
from robotmodels.common.errors import InvalidInput


@dataclass(frozen=True, eq=False)
class Group:
    """Limits on the experiments in some positions together.

    Attributes
    ----------
    members : sequence of int
        Indices of candidates.
    most, least : float
        Experiments.
    """

    members: Sequence[int]
    most: float = np.inf
    least: float = 0.0


@dataclass(frozen=True, eq=False)
class Constraints:
    """Limits on the weights, which then are experiments for each candidate position.

    Attributes
    ----------
    experiments : float or None
        How many in all; without it and without a time, weights are shares of one.
    time : float or None, s
        How long all experiments may take together.
    durations : array_like or None, s
        Durations of one experiment, for each candidate or for all: what is measured and the move to
        it. Needed with `time`. Moves between repetitions in one position are counted as well, so a
        plan with repetitions takes less than this.
    most : array_like or None
        Experiments in one position, for each candidate or for all.
    mandatory : mapping of int to float
        Least experiments in these candidates.
    forbidden : sequence of int
        Candidates that must not be used.
    groups : mapping of str to Group
        Limits on positions together, by name.
    linear : mapping of str to tuple of (array_like, float)
        Linear rows a'w <= b of the user, by name: a of shape (Q,), and b.
    """

    experiments: float | None = None
    time: float | None = None
    durations: ArrayLike | None = None
    most: ArrayLike | None = None
    mandatory: Mapping[int, float] = field(default_factory=dict)
    forbidden: Sequence[int] = ()
    groups: Mapping[str, Group] = field(default_factory=dict)
    linear: Mapping[str, tuple[ArrayLike, float]] = field(default_factory=dict)

    def polytope(self, n_candidates: int) -> Polytope:
        """Return the allowed weights of so many candidates.

        Raises
        ------
        InvalidInput
            Naming the constraint that does not fit, or those that conflict.
        """
        rows: list[tuple[str, Array, float]] = list(self._budgets(n_candidates))
        for name, group in self.groups.items():
            indicator = np.zeros(n_candidates)
            indicator[_indices(group.members, n_candidates, f"groups: {name}")] = 1.0
            if group.most < np.inf:
                rows.append((f"groups: {name} (most {group.most:g})", indicator, group.most))
            if group.least > 0:
                rows.append((f"groups: {name} (least {group.least:g})", -indicator, -group.least))
        for name, (coefficients, bound) in self.linear.items():
            a = _per_candidate(coefficients, n_candidates, f"linear: {name}")
            if not np.isfinite(bound):
                raise InvalidInput(f"constraints: linear: {name}: bound {bound!r} is not a number")
            rows.append((f"linear: {name}", a, float(bound)))
        allowed = Polytope(
            np.stack([row for _, row, _ in rows]),
            np.array([bound for _, _, bound in rows]),
            *self._limits(n_candidates),
            tuple(name for name, _, _ in rows),
        )
        self._check(allowed)
        return allowed

    def _budgets(self, n: int) -> list[tuple[str, Array, float]]:
        rows = []
        if self.experiments is not None or self.time is None:
            total = 1.0 if self.experiments is None else self.experiments
            check_above_zero(total, "constraints: experiments")
            rows.append((f"experiments ({total:g})", np.ones(n), float(total)))
        if self.time is not None:
            check_above_zero(self.time, "constraints: time")
            if self.durations is None:
                raise InvalidInput("constraints: time needs durations, seconds for each experiment")
            durations = _per_candidate(self.durations, n, "durations")
            if not (durations > 0).all():
                i = int(np.argmin(durations))
                raise InvalidInput(
                    f"constraints: durations: {durations[i]:g} s of candidate {i} is not > 0"
                )
            rows.append((f"time ({self.time:g} s)", durations, float(self.time)))
        return rows

    def _limits(self, n: int) -> tuple[Array, Array]:
        lower, upper = np.zeros(n), np.full(n, np.inf)
        if self.most is not None:
            upper = _per_candidate(self.most, n, "most", infinite=True).copy()
            if not (upper >= 0).all():
                raise InvalidInput("constraints: most: numbers >= 0 are needed")
        for index, least in self.mandatory.items():
            lower[_indices([index], n, "mandatory")] = least
            if not 0 <= least < np.inf:
                raise InvalidInput(f"constraints: mandatory: {least!r} experiments; >= 0 needed")
        forbidden = _indices(self.forbidden, n, "forbidden")
        upper[forbidden] = 0.0
        wrong = np.flatnonzero(lower > upper)
        if len(wrong):
            i = int(wrong[0])
            raise InvalidInput(
                f"constraints: candidate {i}: mandatory {lower[i]:g} experiments, but "
                + ("it is forbidden" if i in forbidden else f"most is {upper[i]:g}")
            )
        return lower, upper

    def _check(self, allowed: Polytope) -> None:
        """Refuse what no design can satisfy."""
        if self.mandatory and allowed.slack[0] < 0:
            raise InvalidInput(
                f"constraints: mandatory experiments do not fit into {allowed.names[0]}"
            )
        possible = float(allowed.upper.sum())
        if self.experiments is not None and possible < self.experiments * (1 - 1e-9):
            raise InvalidInput(
                f"constraints: experiments ({self.experiments:g}): most and forbidden leave room "
                f"for {possible:g}"
            )
        if len(allowed.rows) > 1:
            allowed.best_extreme_point(np.zeros(len(allowed.lower)))


def _per_candidate(values: ArrayLike, n: int, what: str, infinite: bool = False) -> Array:
    array = real_numbers(values, f"constraints: {what}")
    if array.ndim == 0:
        array = np.full(n, float(array))
    if array.shape != (n,) or np.isnan(array).any() or not (infinite or np.isfinite(array).all()):
        raise InvalidInput(
            f"constraints: {what}: shape {array.shape}; one number, or one for each of {n} "
            "candidates, is needed"
        )
    return array


def _indices(members: Sequence[int], n: int, what: str) -> list[int]:
    """Return candidates' indices, refusing those there are not."""
    for index in members:
        if not (isinstance(index, (int, np.integer)) and 0 <= index < n):
            raise InvalidInput(f"constraints: {what}: candidate {index!r} is not in 0..{n - 1}")
    return [int(index) for index in members]
