"""What a robot's outputs read along a simulated motion: encoders, springs, MuJoCo's sensors."""

import mujoco
import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.description.outputs import Output
from robotmodels.description.robot_file import RobotFile
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.simulation.mujoco_model import stiffness_polynomial
from robotmodels.simulation.plant_loop import Drives
from robotmodels.simulation.plant_model import PlantModel

PARTS = 4
"""Instants of a sample at which motions are read, before what is above its rate is filtered out."""

_TAPS = 32 * PARTS + 1

TAIL = 16
"""Samples after the last that are read, which the filter sees."""


def other_outputs(robot: ElasticRobot) -> list[int]:
    """Return the outputs that are no encoders of motors."""
    return [i for i, o in enumerate(robot.outputs) if not (o.kind == "motor" and o.encoder)]


def readings(
    plant: PlantModel,
    robot: ElasticRobot,
    angle: Array,
    torques: tuple[Array, Array],
    motion: Array,
    sample_time: float,
    noise: Array,
    drives: Drives,
) -> Array:
    """Return what all outputs record, (T, m): of encoders angles, whatever is made of them later.

    Readings have no images of held torques: what is above half the sample rate is filtered out.

    Parameters
    ----------
    angle : ndarray, (T, n), rad
        What motors' encoders read, on their shafts.
    torques : tuple of ndarray, (r T, n), N m
        The motors' torques on their shafts, from each instant to the next; and the same with
        disturbances and Coulomb friction of motors.
    motion : ndarray, (2, r T, d)
        Coordinates and rates at r instants of every sample; empty where motors' encoders are all.
    noise : ndarray, (T, m)
        Errors of all outputs but encoders of motors.
    drives : Drives
        The plant's, with its smooth friction.
    """
    file, motors, others = robot.file, robot.motor_names, other_outputs(robot)
    columns = np.empty((len(angle), len(robot.outputs)))
    torque, acting = map(_at_instants, torques)
    on_links = iter(_on_links(plant, robot, acting, motion, drives).T)
    for i, output in enumerate(robot.outputs):
        if output.kind == "motor" and output.encoder:
            signal = angle[:, motors.index(output.of)]
            columns[:, i] = output.gain * _late(signal, output.delay, output.lag, sample_time, 1)
            continue
        if output.kind == "motor":
            signal = torque[:, motors.index(output.of)]
        elif output.kind == "joint":
            signal = motion[0][:, plant.coordinate(output.of)]
        elif output.kind == "spring":
            signal = _spring_torque(plant, file, output.of, motion)
        else:
            signal = next(on_links)
        late = _late(signal, output.delay + file.delay, output.lag, sample_time, PARTS)
        columns[:, i] = output.gain * _decimated(late)
    columns[:, others] += noise[:, others]
    return columns


def _at_instants(torque: Array) -> Array:
    """Return held torques (r T, n) at the instants, jumps at their middle."""
    middle = torque.copy()
    middle[1:] = (torque[1:] + torque[:-1]) / 2
    return middle


def _on_links(
    plant: PlantModel, robot: ElasticRobot, torque: Array, motion: Array, drives: Drives
) -> Array:
    """Return what sensors on links read, (r T, sensors), by MuJoCo's own.

    `torque` (r T, n) is all that acts on the motors' shafts: links that motors drive rigidly feel
    it at once.
    """
    sensors = [_along(plant, output) for output in robot.outputs if output.kind == "link"]
    values = np.empty((len(torque), len(sensors)))
    if not sensors:
        return values
    ratio = np.array([motor.gear_ratio for motor in robot.file.motors])
    model, data = plant.model, plant.data
    for k, applied in enumerate(torque * ratio):
        data.qpos[:], data.qvel[:] = motion[0, k], motion[1, k]
        data.qfrc_applied[:] = 0.0
        data.qfrc_applied[plant.motors] = applied
        brakes = np.tanh(data.qvel[drives.brakes] / drives.brake_width)
        data.qfrc_applied[drives.brakes] -= drives.brake_torque * brakes
        mujoco.mj_forward(model, data)
        plant.obey_couplings()
        for j, (first, axis) in enumerate(sensors):
            values[k, j] = axis @ data.sensordata[first : first + 3]
    return values


def _along(plant: PlantModel, output: Output) -> tuple[int, Array]:
    """Return where a sensor's three numbers begin, and its direction."""
    direction = np.array(output.direction, dtype=float)
    return int(plant.model.sensor(output.label).adr[0]), direction / np.linalg.norm(direction)


def _spring_torque(plant: PlantModel, file: RobotFile, name: str, motion: Array) -> Array:
    """Return the torque of a spring and its damper on what is beyond, (T,).

    Gears are as they are simulated: linearised, or with a gap, if that was asked for.
    """
    spring = next(s for s in file.springs if s.name == name)
    joint = plant.coordinate(str(spring.joint if spring.axis == "drive" else spring.name))
    elongation, rate = motion[0][:, joint].copy(), motion[1][:, joint].copy()
    low, _, cubic = stiffness_polynomial(spring)
    gears = {m.joint: (m.name, gear) for m, gear in zip(file.motors, plant.gears, strict=True)}
    if spring.axis == "drive" and spring.joint in gears:
        motor, gear = gears[spring.joint]
        shaft, model = plant.coordinate(motor), plant.model
        elongation -= motion[0][:, shaft]
        elongation -= np.clip(elongation, *model.tendon_lengthspring[gear])
        rate -= motion[1][:, shaft]
        low, cubic = model.tendon_stiffness[gear], model.tendon_stiffnesspoly[gear][1]
    return np.asarray(-(low + cubic * elongation**2) * elongation - spring.damping * rate)


def _decimated(signal: Array) -> Array:
    """Return every r-th instant of a signal (r T,) without what is above half the sample rate."""
    taps = np.sinc(np.linspace(-16, 16, _TAPS)) * np.kaiser(_TAPS, 10.0)
    padded = np.pad(signal, _TAPS // 2, mode="edge")
    return np.asarray(np.convolve(padded, taps / taps.sum(), mode="valid")[::PARTS])


def _late(signal: Array, delay: float, lag: float, sample_time: float, parts: int) -> Array:
    """Return a signal, `parts` instants a sample, late by `delay`, behind by a `lag` [s]."""
    if delay == 0 and lag == 0:
        return signal
    from scipy.interpolate import CubicSpline
    from scipy.signal import lfilter

    finer = PARTS // parts  # as fine as the others
    instants = np.arange(finer * (len(signal) - 1) + 1) / finer
    at = np.maximum(instants - delay * parts / sample_time, 0.0)
    late = CubicSpline(np.arange(len(signal)), signal)(at)
    if lag > 0:
        # Exact for a signal that is straight between the instants.
        step = sample_time / PARTS / lag
        pole = np.exp(-step)
        before = 1 - (1 - pole) / step
        taps = np.array([before, 1 - pole - before])
        late = lfilter(taps, [1.0, -pole], late, zi=[(1 - taps[0]) * late[0]])[0]
    return np.asarray(late[::finer])
