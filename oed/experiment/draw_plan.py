"""An experiment plan drawn: phases of every visit, low crest factors, a short way round."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from scipy.fft import next_fast_len

from oed.experiment.experiment_plan import ExperimentPlan, checked_repetitions
from oed.experiment.moves import MoveLimits
from oed.experiment.multisine import Multisine, random_phases
from oed.experiment.visiting_order import visiting_order
from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.errors import InvalidInput
from robotmodels.common.progress import Progress, tell


class Planned(Protocol):
    """A robot that can be told where to go."""

    @property
    def name(self) -> str:
        """Its name."""

    @property
    def motor_names(self) -> Sequence[str]:
        """Names of the n motors."""

    @property
    def position_limits(self) -> Array:
        """Lowest and highest position of each, (n, 2)."""


def experiment_plan(
    robot: Planned,
    positions: Array,
    multisine: Multisine,
    *,
    blocks: int,
    periods: int,
    transient_periods: int = 1,
    ramp: bool = False,
    speed: float | Sequence[float] | Array,
    acceleration: float | Sequence[float] | Array,
    rng: np.random.Generator,
    repetitions: Sequence[int] | IntArray | None = None,
    crest_iterations: int = 0,
    start: Sequence[float] | Array | None = None,
    reorder: bool = False,
    runs: int = 0,
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
    ramp : bool
        Whether the first transient period rises from zero: without the jerk of a sudden start the
        limits allow larger amplitudes.
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
    runs : int
        Of a block; 0 for as many as motors.
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
    once = np.ones(len(positions), dtype=np.int64)
    counts = checked_repetitions(once if repetitions is None else repetitions, len(positions))
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
        ramp=ramp,
        runs=runs,
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
        tell(progress, visit + 1, visits)
    return np.array(phases)


# Points per period of the highest line; clipping sees peaks to a few percent, which is enough.
_POINTS = 10
# Clipping at this part of the peak, rising to 1, is slow enough not to get stuck.
_FIRST_CLIP, _LAST_CLIP = 0.75, 0.98


def reduced_crest(grid: Multisine, phases: Array, iterations: int = 200) -> Array:
    """Return phases, (B, F, n), near `phases` with lower peaks over all runs.

    Parameters
    ----------
    grid : Multisine
        Lines and amplitudes, which stay as they are.
    phases : ndarray, (B, F, n)
        Where to start; the outcome depends on nothing else.
    iterations : int
        How often to clip.

    Raises
    ------
    InvalidInput
        If `iterations` is negative or the phases have a wrong shape.
    """
    if iterations < 0:
        raise InvalidInput(f"crest_iterations: {iterations}; a number >= 0 is needed")
    shape = (len(grid.lines), grid.inputs)
    if phases.ndim != 3 or phases.shape[1:] != shape:
        raise InvalidInput(f"phases: shape {phases.shape}; (B, {shape[0]}, {shape[1]}) is needed")
    lowered = np.array(phases, dtype=float)
    for i in range(grid.inputs):
        lowered[:, :, i] = _clipped(grid, lowered[:, :, i], i, iterations)
    return lowered


def _clipped(grid: Multisine, phases: Array, motor: int, iterations: int) -> Array:
    """Return the lowest of `iterations` clippings of one input's phases, (B, F)."""
    turns = _turns(motor, grid.inputs)
    amplitudes = grid.amplitudes[:, motor] / np.linalg.norm(grid.amplitudes[:, motor])
    points = next_fast_len(max(_POINTS * int(grid.lines[-1]), 64), real=True)
    best, lowest = phases.copy(), np.full(len(phases), np.inf)
    levels = np.linspace(_FIRST_CLIP, _LAST_CLIP, iterations)
    for level in [*levels, None]:
        spectrum = np.zeros((len(phases), len(turns), points // 2 + 1), dtype=complex)
        lines = amplitudes * np.exp(1j * phases)
        spectrum[:, :, grid.lines] = turns[:, None] * lines[:, None, :]
        signal = np.fft.irfft(spectrum, points)
        peak = np.abs(signal).max(axis=(1, 2))
        better = peak < lowest
        best[better], lowest[better] = phases[better], peak[better]
        if level is not None:
            limit = level * peak[:, None, None]
            after = np.fft.rfft(np.clip(signal, -limit, limit))[:, :, grid.lines]
            phases = np.angle(np.einsum("e,bef->bf", turns.conj(), after))
    return np.asarray(best % (2 * np.pi))


def _turns(motor: int, inputs: int) -> Array:
    """Return the turns e^{2 pi j i l / n} of input i that differ by more than a sign."""
    steps = {(2 * motor * run) % inputs for run in range(inputs)}
    return np.asarray(np.exp(1j * np.pi * np.array(sorted(steps)) / inputs))
