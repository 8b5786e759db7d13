"""Units and sides of the gear that fit the numbers: by ranges and by derivatives."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput
from robotmodels.logs.survey import JUMP, wraps
from robotmodels.logs.units import unit_factor

ANGLES = {"rad": 1.0, "deg": np.pi / 180, "turn": 2 * np.pi, "mrad": 1e-3, "m": 1.0, "mm": 1e-3}
RATES = {
    "rad/s": 1.0,
    "deg/s": np.pi / 180,
    "rpm": 2 * np.pi / 60,
    "turn/s": 2 * np.pi,
    "mrad/s": 1e-3,
    "m/s": 1.0,
    "mm/s": 1e-3,
}
_NEAR = 0.02  # in the logarithm
_SLACK = 0.02  # of the range of a joint, beyond its limits
_USUAL = ("rad", "deg", "m", "mm", "turn", "mrad")
_LANDMARK, _MOST_TURNS = 2e-3, 8  # of 45 degrees
_MOST_ANGLE = 2.1 * np.pi  # [rad], of joints without limits


@dataclass(frozen=True)
class Hypothesis:
    """A unit on a side of the gear."""

    unit: str
    side: str


def usual_angle_unit(unit: str) -> str:
    """Return the usual name of a unit of angles, such as deg for °, empty if there is none."""
    if not unit or unit in ANGLES:
        return unit
    try:
        factor = unit_factor(unit, "motor_angle", sliding=True)
    except InvalidInput:
        return ""
    return next((name for name, size in ANGLES.items() if np.isclose(size, factor, 1e-9, 0)), "")


def without_jumps(values: Array, unit: str) -> Array:
    """Return angles, (N, n), without their jumps by whole turns, as they are without a unit."""
    if not unit or unit in ("m", "mm"):
        return values
    turn = 2 * np.pi / ANGLES[unit]
    steps = np.diff(values, axis=0, prepend=values[:1])
    by_turns = np.where(np.abs(steps) > JUMP * turn, steps, 0.0) / turn
    for column, jumps in enumerate(by_turns.T):
        usual = np.abs(steps[:, column][jumps == 0]) / turn
        span = float(np.ptp(values[:, column])) / turn
        if not wraps(jumps[jumps != 0], span, float(np.nanmax(usual, initial=0.0))):
            by_turns[:, column] = 0.0
    return np.asarray(values - turn * np.cumsum(np.rint(by_turns), axis=0))


def angle_hypotheses(
    spans: Array,
    ratios: Array,
    limits: Array | None,
    unit: str,
    sides: Sequence[str],
    start: Array | None = None,
    wrapped: bool = False,
) -> list[Hypothesis]:
    """Return units and sides under which all angles lie within the limits of their joints.

    Parameters
    ----------
    spans : ndarray, (n, 2)
        Least and largest value of each channel.
    ratios : ndarray, (n,)
        Gear ratios, NaN where unknown.
    limits : ndarray, (n, 2) or None, rad
        Of the joints.
    unit : str
        Where it is stated, else empty.
    sides : sequence of {"joint", "motor"}
        Sides that are possible.
    start : ndarray, (n,), optional
        First values; where they are multiples of 45 degrees, that is no chance.
    wrapped : bool
        Whether jumps were taken out, so that whole turns mean nothing.

    Returns
    -------
    list of Hypothesis
        Those under which a robot starts at multiples of 45 degrees first, then the usual ones.
    """
    names = [unit] if unit in ANGLES else ["rad", "deg", "turn"]
    scored: list[tuple[int, int, Hypothesis]] = []
    for side, name in product(sides, names):
        scale = ANGLES[name] * (1 / ratios if side == "motor" else np.ones(len(ratios)))
        if np.isfinite(scale).all():
            angles = np.sort(spans * scale[:, None], axis=1)
            marks = 0 if start is None else _landmarks(start * scale)
            fit = _fits(angles, limits)
            if fit < 2 and limits is not None and wrapped and side == "joint":
                turns = np.rint((limits.mean(axis=1) - angles.mean(axis=1)) / (2 * np.pi))
                fit = max(fit, _fits(angles + 2 * np.pi * turns[:, None], limits))
            scored.append((fit, marks, Hypothesis(name, side)))
    best = max((fit for fit, _, _ in scored), default=0)
    likely = [(marks, h) for fit, marks, h in scored if fit == best > 0]
    likely.sort(key=lambda pair: (-pair[0], *_rarity(pair[1])))
    return [hypothesis for _, hypothesis in likely]


def _rarity(hypothesis: Hypothesis) -> tuple[bool, bool, int]:
    """Return what is the smaller the more usual a unit and its side are."""
    unit, side = hypothesis.unit, hypothesis.side
    return unit == "turn", side == "motor", _USUAL.index(unit)


def _landmarks(angles: Array) -> int:
    """Return how many angles are multiples of 45 degrees, zero apart."""
    turns = angles / (np.pi / 4)
    near = np.abs(turns - np.rint(turns)) < _LANDMARK
    return int((near & (np.rint(turns) != 0) & (np.abs(turns) < _MOST_TURNS)).sum())


def rate_hypotheses(factor: float, angle_unit: str, ratio: float) -> list[tuple[float, Hypothesis]]:
    """Return units of a rate whose integral is a joint's angle divided by `factor`.

    Parameters
    ----------
    factor : float
        Rate over derivative of the angle, sign included.
    angle_unit : str
        Unit of the angle.
    ratio : float
        Motor turns per turn of the angle, NaN where unknown, 1 where both are on one side.

    Returns
    -------
    list of (float, Hypothesis)
        Distance in the logarithm, and unit; those within 2 %, the nearest first. The side is
        "same" as that of the angle, or "motor" where the rate is on the other side of the gear.
    """
    scored = []
    for name, size in RATES.items():
        if (name[0] == "m" and name[1] in "/m") != (angle_unit in ("m", "mm")):
            continue
        for side, gear in (("same", 1.0), ("motor", abs(ratio))):
            if side == "motor" and not (np.isfinite(gear) and abs(np.log(gear)) > _NEAR):
                continue
            expected = ANGLES.get(angle_unit, 1.0) / size * gear
            distance = abs(float(np.log(abs(factor) / expected)))
            if distance < _NEAR:
                scored.append((distance, Hypothesis(name, side)))
    return sorted(scored, key=lambda pair: pair[0])


def torque_side(peak: Array, ratios: Array, mass: float) -> str:
    """Return the side that torques belong to by their size, against a robot's weight at one metre.

    Parameters
    ----------
    peak : ndarray, (n,), N m
        Largest torque of each joint.
    ratios : ndarray, (n,)
        Gear ratios.
    mass : float, kg
        Of the moving links.
    """
    weight = 9.81 * mass * 0.5
    largest = int(np.nanargmax(peak * np.abs(ratios)))
    joint = abs(np.log(peak[largest] / weight))
    motor = abs(np.log(peak[largest] * abs(ratios[largest]) / weight))
    return "joint" if joint <= motor else "motor"


def _fits(angles: Array, limits: Array | None) -> int:
    """Return 2 where angles lie within limits, 1 where they may from a start pose, else 0."""
    if limits is None:
        return 2 * bool(np.abs(angles).max() <= _MOST_ANGLE)
    width = limits[:, 1] - limits[:, 0]
    low, high = limits[:, 0] - _SLACK * width, limits[:, 1] + _SLACK * width
    if ((angles[:, 0] >= low) & (angles[:, 1] <= high)).all():
        return 2
    begun = (np.ptp(angles, axis=1) <= width) & (angles[:, 0] <= _NEAR) & (angles[:, 1] >= -_NEAR)
    return int(begun.all())
