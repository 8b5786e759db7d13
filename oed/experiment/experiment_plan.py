"""The experiment plan: where the robot goes, and what it is told there."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from oed.experiment.crest import reduced_crest
from oed.experiment.moves import Move, MoveLimits, move
from oed.experiment.multisine import Multisine, random_phases
from oed.experiment.visiting_order import VisitingOrder, visiting_order
from robotmodels.common.arrays import Array, IntArray, read_only
from robotmodels.common.errors import InvalidInput
from robotmodels.common.progress import Progress


class Planned(Protocol):
    """A robot that can be told where to go."""

    @property
    def name(self) -> str:
        """Its name."""
        ...

    @property
    def motor_names(self) -> Sequence[str]:
        """Names of the n motors."""
        ...

    @property
    def position_limits(self) -> Array:
        """Lowest and highest position of each, (n, 2)."""
        ...


@dataclass(frozen=True, eq=False)
class ExperimentPlan:
    """Visits to positions, in the order given; in each, blocks of n runs.

    A position with r repetitions is visited r times in a row. A visit has B blocks of n
    runs each; a run repeats one period of the reference, first until transients
    have died out, then as often as is measured. Every visit and every block has phases of its own.

    Attributes
    ----------
    robot : str
        Its name.
    positions : ndarray, (Q, n), rad
        Positions.
    repetitions : ndarray of int, (Q,)
        Visits to each.
    multisine : Multisine
        Lines and amplitudes of the speed reference [rad/s, motor shaft].
    phases : ndarray, (V, B, F, n), rad
        V the sum of the repetitions.
    periods : int
        Measured per run.
    transient_periods : int
        Transient periods before them.
    moves : MoveLimits
        Limits of the moves between positions, and the motors' names.
    scale : ndarray, (V,)
        Factors of the amplitudes.
    start : ndarray or None, (n,), rad
        Where the robot is before the first move; the first position by default.
    order : VisitingOrder or None
        How the positions were put in order and what that saves; None if they are as given.

    Raises
    ------
    InvalidInput
        If a position lies outside the limits, a number of periods or repetitions is too small, or
        shapes do not fit each other.
    """

    robot: str
    positions: Array
    repetitions: IntArray
    multisine: Multisine
    phases: Array
    periods: int
    transient_periods: int
    moves: MoveLimits
    scale: Array
    start: Array | None = None
    order: VisitingOrder | None = None

    def __post_init__(self) -> None:
        positions = self.moves.check(self.positions)
        repetitions = _checked_repetitions(self.repetitions, len(positions))
        for name, least in (("periods", 1), ("transient_periods", 0)):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < least:
                raise InvalidInput(f"{name}: {value!r}; a whole number >= {least} is needed")
        n, visits = len(self.moves.motors), int(repetitions.sum())
        if self.multisine.inputs != n:
            raise InvalidInput(
                f"multisine: {self.multisine.inputs} inputs; the robot has {n} motors"
            )
        phases = np.array(self.phases, dtype=float)
        shape = (len(self.multisine.lines), n)
        if phases.ndim != 4 or len(phases) != visits or phases.shape[2:] != shape:
            raise InvalidInput(
                f"phases: shape {phases.shape}; ({visits}, blocks, {shape[0]}, {shape[1]}) is "
                "needed: visits, blocks, lines, motors"
            )
        if phases.shape[1] < 1:
            raise InvalidInput("blocks: none given; at least 1 is needed")
        scale = np.array(self.scale, dtype=float)
        if scale.shape != (visits,) or not (np.isfinite(scale) & (scale > 0)).all():
            raise InvalidInput(f"scale: {visits} positive numbers, one per visit, are needed")
        start = positions[0] if self.start is None else self.start
        start = self.moves.check(np.atleast_2d(start), "start")[0]
        for name, array in (
            ("positions", positions),
            ("repetitions", repetitions),
            ("phases", phases),
            ("scale", scale),
            ("start", start),
        ):
            object.__setattr__(self, name, read_only(array))

    @property
    def motors(self) -> tuple[str, ...]:
        """Names of the n motors."""
        return self.moves.motors

    @property
    def blocks(self) -> int:
        """Number B of blocks per visit."""
        return int(self.phases.shape[1])

    @property
    def visits(self) -> IntArray:
        """Index of the position of each visit, (V,)."""
        return np.repeat(np.arange(len(self.positions)), self.repetitions)

    @property
    def visited(self) -> Array:
        """The position of each visit, (V, n) [rad]."""
        return np.asarray(self.positions[self.visits])

    def reference(self, visit: int) -> Array:
        """Return one period of the signals of a visit, (B, E, N, n) [rad/s, motor shaft]."""
        return np.asarray(self.scale[visit] * self.multisine.reference(self.phases[visit]))

    @property
    def signals(self) -> Array:
        """The references of all visits, (V, B, E, N, n) [rad/s, motor shaft]; it may be large."""
        return np.array([self.reference(visit) for visit in range(len(self.phases))])

    def move_to(self, visit: int) -> Move:
        """Return the move that leads to a visit; without samples where the robot is there."""
        first = self.positions[0] if self.start is None else self.start
        before = first if visit == 0 else self.visited[visit - 1]
        return move(before, self.visited[visit], self.moves, self.multisine.sample_time)

    @property
    def excitation_duration(self) -> float:
        """Time under excitation, transients included [s]."""
        periods = len(self.phases) * self.blocks * self.multisine.inputs
        return periods * (self.periods + self.transient_periods) * self.multisine.period

    @property
    def duration(self) -> float:
        """Time of it all, moves included [s]."""
        moves = sum(self.move_to(visit).duration for visit in range(len(self.phases)))
        return self.excitation_duration + moves

    def rescaled(self, factors: Array) -> "ExperimentPlan":
        """Return the plan with the amplitudes of each visit times a factor, (V,) or a number."""
        return replace(self, scale=self.scale * np.asarray(factors, dtype=float))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a YAML file and, beside it, an HDF5 file; see `oed.experiment.plan_files`."""
        from oed.experiment.plan_files import save_plan

        save_plan(self, path)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "ExperimentPlan":
        """Read what `save` wrote; errors are those of `oed.experiment.plan_files.load_plan`."""
        from oed.experiment.plan_files import load_plan

        return load_plan(path)


def experiment_plan(
    robot: Planned,
    positions: Array,
    multisine: Multisine,
    *,
    blocks: int,
    periods: int,
    transient_periods: int = 1,
    speed: float | Sequence[float] | Array,
    acceleration: float | Sequence[float] | Array,
    rng: np.random.Generator,
    repetitions: Sequence[int] | IntArray | None = None,
    crest_iterations: int = 0,
    start: Sequence[float] | Array | None = None,
    reorder: bool = False,
    progress: Progress | None = None,
) -> ExperimentPlan:
    """Draw the phases of a plan; the same `rng` gives the same plan.

    Parameters
    ----------
    robot : Planned
        Gives name, motors and position limits.
    positions : ndarray, (Q, n), rad
        Positions in the order in which to go there.
    multisine : Multisine
        Lines and amplitudes.
    blocks : int
        B per visit; the covariance of an FRF needs at least 2.
    periods, transient_periods : int
        Measured per run, and before that.
    speed, acceleration : float, sequence of float or ndarray
        Largest ones of moves, arm side, (n,) or one number for all motors.
    rng : Generator
        Draws the phases.
    repetitions : sequence of int or ndarray of int, (Q,), optional
        Visits to each position; one by default.
    crest_iterations : int
        How often to clip in order to lower crest factors (200 does most of it); 0 leaves the phases
        as drawn.
    start : sequence of float or ndarray, (n,), rad, optional
        Where the robot is beforehand.
    reorder : bool
        Visit the positions in the order that shortens the moves from `start` on, see
        `visiting_order`; `order` of the plan tells it, and the time saved.
    progress : Progress, optional
        Called with the number of visits done and their total.

    Raises
    ------
    InvalidInput
        As `ExperimentPlan`, `MoveLimits` and `oed.random_phases`.
    """
    motors = tuple(robot.motor_names)
    moves = MoveLimits(motors, robot.position_limits, np.asarray(speed), np.asarray(acceleration))
    positions = moves.check(positions)
    given = np.ones(len(positions), dtype=np.int64) if repetitions is None else repetitions
    counts = _checked_repetitions(given, len(positions))
    begin = None if start is None else np.asarray(start, dtype=float)
    order = visiting_order(positions, moves, begin) if reorder else None
    if order is not None:
        positions, counts = positions[order.order], counts[order.order]
    visits = int(counts.sum())
    return ExperimentPlan(
        robot=robot.name,
        positions=positions,
        repetitions=counts,
        multisine=multisine,
        phases=_phases(multisine, visits, blocks, crest_iterations, rng, progress),
        periods=periods,
        transient_periods=transient_periods,
        moves=moves,
        scale=np.ones(visits),
        start=begin,
        order=order,
    )


def _phases(
    multisine: Multisine,
    visits: int,
    blocks: int,
    crest_iterations: int,
    rng: np.random.Generator,
    progress: Progress | None,
) -> Array:
    """Draw phases for each visit, (V, B, F, n), and lower their crest factors."""
    phases = []
    for visit in range(visits):
        drawn = random_phases(multisine, blocks, rng=rng)
        phases.append(reduced_crest(multisine, drawn, crest_iterations))
        if progress is not None:
            progress(visit + 1, visits)
    return np.array(phases)


def _checked_repetitions(given: Sequence[int] | IntArray, n_positions: int) -> IntArray:
    array = np.asarray(given)
    if array.shape != (n_positions,):
        raise InvalidInput(
            f"repetitions: shape {array.shape} given; ({n_positions},), one per position, is needed"
        )
    for i, value in enumerate(array):
        if value != round(float(value)) or value < 1:
            raise InvalidInput(
                f"repetitions of position {i}: {value}; a whole number >= 1 is needed, "
                "leave out a position that is not to be visited"
            )
    return array.astype(np.int64)
