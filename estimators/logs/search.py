"""State of the search for a mapping: families by role, and the entries decided so far."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from estimators.logs.families import Family
from estimators.logs.samples import TableTime, family_samples
from estimators.logs.shift_regression import Relation
from estimators.logs.unit_hypotheses import Hypothesis, without_jumps
from robotmodels.common.arrays import Array
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.logs.log import Log
from robotmodels.logs.mapping_file import Signal


@dataclass(frozen=True, eq=False)
class Entry:
    """One entry of a proposal.

    Attributes
    ----------
    family : Family
        Channels.
    signal : Signal or None
        What stands in the mapping; None where the channels are understood but not used.
    evidence : str
        What the entry rests on.
    relations : tuple of (Relation or None)
        To the motor angle, by channel.
    """

    family: Family
    signal: Signal | None
    evidence: str
    relations: tuple[Relation | None, ...] = ()


@dataclass
class Search:
    """What is decided so far.

    Attributes
    ----------
    log, robot : Log, ElasticRobot or None
        What is looked at.
    times : dict of str to TableTime
        Times of tables by name.
    members : dict of str to Family
        The family of each role.
    entries : list of Entry
        Entries so far.
    findings : list of str
        What else was seen.
    angle : Hypothesis
        Unit and side of the motor angles; no unit before it is decided.
    """

    log: Log
    robot: ElasticRobot | None
    times: dict[str, TableTime]
    members: dict[str, Family]
    entries: list[Entry] = field(default_factory=list)
    findings: list[str] = field(default_factory=list)
    angle: Hypothesis = field(default_factory=lambda: Hypothesis("", "joint"))

    def samples(self, role: str) -> tuple[Array, Array]:
        """Return stamps (N,) and values (N, n) of a role, angles without jumps by whole turns."""
        family = self.members[role]
        stamps, values = family_samples(family, self.times[family.table.name])
        return stamps, without_jumps(values, self.angle.unit if "_angle" in role else "")

    def add(
        self,
        role: str,
        unit: str,
        evidence: str,
        more: Mapping[str, object] | None = None,
        relations: Sequence[Relation | None] = (),
        used: bool = True,
    ) -> None:
        """Add an entry; one that is not used is told and left out of the mapping."""
        family = self.members[role]
        fields = {"column": column_of(self.log, family), "role": role, "unit": unit} | dict(
            more or {}
        )
        if family.joints and set(family.joints) != set(self.joints):
            fields["joints"] = family.joints
        signal = Signal.model_validate(fields) if used else None
        self.entries.append(Entry(family, signal, evidence, tuple(relations)))

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        if self.robot is not None:
            return self.robot.motor_names
        return tuple(f"joint_{i + 1}" for i in range(len(self.members["motor_angle"].channels)))

    @property
    def ratios(self) -> Array:
        """Gear ratios by joints, NaN where unknown."""
        if self.robot is None:
            return np.full(len(self.joints), np.nan)
        return np.array([motor.gear_ratio for motor in self.robot.file.motors])


def column_of(log: Log, family: Family) -> str | tuple[str, ...]:
    """Return the pattern of a family if it means these channels alone, else their names."""
    several = len(log.tables) > 1 and any(
        table is not family.table and set(family.channels) & set(table.channels)
        for table in log.tables
    )
    prefix = f"{family.table.name}:" if several else ""
    pattern = f"{prefix}{family.pattern}"
    if tuple(name for _, name in log.matching(pattern)) == family.channels and "*" in pattern:
        return pattern
    return tuple(f"{prefix}{name}" for name in family.channels)
