"""A simulated robot under closed-loop control: MuJoCo's dynamics with all that spoils an FRF."""

from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robotmodels.arrays import Array, IntArray
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.errors import InvalidInput
from robotmodels.plant.controller import Controller
from robotmodels.progress import Progress
from robotmodels.records import Records, check_periods

if TYPE_CHECKING:
    from robotmodels.plant.block import Block


@dataclass(frozen=True)
class Imperfections:
    """What makes a simulated robot unlike its linear model; values per motor or one for all.

    Attributes
    ----------
    friction : float, dimensionless
        Factor of the robot file's Coulomb friction.
    nonlinear_gears : bool
        Whether hardening springs harden, or keep their slope at each position.
    backlash : array_like
        Gap of the gears, from flank to flank [rad, arm side]; the gear's damper stays.
    quantisation : float
        Resolution of the measured angles [rad, motor shaft]; 0 for none.
    angle_noise : array_like
        Standard deviation of white noise on the measured angles [rad, motor shaft].
    torque_disturbance : array_like, N m
        Standard deviation of white noise on the torques, unseen.
    torque_limit : array_like or None, N m
        Largest torque a motor can give; None for no limit.
    """

    friction: float = 1.0
    nonlinear_gears: bool = True
    backlash: ArrayLike = 0.0
    quantisation: float = 0.0
    angle_noise: ArrayLike = 0.0
    torque_disturbance: ArrayLike = 0.0
    torque_limit: ArrayLike | None = None

    def __post_init__(self) -> None:
        for name in ("friction", "backlash", "quantisation", "angle_noise", "torque_disturbance"):
            value = np.asarray(getattr(self, name), dtype=float)
            if not (np.isfinite(value) & (value >= 0)).all():
                raise InvalidInput(f"imperfections: {name} {value.tolist()} is not a number >= 0")
        limit = np.asarray(1.0 if self.torque_limit is None else self.torque_limit, dtype=float)
        if not (limit > 0).all():
            raise InvalidInput(f"imperfections: torque_limit {limit.tolist()} is not positive")

    def per_motor(self, name: str, n: int) -> Array:
        """Return an entry as one value per motor, (n,).

        Raises
        ------
        InvalidInput
            If it has neither one value nor n.
        """
        value = getattr(self, name)
        value = np.asarray(np.inf if value is None else value, dtype=float)
        if value.shape not in ((), (1,), (n,)):
            raise InvalidInput(
                f"imperfections: {name} has {value.size} values; 1 or {n}, one per motor, is needed"
            )
        return np.array(np.broadcast_to(value, (n,)))


IDEAL = Imperfections(friction=0.0, nonlinear_gears=False)


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
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> Iterator[Records]:
    """Simulate periodic runs; yield the records of one position after the other.

    Every run starts at rest in the position's equilibrium.

    Parameters
    ----------
    robot : ElasticRobot
        The robot; its accelerometers are not simulated.
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
    from robotmodels.plant.block import Block

    positions = np.asarray(positions, dtype=float)
    robot.equilibrium(positions)  # refuses positions at which nothing can be simulated
    signals = _check_signals(robot, positions, signals, controller)
    check_periods(periods, transient)
    for name in ("backlash", "angle_noise", "torque_disturbance", "torque_limit"):
        imperfections.per_motor(name, positions.shape[1])
    places = list(product(range(len(positions)), range(signals.shape[1])))
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
            f"position {i + 1}, block {b + 1}",
        )
        for (i, b), seed in zip(places, rng.spawn(len(places)), strict=True)
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
    """Return records of one position with the references in the place of what is measured."""
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
    from robotmodels.plant.block import run_block

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
                saturated=np.asarray(limited.any(axis=4)),
            )
            done = []


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
