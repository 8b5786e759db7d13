"""What a robot's outputs read along a simulated motion: encoders, springs, MuJoCo's sensors."""

import mujoco
import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.description.outputs import Output
from robotmodels.description.robot_file import RobotFile
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.simulation.mujoco_model import stiffness_polynomial
from robotmodels.simulation.plant_model import PlantModel

_FINER = 8  # samples that a first-order lag sees for one


def other_outputs(robot: ElasticRobot) -> list[int]:
    """Return the outputs that are no encoders of motors."""
    return [i for i, o in enumerate(robot.outputs) if not (o.kind == "motor" and o.encoder)]


def readings(
    plant: PlantModel,
    robot: ElasticRobot,
    angle: Array,
    torque: Array,
    motion: Array,
    sample_time: float,
    noise: Array,
) -> Array:
    """Return what all outputs record, (T, m): of encoders angles, whatever is made of them later.

    Parameters
    ----------
    angle, torque : ndarray, (T, n), rad and N m
        What motors' encoders read, and the motors' torques, on their shafts.
    motion : ndarray, (2, T, d)
        Coordinates and rates at every sample; empty where motors' encoders are all there is.
    noise : ndarray, (T, m)
        Errors of all outputs but encoders of motors.
    """
    file, motors = robot.file, robot.motor_names
    columns, others = np.empty((len(angle), len(robot.outputs))), other_outputs(robot)
    sensed = _sensed(plant, robot, torque, motion) if len(others) else np.empty(0)
    for i, output in enumerate(robot.outputs):
        if output.kind == "motor":
            source = angle if output.encoder else torque
            column = source[:, motors.index(output.of)]
        elif output.kind == "joint":
            column = motion[0][:, plant.coordinate(output.of)]
        elif output.kind == "spring":
            column = _spring_torque(plant, file, output.of, motion)
        else:
            column = sensed[:, [o for o in others if robot.outputs[o].kind == "link"].index(i)]
        late = output.delay + (file.delay if i in others else 0.0)
        columns[:, i] = output.gain * _behind(column, late, output.lag, sample_time)
    columns[:, others] += noise[:, others]
    return columns


def _sensed(plant: PlantModel, robot: ElasticRobot, torque: Array, motion: Array) -> Array:
    """Return what sensors on links read, (T, sensors), by MuJoCo's own."""
    outputs = [output for output in robot.outputs if output.kind == "link"]
    values = np.empty((len(torque), len(outputs)))
    if not outputs:
        return values
    ratio = np.array([motor.gear_ratio for motor in robot.file.motors])
    sensors = [_along(plant, output) for output in outputs]
    model, data = plant.model, plant.data
    for k, applied in enumerate(torque * ratio):
        data.qpos[:], data.qvel[:] = motion[0, k], motion[1, k]
        data.qfrc_applied[plant.motors] = applied
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
    """Return the torque of a spring and its damper on what is beyond, (T,)."""
    spring = next(s for s in file.springs if s.name == name)
    joint = plant.coordinate(str(spring.joint if spring.axis == "drive" else spring.name))
    elongation, rate = motion[0][:, joint].copy(), motion[1][:, joint].copy()
    gears = {m.joint: m.name for m in file.motors}
    if spring.axis == "drive" and spring.joint in gears:
        shaft = plant.coordinate(gears[spring.joint])
        elongation -= motion[0][:, shaft]
        rate -= motion[1][:, shaft]
    low, _, cubic = stiffness_polynomial(spring)
    return np.asarray(-(low + cubic * elongation**2) * elongation - spring.damping * rate)


def _behind(signal: Array, delay: float, lag: float, sample_time: float) -> Array:
    """Return a signal (T,) late by `delay` and behind by a first-order `lag` [s]."""
    if delay == 0 and lag == 0:
        return signal
    from scipy.interpolate import CubicSpline
    from scipy.signal import lfilter

    steps = np.arange(_FINER * (len(signal) - 1) + 1) / _FINER
    late = CubicSpline(np.arange(len(signal)), signal)(np.maximum(steps - delay / sample_time, 0.0))
    if lag == 0:
        return np.asarray(late[::_FINER])
    # Exact for a signal that is straight between the finer samples.
    step = sample_time / _FINER / lag
    pole = np.exp(-step)
    before = 1 - (1 - pole) / step
    taps = np.array([before, 1 - pole - before])
    state = np.array([(1 - taps[0]) * late[0]])
    return np.asarray(lfilter(taps, [1.0, -pole], late, zi=state)[0][::_FINER])
