"""A mapping applied to a log: which channel is which signal of which joint, by which factor."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput, check_word, naming, nearest
from robotmodels.data_files.file_guard import listed
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.logs.log import Log, Table
from robotmodels.logs.mapping_file import Mapping, Signal
from robotmodels.logs.units import full_scale_share, stated_unit, unit_factor

JOINTLESS = ("accelerometer", "other")
_FORCES = ("motor_torque", "reference_torque")
_SIDED = (*_FORCES, "motor_angle", "motor_velocity", "motor_acceleration", "reference_angle")
SIDED = (*_SIDED, "reference_velocity")
"""Roles that may be measured on either side of the gear."""


@dataclass(frozen=True, eq=False)
class BoundSignal:
    """One channel with its meaning.

    Attributes
    ----------
    role : str
        Role, see `mapping_file`.
    joint : int
        Index of the joint, -1 for what belongs to none.
    name : str
        Name of the joint, or of a signal of none.
    table, channel : Table, str
        Where its values are.
    unit, factor : str, float
        Unit, and what one of the channel is in SI on the joint's side, sign included.
    turn : float
        Size of a jump by a whole turn, in the unit of the channel, 0 where there are none.
    entry : Signal
        Entry of the mapping that it comes from.
    """

    role: str
    joint: int
    name: str
    table: Table
    channel: str
    unit: str
    factor: float
    turn: float
    entry: Signal


@dataclass(frozen=True, eq=False)
class Binding:
    """All signals of a mapping.

    Attributes
    ----------
    joints : tuple of str
        Joints that the log has.
    ratios : ndarray, (n,)
        Gear ratios, NaN where nobody states one.
    signals : tuple of BoundSignal
        Signals.
    mixing : ndarray, (n, n)
        Joint angles by motor angles over ratios; identity without couplings.
    """

    joints: tuple[str, ...]
    ratios: Array
    signals: tuple[BoundSignal, ...]
    mixing: Array


def bind(mapping: Mapping, log: Log, robot: ElasticRobot | None) -> Binding:
    """Return what a mapping makes of a log's channels.

    Raises
    ------
    InvalidInput
        Naming the entry that does not fit the log or the robot, or what it leaves open.
    """
    joints = _joints(mapping, log, robot)
    ratios = _ratios(mapping, joints, robot)
    signals: list[BoundSignal] = []
    for number, entry in enumerate(mapping.signals):
        where = f"{log.where}: signals, entry {number + 1} ({listed(entry.patterns)})"
        channels = [hit for pattern in entry.patterns for hit in matches(log, pattern)]
        if not channels:
            names = [name for table in log.tables for name in table.channels]
            raise InvalidInput(
                f"{where}: no channel matches{nearest(entry.patterns[0], names)} (found: "
                f"{listed(names)})"
            )
        if entry.role in JOINTLESS:
            signals += _jointless(entry, channels, where)
        else:
            signals += _of_joints(entry, channels, joints, ratios, robot, where)
    _check_single(signals, log.where)
    return Binding(joints, ratios, tuple(signals), _mixing(mapping, joints, log.where))


def matches(log: Log, pattern: str) -> list[tuple[Table, str]]:
    """Return the channels of a pattern, those that differ in numbers in rising order."""
    hits = log.matching(pattern)
    alike = len({re.sub(r"\d+", "", name) for _, name in hits}) == 1
    return sorted(hits, key=lambda hit: _natural(hit[1])) if alike else hits


def _natural(name: str) -> list[tuple[int, str]]:
    parts = re.split(r"(\d+)", name)
    return [(int(p), "") if p.isdigit() else (-1, p) for p in parts]


def _joints(mapping: Mapping, log: Log, robot: ElasticRobot | None) -> tuple[str, ...]:
    if robot is None:
        if mapping.joints:
            return mapping.joints
        counts = [
            sum(len(matches(log, pattern)) for pattern in entry.patterns)
            for entry in mapping.signals
            if entry.role not in JOINTLESS
        ]
        return tuple(f"joint_{i + 1}" for i in range(max(counts, default=0)))
    motors = dict(zip(robot.motor_joints, robot.motor_names, strict=True))
    for name in mapping.joints:
        if name not in motors and name not in motors.values():
            near = nearest(name, [*motors, *motors.values()])
            raise InvalidInput(
                f"joints: {name!r} is no motor or joint of {robot.name}{near}; there are "
                f"{listed(motors.values())}"
            )
    return tuple(motors.get(name, name) for name in mapping.joints) or robot.motor_names


def _ratios(mapping: Mapping, joints: Sequence[str], robot: ElasticRobot | None) -> Array:
    if mapping.ratios:
        return _each(mapping.ratios, len(joints), "ratios")
    if robot is None:
        return np.full(len(joints), np.nan)
    stated = {motor.name: motor.gear_ratio for motor in robot.file.motors}
    return np.array([stated[name] for name in joints])


def _each(values: Sequence[float], count: int, what: str) -> Array:
    if len(values) not in (1, count):
        raise InvalidInput(f"{what}: {len(values)} numbers for {count} joints; {count} are needed")
    return np.broadcast_to(np.asarray(values, dtype=float), count)


def _jointless(
    entry: Signal, channels: Sequence[tuple[Table, str]], where: str
) -> list[BoundSignal]:
    signals = []
    for table, channel in channels:
        stated = table.channels[channel].unit if entry.role == "accelerometer" else ""
        unit = entry.unit or stated_unit(stated, entry.role)
        if not unit and entry.role == "accelerometer":
            raise InvalidInput(f"{where}: unit is missing; m/s^2 or g is")
        factor = unit_factor(unit, entry.role, sliding=False) if unit else 1.0
        name = entry.name if entry.name and len(channels) == 1 else channel
        sign = entry.sign if isinstance(entry.sign, int) else entry.sign[0]
        signals.append(
            BoundSignal(entry.role, -1, name, table, channel, unit, sign * factor, 0.0, entry)
        )
    return signals


def _of_joints(
    entry: Signal,
    channels: Sequence[tuple[Table, str]],
    joints: Sequence[str],
    ratios: Array,
    robot: ElasticRobot | None,
    where: str,
) -> list[BoundSignal]:
    indices = _indices(entry, channels, joints, robot, where)
    signs = _each(
        (entry.sign,) if isinstance(entry.sign, int) else entry.sign, len(indices), "sign"
    )
    signals = []
    for (table, channel), joint, sign in zip(channels, indices, signs, strict=True):
        unit = entry.unit or stated_unit(table.channels[channel].unit, entry.role)
        name = joints[joint]
        sliding = robot is None or _slides(robot, name)
        factor, turn = _unit(entry, unit, sliding, where)
        factor *= sign * _side_factor(entry, ratios[joint], name, where)
        signals.append(
            BoundSignal(entry.role, joint, name, table, channel, unit, factor, turn, entry)
        )
    return signals


def _unit(entry: Signal, unit: str, sliding: bool, where: str) -> tuple[float, float]:
    if (share := full_scale_share(unit)) is not None:
        if entry.full_scale is None:
            raise InvalidInput(f"{where}: unit {unit}: full_scale, 100 % in SI, is missing")
        return share * entry.full_scale, 0.0
    if not unit:
        raise InvalidInput(
            f"{where}: unit is missing, and the file states none; `oed import` without a mapping "
            "proposes one"
        )
    with naming(where):
        factor = unit_factor(unit, entry.role, sliding, entry.counts_per_turn)
    turns = entry.role.endswith("_angle") and not unit.strip("[]() ").endswith("m")
    return factor, 2 * np.pi / factor if turns else 0.0


def _side_factor(entry: Signal, ratio: float, joint: str, where: str) -> float:
    if entry.role not in SIDED or entry.side == "joint":
        return 1.0
    if entry.side is None:
        raise InvalidInput(
            f"{where}: side of the gear is missing; motor or joint is needed, and `oed import` "
            "without a mapping proposes one"
        )
    if not np.isfinite(ratio):
        raise InvalidInput(f"{where}: no gear ratio of {joint}; ratios or a robot is needed")
    return float(ratio if entry.role in _FORCES else 1 / ratio)


def _slides(robot: ElasticRobot, motor: str) -> bool:
    return not bool(robot.turning[robot.motor_names.index(motor)])


def _indices(
    entry: Signal,
    channels: Sequence[tuple[Table, str]],
    joints: Sequence[str],
    robot: ElasticRobot | None,
    where: str,
) -> list[int]:
    aliases = dict(zip(joints, joints, strict=True))
    if robot is not None:
        pairs = zip(robot.motor_joints, robot.motor_names, strict=True)
        aliases |= {joint: motor for joint, motor in pairs if motor in joints}
    for name in entry.names:
        check_word(f"{where}: joint", name, aliases)
    if entry.names:
        names = [aliases[name] for name in entry.names]
    else:
        names = _by_name([channel for _, channel in channels], aliases) or list(joints)
    if len(names) != len(channels):
        raise InvalidInput(
            f"{where}: {len(channels)} channels ({listed(c for _, c in channels)}) for "
            f"{len(names)} joints ({listed(names)}); one each is needed"
        )
    return [list(joints).index(name) for name in names]


def _by_name(channels: Sequence[str], aliases: dict[str, str]) -> list[str]:
    """Return the joint that each channel names, nothing unless all of them name one."""
    names = []
    for channel in channels:
        tail = channel.rpartition(".")[2]
        hits = [
            alias for alias in aliases if re.search(rf"(?<![^\W_]){re.escape(alias)}(?!\d)", tail)
        ]
        if not hits:
            return []
        names.append(aliases[max(hits, key=len)])
    return names if len(set(names)) == len(names) else []


def _check_single(signals: Sequence[BoundSignal], where: str) -> None:
    seen: dict[tuple[str, str], str] = {}
    for signal in signals:
        key = (signal.role, signal.name)
        if key in seen:
            raise InvalidInput(
                f"{where}: {signal.role} of {signal.name} is both {seen[key]!r} and "
                f"{signal.channel!r}; one channel is needed"
            )
        seen[key] = signal.channel


def _mixing(mapping: Mapping, joints: Sequence[str], where: str) -> Array:
    matrix = np.eye(len(joints))
    for row, shares in mapping.couplings.items():
        for column, share in shares.items():
            for name in (row, column):
                if name not in joints:
                    raise InvalidInput(f"{where}: couplings: {name!r} is no joint of the log")
            matrix[list(joints).index(row), list(joints).index(column)] += share
    if len(matrix) and np.linalg.cond(matrix) > 1e6:
        raise InvalidInput(
            f"{where}: couplings: a singular matrix; motors must determine the joints"
        )
    return np.asarray(np.linalg.inv(matrix), dtype=float)
