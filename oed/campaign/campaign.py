"""A campaign: visits are asked for, run, and told, until every accuracy is reached.

The convention is that of Optuna's ask and tell. `ask` returns the visits that are open, and plans
new ones only where none is; so a second `ask`, after a crash or in another terminal, repeats
itself. All state is in files, see `oed.campaign.visits`; one process at a time changes it.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from estimators import robot_prior
from estimators.fitting.priors import Prior
from oed.campaign.checks import check_low_level, low_level_noise
from oed.campaign.estimate import FITTED, Estimate, estimate
from oed.campaign.planning import Planner, known_now
from oed.campaign.settings import CampaignSettings, load_campaign
from oed.campaign.swing_room import with_room
from oed.campaign.visits import Purpose, Visit, VisitFolder
from oed.candidates.screening import ScreenedCandidates
from oed.experiment.controller_files import write_controller_files
from oed.experiment.experiment_plan import FALL, ExperimentPlan
from oed.experiment.workcell_settings import surroundings_of
from oed.study.stage_cache import Stage, Stages, dataclass_files, open_stages
from oed.study.stages.candidates import gather
from robotmodels import ElasticRobot, load_robot
from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput
from robotmodels.common.fingerprints import file_digest
from robotmodels.common.progress import Progress, StageProgress
from robotmodels.library.robot_digest import robot_digest

State = Literal["begun", "identifying", "reached", "minutes used"]


@dataclass(frozen=True, eq=False)
class CampaignStatus:
    """How far a campaign is.

    Attributes
    ----------
    state : {"begun", "identifying", "reached", "minutes used"}
        Before the first fit; on the way; every accuracy reached; no time for another visit.
    names : tuple of str
        The p parameters.
    targets : ndarray, (p,)
        Relative standard deviations asked for; infinite where none is.
    estimate : Estimate or None
        What all records say; None before the first fit.
    visits : tuple of Visit
        All, in the order of proposal.
    minutes : float
        Robot time of the visits that were run, moves included.
    expected : float
        Robot time of the open visits [min].
    budget : float
        Robot time that was allowed [min].
    """

    state: State
    names: tuple[str, ...]
    targets: Array
    estimate: Estimate | None
    visits: tuple[Visit, ...]
    minutes: float
    expected: float
    budget: float

    @property
    def short_of(self) -> dict[str, float]:
        """Parameters that miss their target, and by which factor."""
        if self.estimate is None:
            return {}
        ratio = self.estimate.std / self.targets
        return {name: float(r) for name, r in zip(self.names, ratio, strict=True) if not r <= 1}


@dataclass(frozen=True, eq=False)
class Campaign:
    """A campaign file with its folder.

    Attributes
    ----------
    settings : CampaignSettings
        The file's content.
    robot : ElasticRobot
        The robot with the guesses.
    """

    settings: CampaignSettings
    robot: ElasticRobot

    @classmethod
    def load(cls, path: str | Path) -> "Campaign":
        """Read a campaign file.

        Raises
        ------
        InvalidInput
            If it, or its robot file, cannot be used; or targets name no parameter.
        """
        settings = load_campaign(path)
        robot = load_robot(settings.robot)
        settings.accuracies(robot.parameters.names)  # refused before anything is run
        return cls(settings, robot)

    @cached_property
    def targets(self) -> Array:
        """Relative standard deviations asked for, (p,)."""
        return self.settings.accuracies(self.robot.parameters.names)

    @property
    def visits(self) -> tuple[Visit, ...]:
        """All visits, in the order of proposal.

        Raises
        ------
        InvalidInput
            If a file is damaged, or the robot file was changed since a visit was planned.
        """
        visits = VisitFolder(self.settings.output / "visits").all()
        for visit in visits:
            if visit.robot_digest != self._digest:
                raise InvalidInput(
                    f"robot {self.robot.name!r}: its file was changed after visit {visit.number} "
                    "was planned; restore it, or give the campaign another output"
                )
        return visits

    @cached_property
    def _digest(self) -> str:
        return robot_digest(self.robot)

    def ask(self, progress: StageProgress | None = None) -> tuple[Visit, ...]:
        """Return the visits to run, in order; none where the campaign has ended.

        Raises
        ------
        InvalidInput
            If the low-level run was not as predicted, no visit fits the minutes, or limits forbid
            every excitation.
        """
        with self._stages(progress) as stages:
            visits = self.visits
            waiting = tuple(visit for visit in visits if visit.state == "open")
            return waiting or self._planned(visits, stages)

    def tell(self, number: int, records: str | Path) -> bool:
        """Take a visit's records; return whether they are new.

        Raises
        ------
        InvalidInput
            If there is no such visit, or the records are not its own.
        """
        with self._stages():
            return self._visit(number).take(Path(records))

    def fail(self, number: int, reason: str) -> None:
        """Note that a visit failed; another is planned in its place where it is needed.

        Raises
        ------
        InvalidInput
            If there is no such visit, or its records are here.
        """
        with self._stages():
            self._visit(number).fail(reason)

    def status(self, progress: StageProgress | None = None) -> CampaignStatus:
        """Return how far the campaign is; fits where new records are here."""
        with self._stages(progress) as stages:
            visits = self.visits
            return self._status(visits, self._estimate(visits, stages))

    def _visit(self, number: int) -> Visit:
        visits = {visit.number: visit for visit in self.visits}
        if number not in visits:
            raise InvalidInput(
                f"visit {number}: the campaign has asked for {len(visits) or 'none'} so far"
            )
        return visits[number]

    @contextmanager
    def _stages(self, progress: StageProgress | None = None) -> Iterator[Stages]:
        with open_stages(self.settings.output / "stages", progress) as stages:
            yield stages

    def _planned(self, visits: tuple[Visit, ...], stages: Stages) -> tuple[Visit, ...]:
        """Plan new visits and write them; none where the campaign has ended."""
        told = [visit for visit in visits if visit.state == "told"]
        checked = [visit for visit in told if visit.purpose == "check"]
        if not checked:
            return self._write(self._planner(None, visits, stages).check(), "check", self.robot)
        check_low_level(checked[-1], self.settings)
        stage = self._estimate(visits, stages)
        latest = None if stage is None else stage.value
        planner = self._planner(latest, visits, stages)
        if latest is None:
            plans = planner.first(low_level_noise(checked[-1]), self._prior, self._named_targets)
            return self._write(plans, "first", planner.robot)
        if (latest.std <= self.targets).all():
            fitted = [visit for visit in told if visit.purpose in FITTED]
            if any(visit.purpose == "repeat" for visit in visits):
                return ()
            return self._write(planner.repeated(fitted[0].plan), "repeat", self.robot)
        minutes = self.settings.minutes - _minutes(visits)
        # Quoted standard deviations are those of Theorem 1, or larger by what the residuals tell.
        quoted = latest.std / np.sqrt(np.diag(latest.covariance))
        scaled = {
            name: target / float(quoted[self.robot.parameters.index(name)])
            for name, target in self._named_targets.items()
        }
        return self._write(planner.accuracy(latest, scaled, minutes), "accuracy", planner.robot)

    @property
    def _named_targets(self) -> dict[str, float]:
        """Targets by name."""
        pairs = zip(self.robot.parameters.names, self.targets, strict=True)
        return {name: float(value) for name, value in pairs if np.isfinite(value)}

    @cached_property
    def _prior(self) -> Prior:
        """How far guesses may be off."""
        within = self.settings.guesses_within
        if within == "robot":
            return robot_prior(self.robot)
        names, values = self.robot.parameters.names, self.robot.parameters.values
        return Prior(names, values, np.full(len(names), np.log(within)))

    def _planner(
        self, latest: Estimate | None, visits: tuple[Visit, ...], stages: Stages
    ) -> Planner:
        choice = self.settings.candidates
        around = surroundings_of(choice, self.robot)
        inputs = {
            "robot": self._digest,
            "files": [file_digest(file) for file in choice.files],
            "candidates": choice.model_dump(mode="json", exclude={"files"}),
            "swing": self.settings.limits.swing,
        }

        def compute(_: Path, report: Progress | None) -> ScreenedCandidates:
            return with_room(gather(choice, self.robot, report), self.settings, self.robot, around)

        candidates = stages.run(
            "candidates", inputs, compute, dataclass_files(ScreenedCandidates)
        ).value
        been = [visit for visit in visits if visit.state != "open"]
        return Planner(
            settings=self.settings,
            robot=known_now(self.robot, latest),
            positions=candidates.positions,
            surroundings=around,
            stage=len(visits),
            at=been[-1].plan.positions[0] if been else None,
        )

    def _estimate(self, visits: tuple[Visit, ...], stages: Stages) -> Stage[Estimate] | None:
        """Fit what is here; None before the first visits."""
        fitted = [v for v in visits if v.state == "told" and v.purpose in FITTED]
        if not fitted or any(v.state == "open" and v.purpose == "first" for v in visits):
            return None

        def compute(_: Path, report: Progress | None) -> Estimate:
            rng = np.random.default_rng([self.settings.seed, len(fitted)])
            return estimate(self.robot, fitted, self._prior, rng, report)

        inputs = {
            "robot": self._digest,
            "guesses": self.settings.guesses_within,
            "seed": self.settings.seed,
            "records": [file_digest(visit.records_file) for visit in fitted],
        }
        return stages.run("estimate", inputs, compute, dataclass_files(Estimate))

    def _status(self, visits: tuple[Visit, ...], stage: Stage[Estimate] | None) -> CampaignStatus:
        latest = None if stage is None else stage.value
        used = _minutes([v for v in visits if v.state != "open"])
        expected = _minutes([v for v in visits if v.state == "open"])
        state: State = "begun" if latest is None else "identifying"
        if latest is not None and (latest.std <= self.targets).all():
            state = "reached"
        elif latest is not None and not expected and used > self.settings.minutes - self._shortest:
            state = "minutes used"
        return CampaignStatus(
            state=state,
            names=self.robot.parameters.names,
            targets=self.targets,
            estimate=latest,
            visits=visits,
            minutes=used,
            expected=expected,
            budget=self.settings.minutes,
        )

    @property
    def _shortest(self) -> float:
        """Time of the shortest visit, its move left out [min]."""
        settings = self.settings
        periods = settings.transient_periods + 1 + FALL
        return (settings.settle + periods * settings.multisine.period) / 60

    def _write(
        self, plans: list[ExperimentPlan], purpose: Purpose, robot: ElasticRobot
    ) -> tuple[Visit, ...]:
        """Write visits whose limits were met by `robot`."""
        folder = VisitFolder(self.settings.output / "visits")

        def write_files(plan: ExperimentPlan, files: Path) -> None:
            write_controller_files(plan, files, self.settings.files, self.settings, robot)

        return tuple(folder.add(plan, purpose, self._digest, write_files) for plan in plans)


def _minutes(visits: Sequence[Visit]) -> float:
    """Return the robot time of visits [min], moves and settling included."""
    return sum(visit.plan.duration for visit in visits) / 60
