"""Channels that differ only in a joint, and the role that their names suggest."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from robotmodels.common.errors import InvalidInput
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.logs.log import Log, Table
from robotmodels.logs.units import unit_factor

_WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|%")


def _set(text: str) -> frozenset[str]:
    return frozenset(text.split())


_QUANTITIES: dict[str, frozenset[str]] = {
    "torque": _set(
        "tau torque torques trq torq effort efforts moment drehmoment force mom couple coppia"
    ),
    "current": _set("current currents curr cur i iq strom amp courant corriente corrente"),
    "acceleration": _set("acceleration acc accel ddq qdd accelerations beschleunigung"),
    "velocity": _set(
        "velocity velocities velo vel speed speeds qd dq qvel omega geschwindigkeit drehzahl rpm "
        "qdot dqdt v rate vitesse velocidad velocita"
    ),
    "angle": _set(
        "position positions pos q qpos angle angles theta phi enc encoder winkel lage posicion "
        "posizione impulse pulse pulses resolver"
    ),
}
_REFERENCE = _set("target ref reference des desired cmd command commanded setpoint set soll goal r")
_LINK = _set("link load se secondary output abtrieb second")
_IGNORED = _set(
    "error err diff deviation temperature temp mode status flag "
    "ff ext external cos sin gripper filtered tcp tool pose wrench cartesian"
)
_MEASURED = _set(
    "act actual meas measured msr ist abs state states observation observations obs fb feedback"
)
_LESS = _set("rel computed calculated estimated predicted model simulated sim")
_BARE = _set("joint joints j a axis achse motor m")
_COMMANDS = _set("action actions command commands commanded cmd target desired reference setpoint")
_UNITS = {
    "deg": "deg",
    "grad": "deg",
    "rad": "rad",
    "rpm": "rpm",
    "rev": "turn",
    "nm": "N*m",
    "mnm": "mN*m",
    "ma": "mA",
    "amp": "A",
    "counts": "counts",
    "inc": "counts",
}


@dataclass(frozen=True, eq=False)
class Family:
    """Channels of one quantity, a joint each.

    Attributes
    ----------
    table : Table
        Table that has them.
    pattern : str
        Their common name, ``*`` for what differs.
    channels : tuple of str
        Names, joints in rising order.
    role : str
        Role by the names, empty where they tell none.
    unit : str
        Unit that names or file tell, else empty.
    rank : int
        How clearly names tell that this was measured; the largest wins.
    joints : tuple of str
        Motors of the robot that the names tell, else empty.
    by_default : bool
        Whether the role is that of bare names, where no name tells one.
    """

    table: Table
    pattern: str
    channels: tuple[str, ...]
    role: str
    unit: str
    rank: int
    joints: tuple[str, ...] = field(default=())
    by_default: bool = False


def families(log: Log, robot: ElasticRobot | None) -> list[Family]:
    """Return all families of a log in the order of its channels."""
    motors = dict(zip(robot.motor_joints, robot.motor_names, strict=True)) if robot else {}
    groups: dict[tuple[int, str], list[tuple[str, str]]] = {}
    tables: dict[int, Table] = {}
    for number, table in enumerate(log.tables):
        tables[number] = table
        for channel in table.channels:
            skeleton, joint = _skeleton(channel, motors)
            groups.setdefault((number, skeleton), []).append((channel, joint))
    return [
        _family(tables[number], skeleton, members, motors)
        for (number, skeleton), members in groups.items()
    ]


def words(text: str) -> list[str]:
    """Return the words of a name in small letters, also of camelCase and q_d."""
    return [word.lower() for word in _WORD.findall(text)]


def is_bare(family: Family) -> bool:
    """Return whether a name tells nothing but joints or a state, as of angles it often does."""
    return set(words(family.pattern.rpartition(".")[2])) <= _BARE | _MEASURED


def _skeleton(channel: str, motors: dict[str, str]) -> tuple[str, str]:
    """Return a name with its joint replaced by ``*``, and the motor, if names tell it."""
    for joint in sorted(motors, key=len, reverse=True):
        if joint in channel:
            return channel.replace(joint, "*", 1), motors[joint]
    return re.sub(r"\d+", "*", channel), ""


def _family(
    table: Table, pattern: str, members: Sequence[tuple[str, str]], motors: dict[str, str]
) -> Family:
    order = list(motors.values())
    named = all(joint for _, joint in members)
    key = (lambda m: (order.index(m[1]),)) if named else (lambda m: _numbers(m[0]))
    ranked = sorted(members, key=key)
    path, _, tail = pattern.rpartition(".")
    names, groups = [*words(tail), *words(table.name)], set(words(path))
    stated = table.channels[ranked[0][0]].unit
    unit = stated or _unit(names)
    role = _role(names, stated, bool(groups & _COMMANDS))
    measured = 2 * bool(_MEASURED & set(names)) - bool(_LESS & set(names))
    return Family(
        table=table,
        pattern=pattern,
        channels=tuple(channel for channel, _ in ranked),
        role=role,
        unit=unit if role else "",
        rank=2 * measured + bool(_MEASURED & groups),
        joints=tuple(joint for _, joint in ranked) if named else (),
    )


def _numbers(name: str) -> tuple[int, ...]:
    return tuple(int(number) for number in re.findall(r"\d+", name))


def _role(names: Sequence[str], unit: str, commanded: bool) -> str:
    present = set(names)
    if present & _MEASURED:
        present -= {"r"}  # part of a type or a robot's name then
    if present & _IGNORED:
        return ""
    quantity = next((q for q, synonyms in _QUANTITIES.items() if present & synonyms), "")
    quantity = quantity or _quantity_of(unit)
    if not quantity or (quantity == "angle" and unit in ("s", "ms")):
        return ""
    if commanded or present & _REFERENCE:
        return f"reference_{quantity}" if quantity in ("angle", "velocity", "torque") else ""
    if quantity in ("angle", "velocity") and present & _LINK:
        return f"link_{quantity}"
    return f"motor_{quantity}"


def _quantity_of(unit: str) -> str:
    """Return the quantity that a file's unit belongs to, empty if to none of a joint that turns."""
    for quantity in _QUANTITIES if unit else ():
        try:
            unit_factor(unit, f"motor_{quantity}", sliding=False, per_turn=1.0)
        except InvalidInput:
            continue
        return quantity
    return ""


def _unit(names: Sequence[str]) -> str:
    """Return the unit in the words of a name: ``deg per s`` is deg/s."""
    unit = next((_UNITS[word] for word in names if word in _UNITS), "")
    if unit and ("per", "s") in pairwise(names):
        return f"{unit}/s"
    return unit
