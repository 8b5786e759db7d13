"""The folder of a campaign's visits: what was proposed, what came back.

``visits/003`` holds the plan of visit 3 (``plan.yaml``, ``plan.h5``), its files for controllers
and ``visit.yaml``. What came back lies beside them: ``records.h5``, or ``failed.yaml`` with the
reason. Files are the only state: a campaign goes on from them after a kill at any moment, as the
visits that are planned together appear together.
"""

import os
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import yaml
from pydantic import Field

from estimators.frf.file_formats import read_records
from oed.experiment.experiment_plan import ExperimentPlan
from robotmodels.common.atomic_files import atomic_write, write_text
from robotmodels.common.errors import InvalidInput, naming
from robotmodels.common.yaml_files import FileSection, read_yaml
from robotmodels.records.records import SIGNALS, Records

Purpose = Literal["check", "first", "accuracy", "repeat", "study"]
"""A low-level run, one before any fit, one for the accuracies, the first one once more; one of a
study."""

_UNFINISHED, _WHOLE = ".unfinished", ".whole"
"""Folders of visits that are being written, and of those that get their names."""

_NEAR = 2e-3
"""Largest distance of measured positions from planned ones [rad; m]."""

_CHECKED_PERIODS = 2
"""Of a low-level run at least, which shows by them how large noise is."""


class _VisitFile(FileSection):
    """``visit.yaml``, ``schema: visit/1``."""

    schema_: Literal["visit/1"] = Field(alias="schema")
    purpose: Purpose
    robot_digest: str


class _FailureFile(FileSection):
    """``failed.yaml``, ``schema: failed_visit/1``."""

    schema_: Literal["failed_visit/1"] = Field(alias="schema")
    reason: Annotated[str, Field(min_length=1)]


@dataclass(frozen=True, eq=False)
class Visit:
    """A visit: one position, one run.

    Attributes
    ----------
    number : int
        Counted from 1, in the order of proposal.
    folder : Path
        Folder of its files.
    purpose : Purpose
        What it is for.
    plan : ExperimentPlan
        Where to go and what the motors are told.
    robot_digest : str
        Robot file that it was planned with, see `robot_digest`.
    """

    number: int
    folder: Path
    purpose: Purpose
    plan: ExperimentPlan
    robot_digest: str

    @property
    def records_file(self) -> Path:
        """File of the records that came back."""
        return self.folder / "records.h5"

    @property
    def records(self) -> Records:
        """The records that came back, with the plan's lines: a log does not show the weak ones."""
        sine = self.plan.multisine
        return replace(Records.load(self.records_file), lines=sine.lines, detection=sine.detection)

    @property
    def state(self) -> Literal["open", "measured", "failed"]:
        """Whether it is to be run, its records are here, or it failed."""
        if self.records_file.exists():
            return "measured"
        return "failed" if (self.folder / "failed.yaml").exists() else "open"

    @property
    def failure(self) -> str:
        """Why it failed."""
        return read_yaml(self.folder / "failed.yaml", _FailureFile).reason

    def fail(self, reason: str) -> None:
        """Note that it failed; without effect on a visit whose records are here."""
        if self.state == "measured":
            raise InvalidInput(
                f"visit {self.number}: its records are here, {self.records_file}; remove that file "
                "first if they are not to count"
            )
        document = {"schema": "failed_visit/1", "reason": reason}
        write_text(self.folder / "failed.yaml", yaml.safe_dump(document, sort_keys=False))

    def take(self, path: Path) -> bool:
        """Keep a copy of its records; return whether they are new.

        Raises
        ------
        InvalidInput
            If they are those of another visit, or others of this one are here.
        """
        records = read_records(path)
        with naming(path):
            self._check(records)
        target = self.records_file
        if target.exists():
            before = Records.load(target)
            if all(np.array_equal(getattr(before, k), getattr(records, k)) for k in SIGNALS):
                return False
            raise InvalidInput(
                f"{path}: visit {self.number} has other records, {target}; remove that file first "
                "if these are to replace it"
            )
        with atomic_write(target) as part:
            if path.suffix == target.suffix:
                shutil.copyfile(path, part)  # with what it says of its origin
            else:
                records.save(part)
        return True

    def _check(self, records: Records) -> None:
        """Refuse records that this visit cannot have led to."""
        plan, sine = self.plan, self.plan.multisine
        who = f"not of visit {self.number}"
        if len(records) != 1:
            raise InvalidInput(f"{who}: {len(records)} positions; give those of each visit alone")
        if records.torque.shape[-1] != len(plan.motors):
            raise InvalidInput(
                f"{who}: {records.torque.shape[-1]} motors, the plan has {len(plan.motors)}"
            )
        away = np.abs(records.positions[0] - plan.positions[0])
        if away.max() > _NEAR:
            motor = plan.motors[int(away.argmax())]
            raise InvalidInput(
                f"{who}: motor {motor!r} at {records.positions[0, away.argmax()]:.4g}, planned "
                f"{plan.positions[0, away.argmax()]:.4g}"
            )
        period = records.samples * records.sample_time
        if not np.isclose(period, sine.period, rtol=1e-6, atol=0):
            raise InvalidInput(f"{who}: a period of {period:.6g} s, planned {sine.period:.6g} s")
        if records.reference.any() and not _alike(records, plan):
            raise InvalidInput(f"{who}: other references than planned; perhaps of another visit")
        if records.missing.any():
            raise InvalidInput(
                f"visit {self.number}: a run is missing; give all, or tell that it failed"
            )
        if self.purpose == "check" and records.torque.shape[3] < _CHECKED_PERIODS:
            raise InvalidInput(
                f"visit {self.number}: one period of the low-level run, whose noise is how periods "
                f"scatter; record all {plan.periods} that are planned"
            )


def _alike(records: Records, plan: ExperimentPlan) -> bool:
    """Return whether the records' references are those of the plan, sampled as they may be."""
    planned = np.fft.rfft(plan.reference(0)[0], axis=1)[:, plan.multisine.lines]  # (E, F, n)
    measured = records.reference[0, 0]  # (E, P, N, n)
    if len(measured) != len(planned):
        return False
    spectrum = np.fft.rfft(measured.mean(axis=1), axis=1)[:, plan.multisine.lines]
    spectrum = spectrum * (plan.multisine.samples / records.samples)
    return bool(np.abs(spectrum - planned).max() <= 1e-3 * np.abs(planned).max())


@dataclass(frozen=True)
class VisitFolder:
    """The visits of a campaign, in ``visits`` of its folder."""

    folder: Path

    def all(self) -> tuple[Visit, ...]:
        """Return all visits, in the order of proposal.

        Raises
        ------
        InvalidInput
            If a file of theirs is missing or damaged.
        """
        return tuple(self._read(self.folder / name) for name in self._names)

    @property
    def _names(self) -> list[str]:
        """Names of the visits' folders, in order."""
        if not self.folder.is_dir():
            return []
        numbered = [path.name for path in self.folder.iterdir() if path.name.isdigit()]
        return sorted(numbered, key=int)

    def _read(self, folder: Path) -> Visit:
        file = read_yaml(folder / "visit.yaml", _VisitFile)
        plan = ExperimentPlan.load(folder / "plan.yaml")
        return Visit(int(folder.name), folder, file.purpose, plan, file.robot_digest)

    def add(
        self,
        plans: Sequence[ExperimentPlan],
        purpose: Purpose,
        robot_digest: str,
        write_files: Callable[[ExperimentPlan, Path], ExperimentPlan],
    ) -> tuple[Visit, ...]:
        """Write new visits with their files for controllers; all of them appear, or none.

        `write_files` gets a folder for them and returns the plan that they are of; what it raises
        leaves none behind.
        """
        self.recover()
        first = 1 + max(map(int, self._names), default=0)
        stage = self.folder / _UNFINISHED
        names = [f"{first + i:03d}" for i in range(len(plans))]
        try:
            for name, plan in zip(names, plans, strict=True):
                (stage / name).mkdir(parents=True)
                write_files(plan, stage / name / "controller").save(stage / name / "plan.yaml")
                document = {"schema": "visit/1", "purpose": purpose, "robot_digest": robot_digest}
                write_text(stage / name / "visit.yaml", yaml.safe_dump(document, sort_keys=False))
            if plans:
                os.replace(stage, self.folder / _WHOLE)
        finally:
            shutil.rmtree(stage, ignore_errors=True)
        self.recover()
        return tuple(self._read(self.folder / name) for name in names)

    def recover(self) -> None:
        """Finish what a kill interrupted: visits that are whole appear, others go."""
        whole, unfinished = self.folder / _WHOLE, self.folder / _UNFINISHED
        if whole.is_dir():
            for folder in sorted(whole.iterdir()):
                os.replace(folder, self.folder / folder.name)
            whole.rmdir()
        if unfinished.is_dir():
            shutil.rmtree(unfinished)
