"""Motor torques against what a robot file needs for the same movement: signs, sides, units."""

from collections.abc import Iterator

import numpy as np
from scipy.signal import butter, sosfiltfilt

from estimators.logs.correlated_regression import Series, regress
from robotmodels.common.arrays import Array
from robotmodels.elastic.inverse_dynamics import movement_torques
from robotmodels.elastic.robot import ElasticRobot

_LOW_PASS = 5.0  # [Hz]; angles differentiated twice are noise beyond
_ENDS = 3.0  # periods of that, in which a filter begins and ends
_FASTEST = 0.25  # of the Nyquist frequency, that the low-pass may reach
_MOST = 4000  # samples that inverse dynamics take
_MOVING = 0.05  # of the largest speed
_EXPLAINS = 0.8  # share of a torque's variation from which a factor means something
_FACTORS = (0.5, 2.0)  # payloads and friction may change torques by that
_CERTAIN = 3.0  # standard errors


def torque_findings(robot: ElasticRobot, step: float, angle: Array, torque: Array) -> Iterator[str]:
    """Yield which motor torques contradict a robot's masses, weights and inertias.

    Torques at rest and in motion are regressed on inverse dynamics, friction and offset beside.

    Parameters
    ----------
    robot : ElasticRobot
        The robot, its joints in the order of the columns.
    step : float, s
        Sample time.
    angle, torque : ndarray, (N, n)
        Of all joints, on the joint side of the gears.
    """
    if 0.5 / step * _FASTEST < _LOW_PASS or not np.isfinite(angle + torque).all():
        return
    ends = round(_ENDS / _LOW_PASS / step)
    if len(angle) < 4 * ends:
        return
    filtered = butter(4, _LOW_PASS, fs=1 / step, output="sos")
    stride = max(1, len(angle) // _MOST)
    smooth, measured = (sosfiltfilt(filtered, part, axis=0) for part in (angle, torque))
    speed, acceleration = _derivatives(smooth, step)
    inside = slice(ends, -ends, stride)
    parts = [part[inside] for part in (smooth, speed, acceleration)]
    behind = movement_torques(robot, *parts)
    rotors = np.array([motor.inertia * motor.gear_ratio**2 for motor in robot.file.motors])
    needed = behind.links + behind.counterbalances + rotors * parts[2]
    if robot.file.payload is not None:
        needed = needed + robot.file.payload.mass * behind.payload
    block = max(1, round(0.1 / (step * stride)))
    for j, name in enumerate(robot.motor_names):
        yield from _judged(name, measured[inside, j], needed[:, j], parts[1][:, j], block)


def _derivatives(smooth: Array, step: float) -> tuple[Array, Array]:
    speed = np.gradient(smooth, step, axis=0)
    return speed, np.gradient(speed, step, axis=0)


def _judged(name: str, torque: Array, needed: Array, speed: Array, block: int) -> Iterator[str]:
    moving = np.abs(speed) > _MOVING * np.abs(speed).max()
    if moving.sum() < 30 * block or not np.ptp(needed[moving]) > 0:
        return
    friction = np.stack([np.sign(speed), speed, np.ones_like(speed)], axis=1)
    fit = regress([Series(torque, needed[:, None], friction, moving, block)])
    factor, error = float(fit.coefficients[0]), fit.std(0)
    alone = regress([Series(torque, friction[:, :2], friction[:, 2:], moving, block)])
    explained = 1 - fit.rms**2 / alone.rms**2 if alone.rms > 0 else 0.0
    if explained < _EXPLAINS or abs(factor) < _CERTAIN * error:
        return
    told = f"motor_torque of {name} is {factor:.3g} +- {error:.2g} times what"
    if factor < 0:
        yield f"{told} weight and acceleration need: its sign seems wrong"
    elif not _FACTORS[0] < factor < _FACTORS[1]:
        yield f"{told} the robot file needs here: a unit, a side of the gear or a mass is wrong"
