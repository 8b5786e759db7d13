"""A log and a mapping become movements, piece by piece."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput
from robotmodels.common.fingerprints import file_digest
from robotmodels.common.progress import StageProgress
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.logs.binding import JOINTLESS, Binding, BoundSignal, bind
from robotmodels.logs.clocks import Clock, clock_messages, table_clock
from robotmodels.logs.log import PIECE, Log, Table
from robotmodels.logs.mapping_file import Mapping
from robotmodels.logs.signal_reader import SignalReader
from robotmodels.logs.survey import Survey, signal_key, survey, survey_messages
from robotmodels.records.movement import Movement, movement_group, write_header

_SAME = 1e-3  # of a sample
_OF_MOTION = ("motor_angle", "motor_velocity", "reference_angle", "reference_velocity")


@dataclass(frozen=True, eq=False)
class Run:
    """A stretch of a log without gaps, not yet read.

    Attributes
    ----------
    source : Import
        Log and mapping.
    first, stop : int
        Its samples on the clock of the first mapped table.
    """

    source: "Import"
    first: int
    stop: int

    def __len__(self) -> int:
        return self.stop - self.first

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.source.binding.joints

    @property
    def sample_time(self) -> float:
        """Sample time [s]."""
        return self.source.clock.sample_time

    @property
    def start(self) -> float:
        """Time of the first sample [s]."""
        return self.source.clock.time_of(self.first)

    def pieces(self, role: str) -> Iterator[Array]:
        """Yield the signals of a role, (up to `PIECE`, n)."""
        for low in range(self.first, self.stop, PIECE):
            yield self.source.joint_values(role, low, min(low + PIECE, self.stop))

    def other_pieces(self, name: str) -> Iterator[Array]:
        """Yield a signal of no joint, (up to `PIECE`,)."""
        signal = self.source.others[name]
        for low in range(self.first, self.stop, PIECE):
            yield self.source.reader.values(signal, low, min(low + PIECE, self.stop))

    def read(self) -> Movement:
        """Return all of it in memory."""
        return Movement(
            joints=self.joints,
            sample_time=self.sample_time,
            signals={role: np.concatenate(list(self.pieces(role))) for role in self.source.roles},
            others={
                name: np.concatenate(list(self.other_pieces(name))) for name in self.source.others
            },
            start=self.start,
            provenance=self.source.provenance,
        )


@dataclass(frozen=True, eq=False)
class Import:
    """A log as its mapping understands it.

    Attributes
    ----------
    log, mapping, robot : Log, Mapping, ElasticRobot or None
        What it is made from.

    Raises
    ------
    InvalidInput
        If the mapping does not fit the log, a table has no clock, or resampling would err by more
        than 2 % of a signal.
    """

    log: Log
    mapping: Mapping
    robot: ElasticRobot | None
    progress: StageProgress | None = field(default=None, repr=False)

    @cached_property
    def binding(self) -> Binding:
        """Channels with their meaning."""
        return bind(self.mapping, self.log, self.robot)

    @cached_property
    def clocks(self) -> dict[str, Clock]:
        """Clocks by the names of tables that have a mapped channel."""
        tables = {signal.table.name: signal.table for signal in self.binding.signals}
        time, others = self.mapping.time, self.mapping.tables
        return {
            name: table_clock(self.log, table, others.get(name, time))
            for name, table in tables.items()
        }

    @property
    def base(self) -> Table:
        """Table whose samples count; others are interpolated to them."""
        return self.binding.signals[0].table

    @property
    def clock(self) -> Clock:
        """Clock of that table."""
        return self.clocks[self.base.name]

    @cached_property
    def surveys(self) -> dict[str, Survey]:
        """One pass through each mapped channel, by role and name."""
        surveys = {}
        for number, signal in enumerate(self.binding.signals):
            surveys[signal_key(signal)] = survey(signal)
            if self.progress is not None:
                self.progress("survey", number + 1, len(self.binding.signals))
        return surveys

    @cached_property
    def present(self) -> tuple[BoundSignal, ...]:
        """Signals that change, and those of motors at rest; others that never do are absent.

        Where nothing of a role changes, all of it rests.
        """
        signals = self.binding.signals
        constant = {signal_key(s) for s in signals if self.surveys[signal_key(s)].constant}
        moving = {s.role for s in signals if signal_key(s) not in constant}
        return tuple(
            s
            for s in signals
            if s.role not in moving
            or signal_key(s) not in constant
            or (s.role in _OF_MOTION and f"motor_angle:{s.name}" in constant)
        )

    @cached_property
    def roles(self) -> dict[str, tuple[BoundSignal, ...]]:
        """Signals of joints by role; currents with a torque constant make motor torques too."""
        roles: dict[str, tuple[BoundSignal, ...]] = {}
        for signal in self.present:
            if signal.role not in JOINTLESS:
                roles[signal.role] = (*roles.get(signal.role, ()), signal)
        if self.mapping.torque_constants and "motor_torque" not in roles:
            roles["motor_torque"] = roles.get("motor_current", ())
        return {role: signals for role, signals in roles.items() if signals}

    @cached_property
    def others(self) -> dict[str, BoundSignal]:
        """Signals of no joint by name."""
        return {s.name: s for s in self.present if s.role in JOINTLESS}

    @cached_property
    def runs(self) -> tuple[Run, ...]:
        """Stretches between gaps, within the time that all tables cover."""
        low, high = -np.inf, np.inf
        for signal in self.present:
            clock = self.clocks[signal.table.name]
            if signal.table is not self.base or signal.entry.delay:
                low = max(low, clock.time_of(0) - signal.entry.delay)
                high = min(high, clock.time_of(-1) - signal.entry.delay)
        clock, step = self.clock, self.clock.sample_time
        runs = []
        for first, stop in clock.segments:
            begin, end = clock.time_of(first), clock.time_of(stop - 1)
            after = max(0, int(np.ceil((low - begin) / step - _SAME))) if low > begin else 0
            before = max(0, int(np.ceil((end - high) / step - _SAME))) if high < end else 0
            if stop - first - after - before > 2:
                runs.append(Run(self, first + after, stop - before))
        if not runs:
            raise InvalidInput(f"{self.log.where}: its tables have no time in common")
        return tuple(runs)

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """What was seen and what was changed, in words."""
        lines = list(self.log.notes)
        for name, clock in self.clocks.items():
            lines += clock_messages(clock, f"table {name}" if name else self.log.files[0].name)
        for signal in self.binding.signals:
            lines += survey_messages(
                signal, self.surveys[signal_key(signal)], signal not in self.present
            )
            if (error := self.reader.interpolation_error(signal)) is not None:
                lines.append(
                    f"{signal.channel}: interpolated to the samples of {self.clock.source}; error "
                    f"below {max(error, 1e-4):.2g} of {signal.role}"
                )
        return tuple(lines)

    @cached_property
    def provenance(self) -> dict[str, Any]:
        """Files and digests, mapping and changes, as plain data."""
        return {
            "files": {path.name: file_digest(path) for path in self.log.files},
            "mapping": self.mapping.model_dump(mode="json", by_alias=True, exclude_defaults=True),
            "changes": list(self.notes),
        }

    @cached_property
    def reader(self) -> SignalReader:
        """What reads signals in SI on the samples of the first table."""
        return SignalReader(self.log.where, self.base, self.clocks, self.surveys)

    def joint_values(self, role: str, low: int, high: int) -> Array:
        """Return the signals of a role in SI on the joint side, (N, n), NaN where absent."""
        joints = self.binding.joints
        values = np.full((high - low, len(joints)), np.nan)
        constants = np.asarray(self.mapping.torque_constants or (1.0,))
        for signal in self.roles[role]:
            column = self.reader.values(signal, low, high)
            if role == "motor_torque" and signal.role == "motor_current":
                constant = np.broadcast_to(constants, len(joints))[signal.joint]
                column = column * constant * self.binding.ratios[signal.joint]
            values[:, signal.joint] = column
        return self._posed(role, self._mixed(role, values))

    def _mixed(self, role: str, values: Array) -> Array:
        mixing = self.binding.mixing
        if (
            role.startswith("motor_")
            and role != "motor_current"
            and np.any(mixing != np.eye(len(mixing)))
        ):
            torque = role == "motor_torque"
            return np.asarray(values @ (np.linalg.inv(mixing) if torque else mixing.T))
        return values

    def _posed(self, role: str, values: Array) -> Array:
        if role.endswith("_angle") and self.mapping.start_pose:
            return np.asarray(values + np.asarray(self.mapping.start_pose))
        return values


def write_import(source: Import, path: Path) -> int:
    """Write all runs as movements, piece by piece; return their number."""
    import h5py

    from robotmodels.common.atomic_files import atomic_write

    parts, done = len(source.runs) * (len(source.roles) + len(source.others)), 0
    with atomic_write(path) as unfinished, h5py.File(unfinished, "w") as file:
        write_header(file, source.provenance)
        for number, run in enumerate(source.runs):
            group = movement_group(file, number, run)
            shapes = {role: (len(run), len(run.joints)) for role in source.roles}
            for name in (*source.roles, *source.others):
                inside = group if name in shapes else group["others"]
                dataset = inside.create_dataset(name, shapes.get(name, (len(run),)), dtype=float)
                _fill(dataset, run.pieces(name) if name in shapes else run.other_pieces(name))
                done += 1
                if source.progress is not None:
                    source.progress("write", done, parts)
    return len(source.runs)


def _fill(dataset: Any, pieces: Iterator[Array]) -> None:
    row = 0
    for piece in pieces:
        dataset[row : row + len(piece)] = piece
        row += len(piece)
