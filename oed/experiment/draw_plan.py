"""An experiment plan drawn: phases of every visit, low crest factors, a short way round."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from oed.experiment.crest import reduced_crest
from oed.experiment.experiment_plan import ExperimentPlan, checked_repetitions
from oed.experiment.moves import MoveLimits
from oed.experiment.multisine import Multisine, random_phases
from oed.experiment.visiting_order import visiting_order
from robotmodels.common.arrays import Array, IntArray
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
    counts = checked_repetitions(given, len(positions))
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
