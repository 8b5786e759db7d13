"""Deflections of gears against their torques, and all that a record gives at given assumptions.

link angle(t + delay) - motor angle = offset - compliance x gear torque - hysteresis sign(speed);
the delay by Newton's method, since a late encoder adds -delay x speed. Viscous friction on the
link's side of the spring, if there is any, looks like a delay of friction over stiffness.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from estimators.deflection.assumptions import DeflectionAssumptions
from estimators.deflection.joint_movement import JointMovement, SmoothMovement
from estimators.deflection.load_balance import (
    LoadBalance,
    balances,
    block,
    gear_torque,
    moves,
    moving,
    payload_mass,
)
from estimators.logs.correlated_regression import Regression, Series, regress
from robotmodels.common.arrays import Array, BoolArray
from robotmodels.elastic.inverse_dynamics import MovementTorques

_ROUNDS = 3  # after two, delays change by less than a microsecond


@dataclass(frozen=True, eq=False)
class AxisDeflection:
    """The deflection of one gear.

    Attributes
    ----------
    motor : int
        Which motor drives it.
    regression : Regression
        Coefficients: compliance [rad/(N m)], hysteresis [rad], those of an eccentric encoder and of
        further regressors; then for each record the offset [rad] and, if estimated, what its delay
        still lacks [s].
    delays : ndarray, (R,), s
        Delay of the link's encoder in each record.
    delays_std : ndarray, (R,), s
        Their standard deviations; zero where delays are not estimated.
    elastic, deflection : float, rad
        Root mean squares, about the mean, of what the gear's torque bends and of all of it.
    """

    motor: int
    regression: Regression
    delays: Array
    delays_std: Array
    elastic: float
    deflection: float

    @property
    def compliance(self) -> float:
        """Compliance of the gear [rad/(N m)]; below zero where the record says nothing on it."""
        return float(self.regression.coefficients[0])


@dataclass(frozen=True, eq=False)
class RecordEstimate:
    """What records give at given assumptions.

    Attributes
    ----------
    smooth : tuple of SmoothMovement
        The movements.
    torques : tuple of MovementTorques
        Torques behind them.
    balances : tuple of LoadBalance
        Balances of the motors' torques.
    axes : tuple of AxisDeflection
        Deflections of the gears.
    delays : ndarray, (R, n), s
        Delays of the encoders in each record.
    file_payload : float or None
        Mass that was not estimated [kg].
    """

    smooth: tuple[SmoothMovement, ...]
    torques: tuple[MovementTorques, ...]
    balances: tuple[LoadBalance, ...]
    axes: tuple[AxisDeflection, ...]
    delays: Array
    file_payload: float | None

    @cached_property
    def _mass(self) -> tuple[float, float]:
        return payload_mass(self.balances)

    @property
    def payload(self) -> float:
        """Mass of the payload [kg]."""
        return self._mass[0] if self.file_payload is None else self.file_payload

    @property
    def payload_std(self) -> float:
        """Its standard deviation from noise [kg]; zero where it was not estimated."""
        return self._mass[1] if self.file_payload is None else 0.0

    @property
    def results(self) -> Array:
        """Compliances, then delays, axis by axis, then the payload's mass: in one vector."""
        delays = [axis.delays for axis in self.axes]
        compliances = [axis.compliance for axis in self.axes]
        return np.concatenate([compliances, *delays, [self.payload]])


def estimate(
    movements: Sequence[JointMovement],
    at: DeflectionAssumptions,
    file_payload: float | None,
    nominal: RecordEstimate | None = None,
) -> RecordEstimate:
    """Return payload, friction, compliances and delays, of the same gears as a `nominal` one."""
    robot = at.robot(movements[0].robot)
    count, n = len(movements), len(robot.motor_names)
    smooth = tuple(replace(m, robot=robot).low_passed(at.low_pass) for m in movements)
    delays = np.zeros((count, n)) if nominal is None else nominal.delays.copy()
    gears = [j for j in sprung(movements[0]) if moves(smooth, j, at)]
    if nominal is not None:
        gears = [axis.motor for axis in nominal.axes]
    silent = any(s.torque is None for s in smooth)
    for _ in range(_ROUNDS if at.delays and nominal is None else 1):
        torques = tuple(s.torques(d) for s, d in zip(smooth, delays, strict=True))
        balanced = () if silent else balances(smooth, torques, at, file_payload)
        here = RecordEstimate(smooth, torques, balanced, (), delays.copy(), file_payload)
        axes = tuple(deflection(here, at, j) for j in gears)
        for axis in axes:
            delays[:, axis.motor] = axis.delays
    return RecordEstimate(smooth, torques, balanced, axes, delays, file_payload)


def sprung(movement: JointMovement) -> list[int]:
    """Return the motors with a drive spring and encoders on both sides of it."""
    springs = movement.robot.layout.drive_springs
    return [
        j for j, spring in enumerate(springs) if spring is not None and movement.on_both_sides[j]
    ]


def deflection(
    here: RecordEstimate, at: DeflectionAssumptions, j: int, extra: Sequence[Array] | None = None
) -> AxisDeflection:
    """Return the deflection of motor `j`'s gear; of each record, `extra` regressors (N, k)."""
    series = [
        _series(here, at, i, j, None if extra is None else extra[i])
        for i in range(len(here.smooth))
    ]
    regression = regress(series)
    shared, width = series[0].shared.shape[1], series[0].per_record.shape[1]
    steps = [shared + width * i + 1 for i in range(len(series))] if at.delays else []
    used = np.concatenate([s.used for s in series])
    targets, torque = (
        np.concatenate(parts)[used]
        for parts in ([s.target for s in series], [s.shared[:, 0] for s in series])
    )
    return AxisDeflection(
        motor=j,
        regression=regression,
        delays=here.delays[:, j] + (regression.coefficients[steps] if at.delays else 0.0),
        delays_std=np.array(
            [regression.std(k) for k in steps] if at.delays else np.zeros(len(series))
        ),
        elastic=float(np.std(torque) * abs(regression.coefficients[0])),
        deflection=float(np.std(targets)),
    )


@dataclass(frozen=True, eq=False)
class DeflectionHistory:
    """The deflection of one gear in one record.

    Attributes
    ----------
    time : ndarray, (N,), s
        Times of the samples.
    measured : ndarray, (N,), rad
        Link less motor angle, less offset and delay of the link's encoder.
    fitted : ndarray, (N,), rad
        What gear torque and hysteresis make of it.
    used : ndarray of bool, (N,)
        Which samples were fitted.
    """

    time: Array
    measured: Array
    fitted: Array
    used: BoolArray


def deflection_history(
    here: RecordEstimate, at: DeflectionAssumptions, axis: AxisDeflection, record: int
) -> DeflectionHistory:
    """Return the deflection of a gear in one of the records, beside what was fitted."""
    series = _series(here, at, record, axis.motor, None)
    shared, width = series.shared.shape[1], series.per_record.shape[1]
    first = shared + width * record
    coefficients = axis.regression.coefficients
    return DeflectionHistory(
        time=here.smooth[record].measured.time,
        measured=series.target - series.per_record @ coefficients[first : first + width],
        fitted=series.shared @ coefficients[:shared],
        used=series.used,
    )


def _series(
    here: RecordEstimate, at: DeflectionAssumptions, i: int, j: int, extra: Array | None
) -> Series:
    movement = here.smooth[i]
    angle, speed, _ = (part[:, j] for part in movement.links(here.delays[i]))
    bent = angle - movement.motor(movement.measured.time)[:, j]
    torque = gear_torque(here.torques[i], at, here.payload)[:, j]
    if movement.measured.senses_torque[j]:
        torque = movement.gear_torque[:, j]
    columns = [-torque, -np.sign(speed)]
    if at.eccentric:
        columns += [np.sin(angle), np.cos(angle)]
    if extra is not None:
        columns += list(extra.T)
    free = [np.ones_like(angle), -speed] if at.delays else [np.ones_like(angle)]
    used = moving(movement, speed, at)
    return Series(
        bent, np.stack(columns, axis=1), np.stack(free, axis=1), used, block(movement, at)
    )
