"""Payload and friction from motor torques: what the rotor, the links and friction leave over.

Motor torque (on the joint's side) = rotor inertia x ratio^2 x acceleration + gear torque
+ coulomb sign(speed) + viscous speed + offset; the gear torque is linear in the payload's mass.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimators.deflection.assumptions import DeflectionAssumptions
from estimators.deflection.joint_movement import SmoothMovement
from estimators.logs.correlated_regression import Regression, Series, regress
from robotmodels.common.arrays import Array, BoolArray
from robotmodels.elastic.inverse_dynamics import MovementTorques

_FEWEST = 12  # means that a regression needs
_WEIGHT = 0.5
"""Share of gravity in a payload's torque above which a joint tells its mass. What only accelerates
it tells inertia, which the links' inertias and the torque's scale disguise."""


@dataclass(frozen=True, eq=False)
class LoadBalance:
    """The balance of one motor's torques.

    Attributes
    ----------
    motor : int
        Which motor.
    regression : Regression
        Coefficients: payload mass [kg] where it is estimated, coulomb [N m], viscous [N m s/rad] on
        the joint's side, offsets of the records [N m].
    with_payload : bool
        Whether the payload is among them.
    torque : float, N m
        Root mean square of the motor torque about its mean.
    """

    motor: int
    regression: Regression
    with_payload: bool
    torque: float

    @property
    def friction(self) -> tuple[float, float]:
        """Coulomb [N m] and viscous friction [N m s/rad] on the joint's side."""
        first = int(self.with_payload)
        coulomb, viscous = self.regression.coefficients[first : first + 2]
        return float(coulomb), float(viscous)


def gear_torque(torques: MovementTorques, at: DeflectionAssumptions, mass: float) -> Array:
    """Return the torque of the gears, (N, n), with a payload of `mass` [kg]."""
    links = at.link_mass * torques.links + torques.friction
    return np.asarray(links + at.counterbalance * torques.counterbalances + mass * torques.payload)


def balances(
    movements: Sequence[SmoothMovement],
    torques: Sequence[MovementTorques],
    at: DeflectionAssumptions,
    payload: float | None,
    extra: "Sequence[Sequence[Array]] | None" = None,
) -> tuple[LoadBalance, ...]:
    """Return the balance of each motor with torques and encoders on both sides.

    `payload` is the mass where it is not estimated; `extra` holds further regressors, for each
    record and motor (N, k).
    """
    first = movements[0].measured
    measured = first.on_both_sides & np.all(
        [np.isfinite(m.torque).all(axis=0) for m in movements if m.torque is not None], axis=0
    )
    motors = [int(j) for j in np.flatnonzero(measured) if moves(movements, int(j), at)]
    weighing = [j for j in motors if payload is None and tells_weight(torques, j)]
    each = {j: _balance(j, movements, torques, at, None, extra) for j in weighing}
    mass = payload_mass(tuple(each.values()))[0] if weighing else payload
    for j in motors:
        each.setdefault(j, _balance(j, movements, torques, at, mass or 0.0, extra))
    return tuple(each[j] for j in motors)


def payload_mass(balanced: Sequence[LoadBalance]) -> tuple[float, float]:
    """Return the payload's mass and its standard deviation [kg], motors weighted by variances.

    The standard deviation is that from noise, no less than the motors' disagreement tells.
    """
    each = [b.regression for b in balanced if b.with_payload]
    masses = np.array([regression.coefficients[0] for regression in each])
    stds = np.array([regression.std(0) for regression in each])
    mass = float(np.average(masses, weights=stds**-2.0))
    spread = np.sum(((masses - mass) / stds) ** 2) / max(len(masses) - 1, 1)
    return mass, float(np.sum(stds**-2.0) ** -0.5 * np.sqrt(max(spread, 1.0)))


def _balance(
    j: int,
    movements: Sequence[SmoothMovement],
    torques: Sequence[MovementTorques],
    at: DeflectionAssumptions,
    payload: float | None,
    extra: "Sequence[Sequence[Array]] | None",
) -> LoadBalance:
    motor = movements[0].measured.robot.file.motors[j]
    reflected, estimated = motor.inertia * motor.gear_ratio**2, payload is None
    series, levels = [], []
    for i, (movement, parts) in enumerate(zip(movements, torques, strict=True)):
        assert movement.torque is not None  # the caller has it checked
        time = movement.measured.time
        speed, acceleration = (movement.motor(time, order)[:, j] for order in (1, 2))
        used = moving(movement, speed, at)
        load = at.torque_scale * movement.torque[:, j] - reflected * acceleration
        load -= gear_torque(parts, at, payload or 0.0)[:, j]
        columns = [np.sign(speed), speed]
        if estimated:
            columns.insert(0, parts.payload[:, j])
        if extra is not None:
            columns.extend(extra[i][j].T)
        ones = np.ones((len(load), 1))
        series.append(Series(load, np.stack(columns, axis=1), ones, used, block(movement, at)))
        levels.append(movement.torque[used, j] - movement.torque[used, j].mean())
    level = np.sqrt(np.mean(np.concatenate(levels) ** 2))
    return LoadBalance(j, regress(series), estimated, float(level))


def tells_weight(torques: Sequence[MovementTorques], j: int) -> bool:
    """Return whether gravity makes most of what the payload asks of motor `j`."""
    total = np.concatenate([parts.payload[:, j] for parts in torques])
    weight = np.concatenate([parts.payload_weight[:, j] for parts in torques])
    return bool(np.sum(weight**2) > _WEIGHT**2 * np.sum(total**2)) and bool(np.any(weight))


def moving(movement: SmoothMovement, speed: Array, at: DeflectionAssumptions) -> BoolArray:
    """Return which samples count: fast enough, and not at the filter's ends."""
    return np.asarray(movement.inside & (np.abs(speed) > at.least_speed))


def moves(movements: Sequence[SmoothMovement], j: int, at: DeflectionAssumptions) -> bool:
    """Return whether motor `j` moves long enough for covariances."""
    seconds = 0.0
    for movement in movements:
        speed = movement.motor(movement.measured.time, 1)[:, j]
        seconds += movement.measured.sample_time * np.count_nonzero(moving(movement, speed, at))
    return seconds >= _FEWEST * at.averaging


def block(movement: SmoothMovement, at: DeflectionAssumptions) -> int:
    """Return the number of samples in a mean."""
    return max(round(at.averaging / movement.measured.sample_time), 1)
