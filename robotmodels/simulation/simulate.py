"""A simulated robot under closed-loop control: MuJoCo's dynamics with all that spoils an FRF."""

from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.errors import InvalidInput
from robotmodels.common.progress import Progress
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.records.records import Records, check_periods
from robotmodels.simulation.controller import Controller
from robotmodels.simulation.imperfections import IDEAL, Imperfections

if TYPE_CHECKING:
    from robotmodels.simulation.simulate_block import Block


def simulate(
    robot: ElasticRobot,
    positions: Array,
    signals: Array,
    controller: Controller,
    *,
    lines: IntArray,
    detection: IntArray | None = None,
    imperfections: Imperfections = IDEAL,
    rng: np.random.Generator,
    periods: int = 2,
    transient: int = 1,
    envelope: Array | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> Iterator[Records]:
    """Simulate periodic runs; yield the records of one position after the other.

    Every run starts at rest in the position's equilibrium.

    Parameters
    ----------
    robot : ElasticRobot
        The robot; all of its outputs are recorded.
    positions : ndarray, (Q, n), rad
        Positions.
    signals : ndarray, (B, E, N, n), or (Q, B, E, N, n), rad/s
        One period of the speed references.
    controller : Controller
        Its sample time is that of the signals.
    lines : ndarray of int
        Excited DFT lines of the signals, noted in the records.
    detection : ndarray of int, optional
        Lines that are left out on purpose, noted in the records.
    imperfections : Imperfections
        Friction, backlash, sensors, disturbances; by default none.
    rng : Generator
        The same seed gives the same records, in parallel or not.
    periods, transient : int
        Periods recorded, and periods before them that are dropped.
    envelope : ndarray, (N,), optional
        Factors of the samples of the first period of each run, which must be one that is dropped.
    executor : Executor, optional
        Simulates blocks in parallel; threads serve as well as processes.
    progress : Progress, optional
        Called with the number of blocks done and their total.

    Raises
    ------
    InvalidInput
        If shapes do not fit, or a position is outside the joint limits.
    NoEquilibrium
        If the springs cannot carry the robot's weight in a position.
    SolverFailed
        If a closed loop is unstable, naming position, block and run.
    """
    # Imported when used: MuJoCo and numba take a second, and most sessions simulate nothing.
    from robotmodels.simulation.simulate_block import Block

    positions = np.asarray(positions, dtype=float)
    robot.equilibrium(positions)  # refuses positions at which nothing can be simulated
    signals = _check_signals(robot, positions, signals, controller)
    check_periods(periods, transient)
    envelope = _check_envelope(envelope, signals.shape[-2], transient)
    for name in ("backlash", "angle_noise", "torque_disturbance", "torque_limit"):
        imperfections.per_motor(name, positions.shape[1])
    imperfections.per_motor("output_noise", len(robot.outputs), "output")
    # With none named all are excited, as by random signals.
    line = max(np.asarray(lines), default=signals.shape[-2] // 2)
    highest = float(2 * np.pi * line / (signals.shape[-2] * controller.sample_time))
    blocks_of_positions = list(product(range(len(positions)), range(signals.shape[1])))
    blocks = [
        Block(
            robot,
            positions[i],
            signals[i, b],
            controller,
            imperfections,
            seed,
            transient,
            periods,
            envelope,
            highest,
            f"position {i + 1}, block {b + 1}",
        )
        for (i, b), seed in zip(
            blocks_of_positions, rng.spawn(len(blocks_of_positions)), strict=True
        )
    ]
    blank = _blank(positions, signals, controller, lines, detection)
    return _positions(blocks, blank, executor, progress)


def _blank(
    positions: Array,
    signals: Array,
    controller: Controller,
    lines: IntArray,
    detection: IntArray | None,
) -> Records:
    """Return records of one position with the references as the measured signals."""
    return Records(
        positions=positions[:1],
        sample_time=controller.sample_time,
        reference=signals[:1, :, :, None],
        torque=signals[:1, :, :, None],
        angle=signals[:1, :, :, None],
        lines=lines,
        detection=np.array([], dtype=np.int64) if detection is None else detection,
        saturated=np.zeros((1, *signals.shape[1:3], 1, signals.shape[-1]), dtype=bool),
    )


def _positions(
    blocks: "list[Block]",
    blank: Records,
    executor: Executor | None,
    progress: Progress | None,
) -> Iterator[Records]:
    """Run the blocks; yield a position's records, shaped after `blank`, when it is complete."""
    from robotmodels.simulation.simulate_block import run_block

    per_position = blank.torque.shape[1]
    done: list[tuple[Array, Array, NDArray[np.bool_]]] = []
    results = map(run_block, blocks) if executor is None else executor.map(run_block, blocks)
    for count, result in enumerate(results, start=1):
        done.append(result)
        if progress is not None:
            progress(count, len(blocks))
        if len(done) == per_position:
            torque, angle, limited = (np.stack(part)[None] for part in zip(*done, strict=True))
            mine = blocks[count - per_position : count]
            yield replace(
                blank,
                positions=mine[0].position[None],
                reference=np.stack([block.signals for block in mine])[None, :, :, None],
                torque=torque,
                angle=angle,
                derivatives=np.array([output.order for output in blocks[0].robot.outputs]),
                saturated=np.asarray(limited.any(axis=4)),
            )
            done = []


def _check_envelope(values: Array | None, samples: int, transient: int) -> Array:
    envelope = np.ones(samples) if values is None else np.asarray(values, dtype=float)
    if envelope.shape != (samples,) or not np.isfinite(envelope).all():
        raise InvalidInput(f"envelope: {samples} finite numbers are needed, one per sample")
    if not transient and not np.array_equal(envelope, np.ones(samples)):
        raise InvalidInput("envelope: the first period is recorded; transient is 0")
    return envelope


def _check_signals(
    robot: ElasticRobot, positions: Array, signals: Array, controller: Controller
) -> Array:
    n = len(robot.motor_names)
    signals = np.asarray(signals, dtype=float)
    if signals.ndim == 4:
        signals = signals[None]
    if signals.ndim != 5 or signals.shape[-1] != n or len(signals) not in (1, len(positions)):
        raise InvalidInput(
            f"signals: shape {signals.shape} given; (blocks, runs, samples, {n}) is needed, "
            f"or that for each of the {len(positions)} positions"
        )
    if not np.isfinite(signals).all():
        raise InvalidInput("signals: not all values are finite numbers")
    if len(controller.speed_gain) != n:
        raise InvalidInput(f"controller: {len(controller.speed_gain)} motors, the robot has {n}")
    return np.broadcast_to(signals, (len(positions), *signals.shape[1:]))
