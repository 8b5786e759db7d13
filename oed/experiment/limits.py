"""What an excitation may not exceed, and the room that it leaves around an operating point."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput

UNITS = {
    "torque": "N m",
    "speed": "rad/s",
    "position": "rad",
    "swing": "rad",
    "rms_torque": "N m",
    "command_speed": "rad/s",
    "command_acceleration": "rad/s^2",
}
"""Quantities with a limit, in the order of arrays, and their units."""

_ATTRIBUTES = {"position": "positions"}
_TORQUE, _POSITION, _RMS = (
    list(UNITS).index(name) for name in ("torque", "position", "rms_torque")
)


@dataclass(frozen=True, eq=False)
class Limits:
    """Limits of an experiment; None for no limit.

    Attributes
    ----------
    torque : ndarray or None, (n,), N m
        Motor shaft, holding the arm against gravity included.
    speed : ndarray or None, (n,), rad/s
        Motor shaft.
    positions : ndarray or None, (n, 2)
        Motor angle over gear ratio, [rad] or [m].
    swing : ndarray or None, (n,)
        Deviation from the position, as `positions`.
    rms_torque : ndarray or None, (n,), N m
        Root mean square over a period, motor shaft, holding the arm against gravity included: what
        a motor bears for long without heat (its continuous torque).
    command_speed, command_acceleration : ndarray or None, (n,), rad/s and rad/s^2
        Of the speed reference, motor shaft; its acceleration is the step from sample to sample.
    """

    torque: Array | None = None
    speed: Array | None = None
    positions: Array | None = None
    swing: Array | None = None
    rms_torque: Array | None = None
    command_speed: Array | None = None
    command_acceleration: Array | None = None

    def bounds(self, motors: Sequence[str]) -> Array:
        """Return lower and upper bounds, (quantities, n, 2), infinite where there is none.

        Raises
        ------
        InvalidInput
            If there is no limit, or one has a wrong shape or sign.
        """
        n = len(motors)
        bounds = np.broadcast_to([-np.inf, np.inf], (len(UNITS), n, 2)).copy()
        for k, quantity in enumerate(UNITS):
            name = _ATTRIBUTES.get(quantity, quantity)
            value = getattr(self, name)
            if value is None:
                continue
            limit = np.asarray(value, dtype=float)
            shape = (n, 2) if name == "positions" else (n,)
            if limit.shape != shape:
                raise InvalidInput(f"limits.{name}: shape {limit.shape}; {shape} is needed")
            bounds[k] = limit if name == "positions" else np.stack([-limit, limit], axis=-1)
            _check_bounds(name, motors, bounds[k])
        if not np.isfinite(bounds).any():
            raise InvalidInput("limits: none given; any amplitude would do")
        return bounds


def _check_bounds(name: str, motors: Sequence[str], bounds: Array) -> None:
    """Refuse ranges that are empty."""
    for motor, (low, high) in zip(motors, bounds, strict=True):
        if not low < high:
            values = f"[{low:g}, {high:g}]" if name == "positions" else f"{high:g}"
            right = "low < high" if name == "positions" else "a positive number"
            raise InvalidInput(f"limits.{name} of motor {motor!r}: {values}; {right} is needed")


def room(
    bounds: Array,
    operating_point: Array,
    friction: Array,
    motors: Sequence[str],
    visits: Sequence[str],
) -> Array:
    """Return distances (V, quantities, n, 2) from operating point to both bounds, less friction.

    Parameters
    ----------
    bounds : ndarray, (quantities, n, 2)
        As of `Limits.bounds`.
    operating_point : ndarray, (V, 3, n)
        Holding torque, zero speed and position.
    friction : ndarray, (n,), N m
        Coulomb friction, which torques overcome beside.
    motors : sequence of str
        Names of the motors.
    visits : sequence of str, (V,)
        How errors call each visit.

    Raises
    ------
    InvalidInput
        Naming position, motor and limit, if the operating point is not inside.
    """
    center = np.zeros((len(operating_point), *bounds.shape[:2]))
    center[:, :3] = operating_point
    hold = operating_point[:, _TORQUE]
    free = np.tile(bounds, (len(center), 1, 1, 1))
    free[:, _TORQUE] += np.outer(friction, [1.0, -1.0])
    # The square mean of holding, and of all else with friction at its worst, add up.
    thermal = np.sqrt(np.maximum(bounds[_RMS, :, 1] ** 2 - hold**2, 0)) - friction
    free[:, _RMS] = np.stack([-thermal, thermal], axis=-1)
    inside = (free[..., 0] < center) & (center < free[..., 1])
    if not inside.all():
        visit, k, motor = np.argwhere(~inside)[0]
        low, high = bounds[k, motor]
        name = f"{visits[visit]}: motor {motors[motor]!r}"
        if k == _POSITION:
            raise InvalidInput(
                f"limits.positions: {name} at {center[visit, k, motor]:.4g} is not inside its "
                f"limits [{low:.4g}, {high:.4g}], which leaves no room to move"
            )
        rubbing = friction[motor]
        beside = f" and {rubbing:.4g} N m against friction" if rubbing else ""
        raise InvalidInput(
            f"limits.{list(UNITS)[k]}: {name} needs {abs(hold[visit, motor]):.4g} N m to hold the "
            f"arm alone{beside}, which leaves nothing of its limit {high:.4g} N m"
        )
    return np.asarray(np.abs(free - center[..., None]))


def beside_carrier(free: Array, used: Array, motors: Sequence[str], visits: Sequence[str]) -> Array:
    """Return the room that a carrier leaves of `free`, as if all peaks came at once.

    Parameters
    ----------
    free, used : ndarray, (V, quantities, n, 2)
        Room, see `room`, and what the carrier takes of it.
    motors, visits : sequence of str
        As of `room`.

    Raises
    ------
    InvalidInput
        Naming visit, motor and limit, if it leaves nothing.
    """
    if (used >= free).any():
        worst = np.unravel_index((used / free).argmax(), free.shape)
        visit, k, motor = (int(i) for i in worst[:3])
        quantity, unit = list(UNITS.items())[k]
        raise InvalidInput(
            f"carrier: {visits[visit]}: {quantity} of motor {motors[motor]!r} takes "
            f"{used[worst]:.4g} {unit} of the {free[worst]:.4g} that limits leave; a lower speed, "
            "or a higher frequency for a smaller range, is needed"
        )
    return np.asarray(free - used)
