"""What the files of a campaign say at one moment: fit, forecast and status, each computed once."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from estimators import robot_prior
from estimators.fitting.priors import Prior
from oed.campaign.estimate import Estimate, estimate, fitted_visits, noise_in
from oed.campaign.history import History
from oed.campaign.outlook import Forecast, Outlook
from oed.campaign.planning import GAIN, Planner, known_now
from oed.campaign.settings import CampaignSettings
from oed.campaign.status import CampaignStatus, minutes_of
from oed.campaign.swing_room import with_room
from oed.campaign.visit_plan import usable_positions
from oed.campaign.visits import Visit
from oed.candidates.screening import ScreenedCandidates
from oed.experiment.workcell_settings import surroundings_of
from oed.study.stage_cache import Stage, Stages, dataclass_files
from oed.study.stages.candidates import gather
from robotmodels import ElasticRobot
from robotmodels.common.errors import IdentificationError
from robotmodels.common.fingerprints import file_digest
from robotmodels.common.progress import Progress

_RESERVE = 0.97
"""Of targets, that plans aim at: what visits tell scatters by some per cent."""


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A campaign's files at one moment.

    Attributes
    ----------
    settings : CampaignSettings
        The campaign file.
    robot : ElasticRobot
        The robot with the guesses.
    robot_digest : str
        Of its file.
    visits : tuple of Visit
        All visits, in the order of proposal.
    stages : Stages
        Where computations are stored.
    """

    settings: CampaignSettings
    robot: ElasticRobot
    robot_digest: str
    visits: tuple[Visit, ...]
    stages: Stages

    @cached_property
    def status(self) -> CampaignStatus:
        """How far the campaign is."""
        names = self.robot.parameters.names
        targets, latest = self.settings.accuracies(names), self._latest
        reached = latest is not None and bool((latest.std <= targets).all())
        return CampaignStatus(
            names=names,
            targets=targets,
            estimate=latest,
            outlook=None if reached else self._outlook,
            visits=self.visits,
            minutes=self.minutes,
            expected=minutes_of([v for v in self.visits if v.state == "open"]),
            budget=self.settings.minutes,
            history=self._history,
        )

    @cached_property
    def planner(self) -> Planner:
        """Planner of visits about the latest estimate, or the guesses."""
        choice = self.settings.candidates
        around = surroundings_of(choice, self.robot)
        inputs = {
            "robot": self.robot_digest,
            "files": [file_digest(file) for file in choice.files],
            "candidates": choice.model_dump(mode="json", exclude={"files"}),
            "swing": self.settings.limits.swing,
        }

        def compute(_: Path, report: Progress | None) -> ScreenedCandidates:
            return with_room(gather(choice, self.robot, report), self.settings, self.robot, around)

        candidates = self.stages.run(
            "candidates", inputs, compute, dataclass_files(ScreenedCandidates)
        ).value
        robot = known_now(self.robot, self._latest)
        been = [visit for visit in self.visits if visit.state != "open"]
        return Planner(
            settings=self.settings,
            robot=robot,
            positions=usable_positions(self.settings, robot, candidates.positions),
            surroundings=around,
            stage=len(self.visits),
            at=been[-1].plan.positions[0] if been else None,
        )

    @cached_property
    def forecast(self) -> Forecast:
        """What visits bring, by the latest estimate or the guesses; after the low-level run."""
        names, latest = self.robot.parameters.names, self._latest
        targets = self.settings.accuracies(names)
        if latest is not None:
            # Quoted standard deviations are those of Theorem 1, or larger by what residuals tell.
            targets = _RESERVE * targets / latest.inflation
        finite = {n: float(t) for n, t in zip(names, targets, strict=True) if np.isfinite(t)}
        if latest is not None:
            return self.planner.forecast(latest, finite, self.settings.minutes - self.minutes)
        assert self.checked is not None
        noise = noise_in(self.checked, self.robot)
        return self.planner.expectation(noise, self._prior, finite)

    @property
    def checked(self) -> Visit | None:
        """The last low-level run whose records are here."""
        runs = [v for v in self.visits if v.purpose == "check" and v.state == "measured"]
        return runs[-1] if runs else None

    @property
    def minutes(self) -> float:
        """Robot time of the visits that were run [min]."""
        return minutes_of([v for v in self.visits if v.state != "open"])

    @property
    def _latest(self) -> Estimate | None:
        return None if self._estimate is None else self._estimate.value

    @cached_property
    def _estimate(self) -> Stage[Estimate] | None:
        """Fit what is here; None before the first visits."""
        fitted = fitted_visits(self.visits)
        if not fitted or any(v.state == "open" and v.purpose == "first" for v in self.visits):
            return None

        def compute(_: Path, report: Progress | None) -> Estimate:
            rng = np.random.default_rng([self.settings.seed, len(fitted)])
            friction = self.settings.friction
            return estimate(self.robot, fitted, self._prior, rng, report, friction=friction)

        inputs = {
            "robot": self.robot_digest,
            "guesses": self.settings.guesses_within,
            "friction": self.settings.friction,
            "seed": self.settings.seed,
            "records": [file_digest(visit.records_file) for visit in fitted],
        }
        return self.stages.run("estimate", inputs, compute, dataclass_files(Estimate))

    @property
    def _prior(self) -> Prior:
        """How far guesses may be off."""
        within = self.settings.guesses_within
        if within == "robot":
            return robot_prior(self.robot)
        names, values = self.robot.parameters.names, self.robot.parameters.values
        return Prior(names, values, np.full(len(names), np.log(within)))

    @property
    def _outlook(self) -> Outlook | None:
        """What the minutes left can bring; None before the low-level run."""
        if self.checked is None:
            return None
        latest, remaining = self._latest, self.settings.minutes - self.minutes

        def compute(_: Path, report: Progress | None) -> Outlook:
            if latest is None:  # designed spectra are faster than those at the guesses
                return self.forecast.outlook(remaining, faster=GAIN)
            return self.forecast.outlook(remaining, latest.inflation)

        inputs = {
            "robot": self.robot_digest,
            "settings": self.settings.model_dump(mode="json", exclude={"output"}),
            "check": file_digest(self.checked.records_file),
            "estimate": None if self._estimate is None else self._estimate.digest,
            "minutes": remaining,
        }
        try:
            return self.stages.run("outlook", inputs, compute, dataclass_files(Outlook)).value
        except IdentificationError:
            return None  # planning meets the same and says why

    @property
    def _history(self) -> History:
        """All estimates so far; the latest is added to the file where it is new."""
        file = self.settings.output / "history.h5"
        history = History.load(file, len(self.robot.parameters))
        stage = self._estimate
        if stage is not None and history.digests[-1:] != (stage.digest,):
            count = len(fitted_visits(self.visits))
            history = history.extended(stage.digest, count, self.minutes, stage.value)
            history.save(file)
        return history
