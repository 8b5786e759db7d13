"""What ``oed check`` is told: a position and a band, as words on the command line."""

from pathlib import Path

import numpy as np

from reports import text
from reports.summaries.columns import plain, plural
from robotmodels import ElasticRobot
from robotmodels.checks.warnings import Suspicion
from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput


def read_position(robot: ElasticRobot, words: str | None) -> Array:
    """Return a position (n,) [rad or m] from degrees (m at a prismatic joint), or mid-range.

    Raises
    ------
    InvalidInput
        If a word is not a number, there is not one per motor, or a joint is outside its limits.
    """
    limits = robot.position_limits
    if words is None:
        return np.asarray(limits.mean(axis=1))
    values = read_numbers("--position", words, "0,-90")
    joints = robot.motor_joints
    if len(values) != len(joints):
        raise InvalidInput(
            f"--position: {len(values)} given, {len(joints)} needed, one per motor: "
            f"{', '.join(joints)}"
        )
    units = [("m", 1.0) if j in robot.elements.prismatic else ("°", np.pi / 180) for j in joints]
    for value, joint, (low, high), (unit, factor) in zip(
        values, joints, limits, units, strict=True
    ):
        if not low - 1e-9 <= value * factor <= high + 1e-9:
            least, most = (plain(text.significant(x / factor, 4)) for x in (low, high))
            raise InvalidInput(
                f"--position: joint {joint!r} at {value:g}{unit.replace('m', ' m')} is outside "
                f"its limits, {least} to {most}{unit.replace('m', ' m')}"
            )
    return np.array([value * factor for value, (_, factor) in zip(values, units, strict=True)])


def read_band(words: str, option: str = "--band") -> tuple[float, float]:
    """Return the lowest and highest angular frequency [rad/s] from ``LOW,HIGH`` in Hz.

    Raises
    ------
    InvalidInput
        If these are not two rising positive numbers.
    """
    frequencies = read_numbers(option, words, "2,80")
    if len(frequencies) != 2:
        raise InvalidInput(f"{option}: {len(frequencies)} given, two are needed: LOW,HIGH in Hz")
    low, high = frequencies
    if not 0 < low < high < np.inf:
        raise InvalidInput(
            f"{option}: {low:g} to {high:g} Hz; two positive frequencies are needed, the lower "
            "first"
        )
    return 2 * np.pi * low, 2 * np.pi * high


def guesses(robot: str) -> list[Suspicion]:
    """Return that lines of a robot file are still marked as `oed init` wrote them; or nothing."""
    if not robot.endswith((".yaml", ".yml")):
        return []
    lines = Path(robot).read_text(encoding="utf-8").splitlines()
    marked = sum("# GUESS" in line and not line.lstrip().startswith("#") for line in lines)
    if not marked:
        return []
    message = f"{plural(marked, 'line')} of {robot} still marked GUESS; data sheets say better"
    return [Suspicion("guesses", (), message)]


def locked_followers(robot: ElasticRobot) -> list[Suspicion]:
    """Return which joints are locked although the model file couples them to one that moves."""
    return [
        Suspicion(
            "lock",
            (name,),
            f"{name} is locked, but follows {leader} in the model file (mimic), which moves",
        )
        for name, leader in robot.locked_followers.items()
    ]


def read_numbers(option: str, words: str, example: str) -> list[float]:
    """Return numbers of an option, parted by commas.

    Raises
    ------
    InvalidInput
        If a word is no number.
    """
    try:
        return [float(word) for word in words.split(",")]
    except ValueError:
        raise InvalidInput(
            f"{option}: {words!r} is not a list of numbers such as {example}"
        ) from None
