"""A simulated robot under closed-loop control: MuJoCo's dynamics with all that spoils an FRF."""

from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from robotmodels.arrays import Array, IntArray
from robotmodels.controller import Controller
from robotmodels.elastic import ElasticRobot
from robotmodels.errors import InvalidInput, SolverFailed
from robotmodels.plant_loop import Drives, Engine, Law, Sensing, run
from robotmodels.plant_mujoco import PlantModel, addresses, build_plant, register_mujoco
from robotmodels.plant_rest import fastest_pole, find_rest, linearise_gears, open_gears
from robotmodels.records import Records
from robotmodels.urdf import locate

# Runge and Kutta's method is stable for damped poles within 2.6 / step.
_LARGEST_STEP = 2.2


@dataclass(frozen=True)
class Imperfections:
    """What makes a simulated robot unlike its linear model; values per motor or one for all.

    Attributes
    ----------
    friction : factor of the robot file's Coulomb friction [-].
    nonlinear_gears : whether hardening springs harden, or keep their slope at each position.
    backlash : gap of the gears, from flank to flank [rad, arm side]; the gear's damper stays.
    quantisation : resolution of the measured angles [rad, motor shaft]; 0 for none.
    angle_noise : standard deviation of white noise on the measured angles [rad, motor shaft].
    torque_disturbance : standard deviation of white noise on the torques, unseen [N m].
    torque_limit : largest torque a motor can give [N m]; None for no limit.
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
        InvalidInput : if it has neither one value nor n.
        """
        value = getattr(self, name)
        value = np.asarray(np.inf if value is None else value, dtype=float)
        if value.shape not in ((), (1,), (n,)):
            raise InvalidInput(
                f"imperfections: {name} has {value.size} values; 1 or {n}, one per motor, is needed"
            )
        return np.array(np.broadcast_to(value, (n,)))


IDEAL = Imperfections(friction=0.0, nonlinear_gears=False)


@dataclass(frozen=True, eq=False)
class _Block:
    """One block of experiments in one position: a piece of work for an executor."""

    robot: ElasticRobot
    position: Array
    signals: Array  # (E, N, n)
    controller: Controller
    imperfections: Imperfections
    rng: np.random.Generator
    transient: int
    periods: int
    where: str


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
    progress: Callable[[int, int], object] | None = None,
) -> Iterator[Records]:
    """Simulate periodic experiments; yield the records of one position after the other.

    Every experiment starts at rest in the position's equilibrium.

    Parameters
    ----------
    robot : the robot; its accelerometers are not simulated.
    positions : (Q, n) [rad].
    signals : (B, E, N, n), or (Q, B, E, N, n), one period of the speed references [rad/s].
    controller : its sample time is that of the signals.
    lines, detection : excited and left out DFT lines of the signals, noted in the records.
    imperfections : friction, backlash, sensors, disturbances; by default none.
    rng : the same seed gives the same records, in parallel or not.
    periods, transient : periods recorded, and periods before them that are dropped.
    executor : simulates blocks in parallel; threads serve as well as processes.
    progress : called with the number of blocks done and their total.

    Raises
    ------
    InvalidInput : if shapes do not fit, or a position is outside the joint limits.
    NoEquilibrium : if the springs cannot carry the robot's weight in a position.
    SolverFailed : if a closed loop is unstable, naming position, block and experiment.
    """
    positions = robot._check_positions(positions)
    signals = _check_signals(robot, positions, signals, controller)
    if periods < 1 or transient < 0:
        raise InvalidInput(f"periods: {periods} measured, {transient} dropped; at least 1 and 0")
    detection = np.array([], dtype=np.int64) if detection is None else detection
    Q, B = len(positions), signals.shape[1]
    seeds = rng.spawn(Q * B)
    blocks = [
        _Block(
            robot,
            positions[i],
            signals[i, b],
            controller,
            imperfections,
            seeds[i * B + b],
            transient,
            periods,
            f"position {i}, block {b}",
        )
        for i, b in product(range(Q), range(B))
    ]
    done: list[tuple[Array, Array, Array]] = []
    results = map(_run_block, blocks) if executor is None else executor.map(_run_block, blocks)
    for count, result in enumerate(results, start=1):
        done.append(result)
        if progress is not None:
            progress(count, Q * B)
        if len(done) == B:
            i = count // B - 1
            torque, angle, limited = (np.stack(part)[None] for part in zip(*done, strict=True))
            done = []
            yield Records(
                positions=positions[i : i + 1],
                sample_time=controller.sample_time,
                reference=signals[i : i + 1, :, :, None],
                torque=torque,
                angle=angle,
                lines=lines,
                detection=detection,
                saturated=np.asarray(limited.any(axis=4)),
            )


def _check_signals(
    robot: ElasticRobot, positions: Array, signals: Array, controller: Controller
) -> Array:
    n = len(robot.motor_names)
    signals = np.asarray(signals, dtype=float)
    if signals.ndim == 4:
        signals = signals[None]
    if signals.ndim != 5 or signals.shape[-1] != n or len(signals) not in (1, len(positions)):
        raise InvalidInput(
            f"signals: shape {signals.shape} given; (blocks, experiments, samples, {n}) is needed, "
            f"or that for each of the {len(positions)} positions"
        )
    if not np.isfinite(signals).all():
        raise InvalidInput("signals: not all values are finite numbers")
    if len(controller.speed_gain) != n:
        raise InvalidInput(f"controller: {len(controller.speed_gain)} motors, the robot has {n}")
    return np.broadcast_to(signals, (len(positions), *signals.shape[1:]))


def _run_block(block: _Block) -> tuple[Array, Array, Array]:
    """Return torque, angle and limited, (E, P, N, n), of one block."""
    register_mujoco()
    robot, controller, flaws = block.robot, block.controller, block.imperfections
    plant = build_plant(robot.file, locate(robot.file.urdf, robot.folder))
    rest, hold = find_rest(plant, robot, block.position, block.where)
    if not flaws.nonlinear_gears:
        linearise_gears(plant, rest)
    poles = fastest_pole(plant, robot.file, rest)
    substeps = int(np.ceil(controller.sample_time * poles / _LARGEST_STEP)) or 1
    n = len(hold)
    rest = open_gears(plant, rest, flaws.per_motor("backlash", n))
    engine, drives = _engine(plant), _drives(plant, robot, rest, flaws)
    law = Law(
        np.array(controller.speed_gain),
        1 / np.array(controller.integral_time),
        np.array(controller.position_gain),
        np.array(controller.filter_pole),
        hold / drives.gain,
    )
    _, N, _ = block.signals.shape
    total = (block.transient + block.periods) * N
    kept = (block.periods, N, n)
    results: list[Any] = []
    for e, signal in enumerate(block.signals):
        engine.qpos[:], engine.qvel[:], engine.applied[:] = rest, 0.0, 0.0
        errors, disturbance = (
            block.rng.normal(size=(total, n)) * flaws.per_motor(name, n)
            for name in ("angle_noise", "torque_disturbance")
        )
        reference = np.tile(signal, (block.transient + block.periods, 1))
        sensing = Sensing(robot.file.delay / controller.sample_time, flaws.quantisation, errors)
        *traces, good = run(
            engine, drives, law, sensing, reference, disturbance, controller.sample_time, substeps
        )
        if good < total:
            raise SolverFailed(
                f"{block.where}, experiment {e}: the simulation diverged after "
                f"{good * controller.sample_time:.3g} s; smaller controller gains, or a shorter "
                "sample time, are needed"
            )
        results.append([trace[block.transient * N :].reshape(kept) for trace in traces])
    torque, angle, limited = (np.stack(part) for part in zip(*results, strict=True))
    return torque, angle, limited


def _engine(plant: PlantModel) -> Engine:
    data = plant.data
    return Engine(*addresses(plant), data.qpos, data.qvel, data.qfrc_applied, data.qacc_smooth)


def _drives(plant: PlantModel, robot: ElasticRobot, rest: Array, flaws: Imperfections) -> Drives:
    motors = robot.file.motors
    n = len(motors)
    unit = np.zeros((len(rest), n))
    unit[plant.motors, np.arange(n)] = 1.0
    return Drives(
        np.asarray(plant.motors, dtype=np.int64),
        np.array([m.gear_ratio for m in motors]),
        np.array([m.torque_gain for m in motors]),
        flaws.per_motor("torque_limit", n),
        flaws.friction * np.array([m.coulomb for m in motors]),
        np.asarray(np.linalg.solve(plant.mass(rest), unit)),
    )
