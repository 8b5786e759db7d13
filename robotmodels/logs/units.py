"""Units of channels and what they are in SI, through pint."""

import math
import re
from functools import cache
from tokenize import TokenError
from typing import Any

from robotmodels.common.errors import InvalidInput
from robotmodels.logs.optional_library import optional_library

SI: dict[str, tuple[str, str]] = {
    "motor_angle": ("rad", "m"),
    "motor_velocity": ("rad/s", "m/s"),
    "motor_acceleration": ("rad/s^2", "m/s^2"),
    "motor_torque": ("N*m", "N"),
    "motor_current": ("A", "A"),
    "link_angle": ("rad", "m"),
    "link_velocity": ("rad/s", "m/s"),
    "joint_torque": ("N*m", "N"),
    "reference_angle": ("rad", "m"),
    "reference_velocity": ("rad/s", "m/s"),
    "reference_torque": ("N*m", "N"),
    "accelerometer": ("m/s^2", "m/s^2"),
}
"""Unit of a role, on a joint that turns and on one that slides."""

_SPELLINGS = {
    "Nm": "N*m",
    "N-m": "N*m",
    "mNm": "mN*m",
    "kNm": "kN*m",
    "Ncm": "N*cm",
    "Grad": "deg",  # to pint a billion radians
    "°": "deg",
    **dict.fromkeys(("deg", "degs", "degree", "degrees"), "deg"),
    **dict.fromkeys(("rad", "rads", "radian", "radians"), "rad"),
    **dict.fromkeys(("rev", "revs", "turns"), "turn"),
    **dict.fromkeys(("inc", "incs", "increments", "pulse", "pulses", "pls"), "counts"),
    **dict.fromkeys(("amp", "amps", "ampere", "arms", "a_rms"), "A"),
    "rpm": "rpm",
    "sec": "s",
}
_GRAVITIES = {"g": "standard_gravity", "G": "standard_gravity", "mg": "millistandard_gravity"}
_SCALED = re.compile(r"(\d*\.?\d+(?:[eE][+-]?\d+)?)[\s*]*((?:[^\W\d]|[%‰°]).*)")
_SHARES = {"%": 1e-2, "percent": 1e-2, "‰": 1e-3, "permille": 1e-3}

_TURNS_A_MINUTE = ("1/min", "min^-1", "min-1", "U/min", "r/min", "rev/min", "tr/min", "giri/min")
"""As people write the speed of a motor; to pint some of them are frequencies."""


def unit_factor(unit: str, role: str, sliding: bool, per_turn: float | None = None) -> float:
    """Return what one of a unit is in the unit of a role.

    Parameters
    ----------
    unit : str
        As pint or people write it; ``counts`` with `per_turn`.
    sliding : bool
        Whether the joint slides.
    per_turn : float, optional
        Counts in a turn.

    Raises
    ------
    InvalidInput
        If the unit is unknown or of another kind of quantity.
    """
    registry = _registry()
    scale, text = _scaled(unit)
    text = _spelled(text, role)
    if text.startswith("count"):
        if per_turn is None:
            raise InvalidInput(f"unit {unit!r} of {role}: counts_per_turn is missing")
        text = text.replace("counts", "turn").replace("count", "turn")
    quantity = _quantity(registry, text, unit)
    if role == "other":
        return scale * float(quantity.to_base_units().magnitude)
    # The motor of a joint that slides turns.
    goals = SI[role] if sliding else SI[role][:1]
    for goal in reversed(goals):
        goal_unit = registry.Unit(goal)
        if quantity.dimensionality == goal_unit.dimensionality:
            factor = scale * float(quantity.to(goal_unit).magnitude)
            return factor / per_turn if per_turn is not None else factor
    raise InvalidInput(f"unit {unit!r} is none of {role}, which is in {' or '.join(goals)}")


def full_scale_share(unit: str) -> float | None:
    """Return what part of the full scale one of a unit is, such as %, None if it is none of it."""
    scale, text = _scaled(unit)
    return scale * _SHARES[text] if text in _SHARES else None


def is_counts(unit: str) -> bool:
    """Return whether a unit is counts of an encoder, as people write them."""
    return _spelled(_scaled(unit)[1], "motor_angle").startswith("count")


def stated_unit(unit: str, role: str) -> str:
    """Return the unit that a file states, counts too, empty if it is none of the role."""
    text = unit.partition("(")[0].strip()
    if not text or role == "other":
        return text
    try:
        unit_factor(text, role, sliding=True, per_turn=1.0)
    except InvalidInput:
        return ""
    return text


def time_factor(unit: str) -> float:
    """Return what one of a unit of time is in seconds."""
    scale, text = _scaled(unit)
    quantity = _quantity(_registry(), text, unit) if text not in _SECONDS else None
    factor = scale * (
        _SECONDS.get(text)
        or (
            float(quantity.to("s").magnitude)
            if quantity is not None and quantity.check("[time]")
            else math.nan
        )
    )
    if math.isnan(factor):
        raise InvalidInput(f"unit {unit!r} of the time is none of time; s, ms, us or ns is")
    return factor


# What pint raises over texts that are no units, beside its own errors.
_OF_PINT = (ArithmeticError, AssertionError, AttributeError, LookupError, SyntaxError, TypeError,
            ValueError)  # fmt: skip
_SECONDS = {"": 1.0, "s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "sec": 1.0}


@cache
def _registry() -> Any:
    return optional_library("pint", "units of channels").UnitRegistry()


def _scaled(unit: str) -> tuple[float, str]:
    """Return number and unit of ``0.229 rpm``."""
    text = unit.strip().strip("[]()")
    match = _SCALED.fullmatch(text)
    return (float(match[1]), match[2]) if match else (1.0, text)


def _spelled(unit: str, role: str) -> str:
    text = unit.strip().strip("[]()").replace("²", "^2").replace("·", "*").replace("°", "deg")
    if role == "accelerometer" and text in _GRAVITIES:
        return _GRAVITIES[text]
    if text.replace(" ", "") in _TURNS_A_MINUTE:
        return "rpm"
    head, slash, tail = text.partition("/")
    head = _SPELLINGS.get(head.strip()) or _SPELLINGS.get(head.strip().lower(), head)
    tail = re.sub(r"s\^?2$", "s^2", tail.strip().replace("sec", "s"))
    return f"{head}{slash}{tail}"


def _quantity(registry: Any, text: str, unit: str) -> Any:
    import pint
    from pint.errors import PintError

    try:
        quantity = registry.Quantity(1.0, text)
        if not isinstance(quantity, pint.Quantity) or not text.strip():
            raise TypeError("no unit")
    except (PintError, TokenError, *_OF_PINT) as error:
        raise InvalidInput(
            f"unit {unit!r} is unknown ({str(error)[:80]}); deg, rad, rev, rpm, N*m, A are some"
        ) from None
    return quantity
