"""One block of runs in MuJoCo, from the robot at rest on."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robotmodels.common.arrays import Array, ComplexArray, IntArray
from robotmodels.common.errors import NoEquilibrium, SolverFailed
from robotmodels.description.counterbalances import Counterbalance
from robotmodels.description.robot_file import Hardening, RobotFile
from robotmodels.elastic.counterbalances import osculating
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.simulation.controller import Controller
from robotmodels.simulation.imperfections import Imperfections
from robotmodels.simulation.plant_loop import (
    STABILITY,
    ControllerGains,
    Drives,
    MujocoState,
    Scratch,
    Sensing,
    Springs,
    closed_loop_run,
)
from robotmodels.simulation.plant_model import PlantModel, addresses, build_plant, register_mujoco
from robotmodels.simulation.readings import PARTS, TAIL, other_outputs, readings


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
    envelope : ndarray, (N,)
        Factors of the samples of the first period.
    highest : float, rad/s
        Highest excited line.
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
    envelope: Array
    highest: float
    where: str


def run_block(block: Block) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return torque, outputs and whether limited, (E, P, N, n or m), of one block of runs.

    Raises
    ------
    NoEquilibrium
        If the springs cannot carry the robot's weight.
    SolverFailed
        If a motor leaves its position, the closed loop being unstable.
    """
    register_mujoco()
    robot, controller, flaws = block.robot, block.controller, block.imperfections
    plant = build_plant(_simulated_file(robot, block.position), robot.model_file)
    state, hold = static_state(plant, robot, block.position, block.where)
    if not flaws.nonlinear_gears:
        linearise_gears(plant, state)
    steps = substeps(
        plant, robot.file, state, controller.sample_time, block.highest, flaws.friction
    )
    n = len(hold)
    state = open_gears(plant, state, flaws.per_motor("backlash", n))
    engine, springs, scratch = _mujoco_state(plant), springs_of(plant), _scratch(len(state))
    drives = _drives(plant, robot, state, flaws, controller.sample_time)
    gains = _controller_gains(controller, hold / drives.gain)
    _, N, _ = block.signals.shape
    total = (block.transient + block.periods) * N
    step = controller.sample_time
    sensed = bool(other_outputs(robot))
    parts = PARTS if sensed or drives.delay.any() or drives.lag.any() or step > _LONGEST else 1
    total += TAIL if sensed else 0
    motion = np.empty((2, parts * total if sensed else 0, len(state)))
    results: list[Any] = []
    for e, signal in enumerate(block.signals):
        _reset(engine, state)
        errors, disturbance = (
            block.rng.normal(size=(total, n)) * flaws.per_motor(name, n)
            for name in ("angle_noise", "torque_disturbance")
        )
        reference = _whole_run(block, signal, total)
        sensing = Sensing(robot.file.delay / step, flaws.quantisation, errors)
        torque, angle, limited, delivered, acting, good = closed_loop_run(
            engine,
            springs,
            scratch,
            drives,
            gains,
            sensing,
            reference,
            disturbance,
            step,
            steps,
            parts,
            motion,
        )
        if good < total:
            raise _lost(f"{block.where}, run {e + 1}", good * step)
        noise = _output_noise(block, total)
        outputs = readings(plant, robot, angle, (delivered, acting), motion, step, noise, drives)
        end = (block.transient + block.periods) * N
        recorded = (trace[block.transient * N : end] for trace in (torque, outputs, limited))
        results.append([trace.reshape(block.periods, N, -1) for trace in recorded])
    torque, outputs, limited = (np.stack(part) for part in zip(*results, strict=True))
    return torque, outputs, limited


def _output_noise(block: Block, samples: int) -> Array:
    """Return the errors of the outputs, (T, m); nothing is drawn where there are none."""
    m = len(block.robot.outputs)
    std = np.broadcast_to(block.imperfections.per_motor("output_noise", m, "output"), (samples, m))
    return std * block.rng.normal(size=std.shape) if std.any() else std


def _simulated_file(robot: ElasticRobot, position: Array) -> RobotFile:
    """Return the robot file; counterbalances that MuJoCo cannot hold as sinusoids that touch."""
    balances = robot.file.counterbalances
    if all(balance.in_mujoco for balance in balances):
        return robot.file
    (coordinates,) = robot.equilibrium(position[None]).coordinates
    laws = zip(balances, robot.arm.counterbalances, strict=True)
    touching = [
        balance
        if balance.in_mujoco
        else Counterbalance(
            name=balance.name,
            joint=balance.joint,
            sinusoid=osculating(torque.law, coordinates[robot.arm.coordinate[balance.joint]]),
        )
        for balance, torque in laws
    ]
    return robot.file.model_copy(update={"counterbalances": touching})


def _whole_run(block: Block, period: Array, total: int) -> Array:
    """Return the references of a run of `total` samples, (T, n), from one period of them (N, n)."""
    # In one memory layout always: another would be compiled anew.
    reference = np.ascontiguousarray(period[np.arange(total) % len(period)])
    reference[: len(period)] *= block.envelope[:, None]
    return reference


def _lost(where: str, after: float) -> SolverFailed:
    """Return the error for a motor that left its position `after` a time [s]."""
    return SolverFailed(
        f"{where}: a motor is more than 1 rad (arm side) off after {after:.3g} s; a stable "
        "controller (smaller gains or sample time) or smaller signals are needed"
    )


def _controller_gains(controller: Controller, hold: Array) -> ControllerGains:
    return ControllerGains(
        np.array(controller.speed_gain),
        1 / np.array(controller.integral_time),
        np.array(controller.position_gain),
        np.array(controller.filter_pole),
        hold,
    )


def _mujoco_state(plant: PlantModel) -> MujocoState:
    data = plant.data
    return MujocoState(
        *addresses(plant),
        data.qpos,
        data.qvel,
        data.qfrc_applied,
        data.qacc_smooth,
        data.qfrc_passive,
        data.qfrc_bias,
        bool(plant.model.ntendon > np.count_nonzero(plant.gears >= 0)),
        plant.constraints,
    )


def _scratch(d: int) -> Scratch:
    return Scratch(*np.zeros((len(Scratch._fields), d)))


def _reset(engine: MujocoState, state: Array) -> None:
    """Put the plant at rest at coordinates (d,)."""
    engine.qpos[:], engine.qvel[:] = state, 0.0
    engine.applied[:] = 0.0


def springs_of(plant: PlantModel) -> Springs:
    """Return the springs and dampers of joints and gears, as MuJoCo's model has them now."""
    model, gears = plant.model, plant.gears[plant.gears >= 0]
    used = np.flatnonzero(model.jnt_stiffness + model.dof_damping)
    ends, gaps = model.tendon_adr[gears], model.tendon_lengthspring[gears].T
    columns: list[tuple[Any, Any]] = [
        (used, model.wrap_objid[ends]),
        (np.full(len(used), -1), model.wrap_objid[ends + 1]),
        (model.qpos_spring[used], gaps[0]),
        (model.qpos_spring[used], gaps[1]),
        (model.jnt_stiffness[used], model.tendon_stiffness[gears]),
        (model.jnt_stiffnesspoly[used, 1], model.tendon_stiffnesspoly[gears, 1]),
        (model.dof_damping[used], model.tendon_damping[gears]),
    ]
    first, second, *others = (np.concatenate(column) for column in columns)
    return Springs(first.astype(np.int64), second.astype(np.int64), *others)


def _drives(
    plant: PlantModel, robot: ElasticRobot, state: Array, flaws: Imperfections, step: float
) -> Drives:
    motors = robot.file.motors
    n = len(motors)
    unit = np.zeros((len(state), n))
    unit[plant.motors, np.arange(n)] = 1.0
    return Drives(
        np.asarray(plant.motors, dtype=np.int64),
        np.array([m.gear_ratio for m in motors]),
        np.array([m.torque_gain for m in motors]),
        flaws.per_motor("torque_limit", n),
        flaws.friction * np.array([0.0 if m.coulomb_width else m.coulomb for m in motors]),
        np.array([m.torque_delay / step for m in motors]),
        np.array([m.torque_lag / step for m in motors]),
        plant.mobility(state, unit),
        *_brakes(plant, robot, state, flaws.friction),
    )


def _brakes(
    plant: PlantModel, robot: ElasticRobot, state: Array, factor: float
) -> tuple[IntArray, Array, Array]:
    """Return coordinates, torques and widths of smooth Coulomb friction, on the arm side."""
    weight = _weight(plant, state)
    brakes = [
        (c, m.coulomb * abs(m.gear_ratio), m.coulomb_width / abs(m.gear_ratio))
        for c, m in zip(plant.motors.tolist(), robot.file.motors, strict=True)
        if m.coulomb and m.coulomb_width
    ]
    for item in robot.file.friction:
        c = plant.coordinate(item.joint)
        if torque := item.coulomb + item.load * float(weight[c]):
            brakes.append((c, torque, item.coulomb_width))
    columns = np.array(brakes if factor else [], dtype=float).reshape(-1, 3).T.copy()
    return columns[0].astype(np.int64), factor * columns[1], columns[2]


_LONGEST = 1e-3  # time for which the robot's shape is held [s]
_SAFETY = 1.15  # of poles, for positions nearby
_ACCURACY = 2e-4  # of the frequencies of modes, so that stiffness is within 0.04 %
_STICKING = 4
"""Steps per sample at least with sharp friction, whose torque is constant over a step.

Where light motors of wrists stop, one step a sample makes their springs seem 0.2 to 0.5 % softer;
more than four change 0.03 %.
"""


def static_state(
    plant: PlantModel, robot: ElasticRobot, position: Array, where: str
) -> tuple[Array, Array]:
    """Return the coordinates (d,) at which the motors stand at `position`, and their torques (n,).

    The torques are those on the motor shafts that hold the arm against gravity [N m].

    Raises
    ------
    NoEquilibrium
        If there is none.
    """
    q = np.zeros(plant.model.nv)
    for joint, motor, angle in zip(robot.motor_joints, plant.motors, position, strict=True):
        q[plant.coordinate(joint)] = angle
        q[motor] = angle
    reduction, columns = plant.coordinate_map, plant.coordinate_map.matrix.T
    r, driven = q[plant.independent], np.searchsorted(plant.independent, plant.motors)
    free = np.setdiff1d(np.arange(len(r)), driven)
    for _ in range(50):
        q = reduction.joints(r)
        forces, K = columns @ plant.static_forces(q), _stiffness(plant, q, columns[free])
        change = np.linalg.solve(K, forces[free])
        r[free] -= change
        if not (np.abs(change) < 1.0).all():
            break
        # Differences limit the slopes, and so the rate of convergence, not its end.
        if np.abs(change).max(initial=0.0) < 1e-12:
            q = reduction.joints(r)
            ratio = np.array([m.gear_ratio for m in robot.file.motors])
            return q, -(columns @ plant.static_forces(q))[driven] / ratio
    raise NoEquilibrium(f"{where}: the springs cannot carry the robot's weight")


def _stiffness(plant: PlantModel, q: Array, directions: Array) -> Array:
    """Return the slopes of the forces along `directions`, (k, d), in each of them, (k, k)."""
    step, k = 1e-6, len(directions)
    slopes = [
        plant.static_forces(q + step * e) - plant.static_forces(q - step * e) for e in directions
    ]
    return np.asarray(directions @ np.array(slopes).reshape(k, len(q)).T / (2 * step))


def linearise_gears(plant: PlantModel, state: Array) -> None:
    """Replace the gears' characteristics by their tangents at `state`, torques unchanged."""
    model = plant.model
    plant.static_forces(state)
    for i in plant.gears[plant.gears >= 0]:
        x = float(plant.data.ten_length[i])
        low, (_, cubic) = model.tendon_stiffness[i], model.tendon_stiffnesspoly[i]
        slope = low + 3 * cubic * x**2
        model.tendon_stiffness[i], model.tendon_stiffnesspoly[i] = slope, 0.0
        model.tendon_lengthspring[i] = x - (low + cubic * x**2) * x / slope


def open_gears(plant: PlantModel, state: Array, gaps: Array) -> Array:
    """Give the gears their gaps (n,); return `state` with each motor at the flank that it loads."""
    state = state.copy()
    plant.static_forces(state)
    for motor, gear, gap in zip(plant.motors, plant.gears, gaps, strict=True):
        if gear >= 0 and gap > 0:
            middle = plant.model.tendon_lengthspring[gear].mean()
            side = np.sign(plant.data.ten_length[gear] - middle)
            plant.model.tendon_lengthspring[gear] = middle + gap * np.array([-0.5, 0.5])
            state[motor] -= side * gap / 2
    return state


def substeps(
    plant: PlantModel,
    file: RobotFile,
    state: Array,
    sample_time: float,
    highest: float,
    friction: float = 0.0,
) -> int:
    """Return the least number of steps per sample that are stable, and accurate at the lines.

    A mode p has the frequency of exp(p h) in exact steps h; of one far above the `highest` line
    [rad/s] responses at lines have a share (highest / p)^2 only. `friction` is the factor of
    Coulomb friction, whose stops take some steps where it is sharp.
    """
    poles = _SAFETY * _poles(plant, file, state) * sample_time
    sizes = np.maximum(np.abs(poles), 1e-12)
    allowed = _ACCURACY * sizes * np.maximum(1.0, (sizes / (highest * sample_time)) ** 2)
    sharp = friction and any(m.coulomb and not m.coulomb_width for m in file.motors)
    count = _STICKING if sharp else 1
    while True:
        steps = np.polyval(STABILITY, poles / count)
        stable = (np.abs(steps) <= 1 + 1e-9).all()
        if stable and (count * np.abs(np.exp(poles / count) - steps) <= allowed).all():
            return count
        count += 1


def _poles(plant: PlantModel, file: RobotFile, state: Array) -> ComplexArray:
    """Return the poles, gravity left out, hardening springs at their hardest [rad/s]."""
    d = plant.model.nv
    damping, stiffness = np.zeros((2, d, d))
    motor_of = {m.joint: m.name for m in file.motors}
    for spring in file.springs:
        a = np.zeros(d)
        a[plant.coordinate(str(spring.joint if spring.axis == "drive" else spring.name))] = 1.0
        if spring.axis == "drive" and spring.joint in motor_of:
            a[plant.coordinate(motor_of[spring.joint])] = -1.0
        k = spring.stiffness
        stiffness += (max(k.low, k.high) if isinstance(k, Hardening) else k) * np.outer(a, a)
        damping += spring.damping * np.outer(a, a)
    _add_friction(damping, plant, file, _weight(plant, state))
    mass, stiffness, damping = map(
        plant.coordinate_map.congruent, (plant.mass(state), stiffness, damping)
    )
    both = np.linalg.solve(mass, np.hstack([stiffness, damping]))
    companion = np.block([[np.zeros_like(mass), np.eye(len(mass))], [-both]])
    poles = np.linalg.eigvals(companion)
    # Rigid modes are at zero but for rounding, which may put them to the right of it.
    return np.where(poles.real > 0, 1j * poles.imag, poles)


def _add_friction(damping: Array, plant: PlantModel, file: RobotFile, weight: Array) -> None:
    """Add friction at its steepest: that of tanh at rest."""
    for motor, c in zip(file.motors, plant.motors, strict=True):
        smooth = motor.coulomb / motor.coulomb_width if motor.coulomb_width else 0.0
        damping[c, c] += (motor.viscous + smooth) * motor.gear_ratio**2
    for item in file.friction:
        c = plant.coordinate(item.joint)
        coulomb = item.coulomb + item.load * float(weight[c])
        damping[c, c] += item.viscous + coulomb / item.coulomb_width


def _weight(plant: PlantModel, state: Array) -> Array:
    """Return the sizes of gravity's torques at rest, (d,)."""
    plant.static_forces(state)
    return np.asarray(np.abs(plant.data.qfrc_bias))
