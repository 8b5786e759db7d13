"""Measured movements of joints, low-passed, differentiated and freed of the encoders' delays."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

from robotmodels.common.arrays import Array, BoolArray
from robotmodels.common.errors import InvalidInput
from robotmodels.elastic.inverse_dynamics import MovementTorques, movement_torques
from robotmodels.elastic.robot import ElasticRobot


class JointHistories(Protocol):
    """Evenly sampled signals of joints, all on the joints' side of the gears.

    A column is NaN where there is no such sensor.
    """

    @property
    def joints(self) -> tuple[str, ...]:
        """Name of the motor or joint of each of the n columns."""

    @property
    def sample_time(self) -> float:
        """Sample time [s]."""

    @property
    def motor_angle(self) -> Array:
        """Motor angles over gear ratios, (N, n) [rad]."""

    @property
    def link_angle(self) -> Array:
        """Angles behind the gears, (N, n) [rad]."""

    @property
    def motor_torque(self) -> Array:
        """Motor torques times gear ratios, (N, n) [N m]."""


@dataclass(frozen=True, eq=False)
class JointMovement:
    """One record in the order of the robot's motors.

    Attributes
    ----------
    robot : ElasticRobot
        The robot that moved.
    sample_time : float, s
        Sample time.
    motor_angle, link_angle : ndarray, (N, n), rad
        As measured; motor angles stand in where no link angle is measured.
    torque : ndarray, (N, n), N m, or None
        Motor torques on the joints' side.
    on_both_sides : ndarray of bool, (n,)
        Which joints have an encoder on either side of the gear.
    gear_torque : ndarray, (N, n), N m
        What torque sensors of the joints measure; NaN where there is none.
    """

    robot: ElasticRobot
    sample_time: float
    motor_angle: Array
    link_angle: Array
    torque: Array | None
    on_both_sides: BoolArray
    gear_torque: Array

    @property
    def senses_torque(self) -> BoolArray:
        """Which joints have a torque sensor behind the gear, (n,)."""
        return np.asarray(np.isfinite(self.gear_torque).all(axis=0))

    @property
    def time(self) -> Array:
        """Times of the samples, (N,) [s]."""
        return np.asarray(self.sample_time * np.arange(len(self.motor_angle)))

    def low_passed(self, cutoff: float) -> "SmoothMovement":
        """Return smooth curves through what lies below `cutoff` [Hz], without delay."""
        if not 0 < cutoff < 0.4 / self.sample_time:
            raise InvalidInput(
                f"low_pass: {cutoff:g} Hz; between 0 and {0.4 / self.sample_time:.4g} Hz is needed "
                f"at a sample time of {1e3 * self.sample_time:.4g} ms"
            )
        sections = butter(4, 2 * cutoff * self.sample_time, output="sos")
        motor, link = (
            CubicSpline(self.time, sosfiltfilt(sections, angle, axis=0))
            for angle in (self.motor_angle, self.link_angle)
        )
        torque = None if self.torque is None else sosfiltfilt(sections, self.torque, axis=0)
        gears = sosfiltfilt(sections, self.gear_torque, axis=0)
        margin = 1 / cutoff  # where the filter has not settled
        inside = (self.time > margin) & (self.time < self.time[-1] - margin)
        return SmoothMovement(self, motor, link, torque, inside, gears)


@dataclass(frozen=True, eq=False)
class SmoothMovement:
    """Low-passed curves of a movement.

    Attributes
    ----------
    measured : JointMovement
        What they smooth.
    motor, link : CubicSpline
        Motor and link angles, of time.
    torque : ndarray, (N, n), or None
        Motor torques.
    inside : ndarray of bool, (N,)
        Samples that the filter's ends leave alone.
    gear_torque : ndarray, (N, n)
        What torque sensors of the joints measure; NaN where there is none.
    """

    measured: JointMovement
    motor: CubicSpline
    link: CubicSpline
    torque: Array | None
    inside: BoolArray
    gear_torque: Array

    def links(self, delays: Array) -> tuple[Array, Array, Array]:
        """Return link angles, speeds and accelerations, (N, n), freed of `delays` (n,) [s]."""
        times = [self.measured.time + d for d in delays]
        angle, speed, acceleration = (
            np.stack([self.link(t, order)[:, j] for j, t in enumerate(times)], axis=1)
            for order in range(3)
        )
        return angle, speed, acceleration

    def torques(self, delays: Array) -> MovementTorques:
        """Return the torques behind the links' movement."""
        return movement_torques(self.measured.robot, *self.links(delays))


def joint_movement(robot: ElasticRobot, record: JointHistories) -> JointMovement:
    """Return a record in the order of the robot's motors.

    Raises
    ------
    InvalidInput
        If a motor is missing or has gaps, or no joint has encoders on both sides.
    """
    columns = [_column(motor.name, motor.joint, record.joints) for motor in robot.file.motors]
    motor_angle, link_angle = (
        np.asarray(angle, dtype=float)[:, columns]
        for angle in (record.motor_angle, record.link_angle)
    )
    torque = _torque(record, columns)
    gears = _gear_torque(record, columns)
    both = ~np.isnan(link_angle).all(axis=0)
    for name, angle in zip(robot.motor_names, link_angle.T, strict=True):
        if np.isnan(angle).any() and not np.isnan(angle).all():
            raise InvalidInput(f"link_angle of {name!r}: some samples are missing, others not")
    if not both.any():
        raise InvalidInput("link_angle: no joint has an encoder behind its gear")
    link_angle = np.where(both, link_angle, motor_angle)
    _check_angles(robot, motor_angle, link_angle)
    return JointMovement(robot, record.sample_time, motor_angle, link_angle, torque, both, gears)


_FARTHEST = 0.2
"""How far angles of both sides, or an angle and its limits, may differ [rad]."""


def _check_angles(robot: ElasticRobot, motor_angle: Array, link_angle: Array) -> None:
    """Refuse angles with gaps, too different, or beyond the joints' limits."""
    low, high = robot.position_limits.T
    difference = np.abs(link_angle - motor_angle).max(axis=0)
    beyond = ((motor_angle < low - _FARTHEST) | (motor_angle > high + _FARTHEST)).any(axis=0)
    for j, name in enumerate(robot.motor_names):
        if not np.isfinite(motor_angle[:, j]).all():
            raise InvalidInput(f"motor_angle of {name!r}: not all samples are finite numbers")
        if difference[j] > _FARTHEST:
            raise InvalidInput(
                f"link_angle of {name!r} is up to {difference[j]:.3g} rad from the motor's; both "
                "must be in rad, on the joint's side of the gear, from the same zero"
            )
        if beyond[j]:
            raise InvalidInput(
                f"motor_angle of {name!r} leaves the joint's limits [{low[j]:.4g}, {high[j]:.4g}]: "
                "angles must be the robot's own, a start pose included"
            )


def _column(motor: str, joint: str, names: tuple[str, ...]) -> int:
    for name in (motor, joint):
        if name in names:
            return names.index(name)
    raise InvalidInput(
        f"record: neither motor {motor!r} nor its joint {joint!r} is among {', '.join(names)}"
    )


def _torque(record: JointHistories, columns: list[int]) -> Array | None:
    """Return the motor torques, or None where a record has none."""
    try:
        torque = np.asarray(record.motor_torque, dtype=float)[:, columns]
    except InvalidInput:
        return None
    return None if np.isnan(torque).all() else torque


def _gear_torque(record: JointHistories, columns: list[int]) -> Array:
    """Return what torque sensors of joints measure, (N, n), NaN where a record has none."""
    signals: Mapping[str, Array] = getattr(record, "signals", {})
    if "joint_torque" not in signals:
        return np.full((len(record.motor_angle), len(columns)), np.nan)
    return np.asarray(signals["joint_torque"], dtype=float)[:, columns]
