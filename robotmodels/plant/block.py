"""One block of simulated runs, from the robot's rest to its signals."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robotmodels.arrays import Array
from robotmodels.description.urdf import locate
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.errors import SolverFailed
from robotmodels.plant.controller import Controller
from robotmodels.plant.loop import Drives, Engine, Law, Sensing, run
from robotmodels.plant.mujoco_model import PlantModel, addresses, build_plant, register_mujoco
from robotmodels.plant.rest import find_rest, linearise_gears, open_gears, substeps
from robotmodels.plant.simulation import Imperfections


@dataclass(frozen=True, eq=False)
class Block:
    """One block of runs in one position: a piece of work for an executor.

    Attributes
    ----------
    position : ndarray, (n,), rad
        Position.
    signals : ndarray, (E, N, n), rad/s
        One period of the speed references.
    rng : Generator
        Random generator of this block alone.
    transient, periods : int
        Dropped and recorded periods.
    where : str
        What errors call it.
    """

    robot: ElasticRobot
    position: Array
    signals: Array
    controller: Controller
    imperfections: Imperfections
    rng: np.random.Generator
    transient: int
    periods: int
    where: str


def run_block(block: Block) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return torque, angle and whether limited, (E, P, N, n), of one block of runs.

    Raises
    ------
    NoEquilibrium
        If the springs cannot carry the robot's weight.
    SolverFailed
        If a motor leaves its position, the closed loop being unstable.
    """
    register_mujoco()
    robot, controller, flaws = block.robot, block.controller, block.imperfections
    plant = build_plant(robot.file, locate(robot.file.urdf, robot.folder))
    rest, hold = find_rest(plant, robot, block.position, block.where)
    if not flaws.nonlinear_gears:
        linearise_gears(plant, rest)
    steps = substeps(plant, robot.file, rest, controller.sample_time)
    n = len(hold)
    rest = open_gears(plant, rest, flaws.per_motor("backlash", n))
    engine, drives = _engine(plant), _drives(plant, robot, rest, flaws)
    law = _law(controller, hold / drives.gain)
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
        # In one memory layout always: another would be compiled anew.
        reference = np.ascontiguousarray(np.tile(signal, (block.transient + block.periods, 1)))
        sensing = Sensing(robot.file.delay / controller.sample_time, flaws.quantisation, errors)
        *traces, good = run(
            engine, drives, law, sensing, reference, disturbance, controller.sample_time, steps
        )
        if good < total:
            raise _lost(f"{block.where}, run {e + 1}", good * controller.sample_time)
        results.append([trace[block.transient * N :].reshape(kept) for trace in traces])
    torque, angle, limited = (np.stack(part) for part in zip(*results, strict=True))
    return torque, angle, limited


def _lost(where: str, after: float) -> SolverFailed:
    """Return the error for a motor that left its position `after` a time [s]."""
    return SolverFailed(
        f"{where}: a motor is more than 1 rad (arm side) off after {after:.3g} s; a stable "
        "controller (smaller gains or sample time) or smaller signals are needed"
    )


def _law(controller: Controller, hold: Array) -> Law:
    return Law(
        np.array(controller.speed_gain),
        1 / np.array(controller.integral_time),
        np.array(controller.position_gain),
        np.array(controller.filter_pole),
        hold,
    )


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
