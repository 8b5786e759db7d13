"""A mapping proposed for a log without one, with the evidence for each entry."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from estimators.logs.angle_rules import propose_angles, propose_velocity
from estimators.logs.drive_rules import propose_drives, propose_references
from estimators.logs.families import Family, families, is_bare
from estimators.logs.findings import constant_findings
from estimators.logs.samples import TableTime, table_times
from estimators.logs.search import Entry, Search
from robotmodels.common.errors import InvalidInput
from robotmodels.data_files.file_guard import listed
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.logs.clocks import clock_messages
from robotmodels.logs.log import Log
from robotmodels.logs.mapping_file import Mapping, TimeChoice
from robotmodels.logs.stamp_pairs import stamp_parts

_ROLES = (
    "motor_angle",
    "motor_velocity",
    "link_angle",
    "link_velocity",
    "motor_torque",
    "motor_current",
    "reference_angle",
    "reference_velocity",
)


@dataclass(frozen=True, eq=False)
class Proposal:
    """What was understood of a log, for the user to correct.

    Attributes
    ----------
    mapping : Mapping
        Proposed mapping; nothing is converted by it until the user accepts it.
    entries : tuple of Entry
        Its entries with their evidence, and those left out.
    findings : tuple of str
        What else was seen, in words.
    unmapped : tuple of str
        Channels that no entry is about, those of all joints under one name.
    """

    mapping: Mapping
    entries: tuple[Entry, ...]
    findings: tuple[str, ...]
    unmapped: tuple[str, ...]


def propose_mapping(
    log: Log, robot: ElasticRobot | None = None, time: TimeChoice | None = None
) -> Proposal:
    """Propose what the channels of a log mean.

    Parameters
    ----------
    log : Log
        The log, open.
    robot : ElasticRobot, optional
        Its joints, their limits and gear ratios.
    time : TimeChoice, optional
        Where the time comes from, as far as the user says it.

    Raises
    ------
    InvalidInput
        If no channels look like angles of joints, or nothing tells the time of theirs.
    """
    times, missing = table_times(log, time or TimeChoice())
    groups = families(log, robot)
    members = _members(groups, robot, times)
    if "motor_angle" not in members:
        names = [family.pattern for family in groups]
        reasons = "; ".join(missing.values()) or "names such as q_1, pos_1 or act_pos[0] do"
        raise InvalidInput(
            f"{log.where}: no channels look like angles of joints ({reasons}); a mapping of your "
            f"own is needed (there are {listed(names)})"
        )
    search = Search(log, robot, times, members, findings=_shortened(groups, members))
    propose_angles(search)
    for role in ("motor_velocity", "link_velocity"):
        if role in members:
            propose_velocity(search, role)
    propose_drives(search)
    propose_references(search)
    search.findings += constant_findings(log, robot)
    return _finished(search, groups)


def _members(
    groups: Sequence[Family], robot: ElasticRobot | None, times: dict[str, TableTime]
) -> dict[str, Family]:
    """Return one family for each role: as many channels as joints, measured, beside the angles."""
    count = None if robot is None else len(robot.motor_names)
    fitting = [
        family
        for family in groups
        if family.table.name in times
        and (family.joints or not count or len(family.channels) in (count, count + 1))
    ]
    if not any(family.role == "motor_angle" for family in fitting):
        fitting = [
            replace(family, role="motor_angle", by_default=True)
            if not family.role and is_bare(family)
            else family
            for family in fitting
        ]
    best: dict[str, Family] = {}
    for role in _ROLES:
        anchor = best.get("motor_angle")
        candidates = [family for family in fitting if family.role == role]
        if candidates:
            family = max(candidates, key=lambda family: _preference(family, count, anchor))
            best[role] = family if family.joints else _without_gripper(family, count)
    return best


def _without_gripper(family: Family, count: int | None) -> Family:
    return family if count is None else replace(family, channels=family.channels[:count])


def _shortened(groups: Sequence[Family], members: dict[str, Family]) -> list[str]:
    """Return which families have a channel more than the robot has joints, in words."""
    whole = {(family.table.name, family.pattern): family.channels for family in groups}
    pairs = [(member, whole[member.table.name, member.pattern]) for member in members.values()]
    return [
        f"{member.pattern}: {len(channels)} channels for {len(member.channels)} joints; the last "
        "one, as of a gripper, is left out"
        for member, channels in pairs
        if len(channels) > len(member.channels)
    ]


def _preference(family: Family, count: int | None, anchor: Family | None) -> tuple[int, ...]:
    beside = anchor is not None and (
        family.pattern.rpartition(".")[0] == anchor.pattern.rpartition(".")[0]
    )
    complete = len(family.channels) == count
    return (complete, len(family.channels), int(beside), family.rank, -len(family.pattern))


def _finished(search: Search, groups: Sequence[Family]) -> Proposal:
    names = {entry.family.table.name for entry in search.entries if entry.signal is not None}
    times = {name: search.times[name] for name in sorted(names)}
    choices = [time.choice for time in times.values()]
    common = choices[0] if all(choice == choices[0] for choice in choices) else TimeChoice()
    tables = {} if common is choices[0] else {name: time.choice for name, time in times.items()}
    for name, time in times.items():
        told = f"table {name}" if name else search.log.files[0].name
        search.findings += clock_messages(time.clock, told)
    mapping = Mapping.model_validate(
        {
            "schema": "import/1",
            "time": common,
            "tables": tables,
            "signals": [e.signal for e in search.entries if e.signal is not None],
        }
    )
    return Proposal(
        mapping, tuple(search.entries), tuple(search.findings), _unmapped(search, groups)
    )


def _unmapped(search: Search, groups: Sequence[Family]) -> tuple[str, ...]:
    """Return the families that are neither signals nor stamps, nor left out for a reason."""
    mapped = {channel for entry in search.entries for channel in entry.family.channels}
    mapped |= {part for time in search.times.values() for part in stamp_parts(time.column)}
    names = (
        family.pattern if len(family.channels) > 1 else family.channels[0]
        for family in groups
        if not mapped & set(family.channels)
    )
    return tuple(dict.fromkeys(names))
