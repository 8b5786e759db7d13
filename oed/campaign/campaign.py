"""A campaign: visits are asked for, run, and told, until every accuracy is reached.

The convention is that of Optuna's ask and tell. `ask` returns the visits that are open, and plans
new ones only where none is; so a second `ask`, after a crash or in another terminal, repeats
itself. All state is in files, see `oed.campaign.visits`; one process at a time changes it.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from estimators.fitting.fitted_robot import fitted_robot
from estimators.input_output.friction_shares import check_motors
from oed.campaign.checks import check_hope, check_low_level, check_unchanged
from oed.campaign.driven_robot import write_visit_files
from oed.campaign.estimate import Estimate, fitted_visits
from oed.campaign.evaluation import Evaluation
from oed.campaign.planning import FEWEST
from oed.campaign.settings import CampaignSettings, load_campaign
from oed.campaign.status import CampaignStatus
from oed.campaign.visit_plan import line_grid
from oed.campaign.visits import Purpose, Visit, VisitFolder
from oed.experiment.experiment_plan import ExperimentPlan
from oed.experiment.prepare import friction_of
from oed.study.stage_cache import open_stages
from robotmodels import ElasticRobot, load_robot
from robotmodels.common.errors import InvalidInput, naming
from robotmodels.common.progress import StageProgress
from robotmodels.library.robot_digest import robot_digest


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
        if settings.friction:
            with naming(f"{path}: friction: true"):
                check_motors(robot)
        return cls(settings, robot)

    @property
    def visits(self) -> tuple[Visit, ...]:
        """All visits, in the order of proposal.

        Raises
        ------
        InvalidInput
            If a file is damaged, or the robot file or the lines of the campaign file were changed
            since a visit was planned.
        """
        visits = self._folder.all()
        grid = line_grid(self.settings, len(self.robot.motor_names))
        for visit in visits:
            check_unchanged(visit, self._digest, grid)
        return visits

    @property
    def _folder(self) -> VisitFolder:
        return VisitFolder(self.settings.output / "visits")

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
        NotIdentifiable
            Naming the targets that no visit brings nearer.
        """
        with self._evaluation(progress) as now:
            waiting = tuple(visit for visit in now.visits if visit.state == "open")
            return waiting or self._planned(now)

    def tell(self, number: int, records: str | Path) -> bool:
        """Take a visit's records; return whether they are new.

        Raises
        ------
        InvalidInput
            If there is no such visit, or the records are not its own.
        """
        with self._evaluation() as now:
            return _visit(now.visits, number).take(Path(records))

    def fail(self, number: int, reason: str) -> None:
        """Note that a visit failed; another is planned in its place where it is needed.

        Raises
        ------
        InvalidInput
            If there is no such visit, or its records are here.
        """
        with self._evaluation() as now:
            _visit(now.visits, number).fail(reason)

    def status(self, progress: StageProgress | None = None) -> CampaignStatus:
        """Return how far the campaign is; fits where new records are here."""
        with self._evaluation(progress) as now:
            return now.status

    def identified(self, latest: Estimate) -> ElasticRobot:
        """Return the robot with the values of an estimate and how certain they are.

        Raises
        ------
        InvalidInput
            If no body can have the fitted inertia.
        """
        data = {"data": f"campaign, cost {latest.cost:.3g} times its expectation"}
        levels = np.array([one.level for one in latest.friction]) if latest.friction else None
        return fitted_robot(
            self.robot, latest.values, latest.trust, data, latest.covariance, levels
        )

    @contextmanager
    def _evaluation(self, progress: StageProgress | None = None) -> Iterator[Evaluation]:
        with open_stages(self.settings.output / "stages", progress) as stages:
            self._folder.recover()
            yield Evaluation(self.settings, self.robot, self._digest, self.visits, stages)

    def _planned(self, now: Evaluation) -> tuple[Visit, ...]:
        """Plan new visits and write them; none where the campaign has ended."""
        if now.checked is None:
            plans = now.planner.check()
            seconds = FEWEST * now.planner.shortest + plans[0].duration
            self._require(seconds / 60, now)
            return self._write(plans, "check", self.robot)
        friction = friction_of(self.settings, self.robot)
        check_low_level(now.checked, self.settings, friction)
        status = now.status
        if status.ended:
            return ()
        robot = now.planner.robot
        if status.estimate is None:
            self._require(FEWEST * now.forecast.shortest, now)
            check_hope(status.outlook)
            return self._write(now.planner.first(now.forecast, status.remaining), "first", robot)
        if not status.short_of:
            plans = now.planner.repeated(fitted_visits(now.visits)[0].plan)
            return self._write(plans, "repeat", self.robot)
        plans = now.planner.accuracy(now.forecast, status.remaining)
        return self._write(plans, "accuracy", robot)

    def _require(self, minutes: float, now: Evaluation) -> None:
        """Refuse to begin what the minutes do not allow."""
        needed = now.minutes + minutes
        if needed > self.settings.minutes:
            raise InvalidInput(
                f"minutes: {self.settings.minutes:g}; a low-level run and {FEWEST} short visits "
                f"need {needed:.2g} at least; allow more, or shorten multisine.period"
            )

    def _write(
        self, plans: list[ExperimentPlan], purpose: Purpose, robot: ElasticRobot
    ) -> tuple[Visit, ...]:
        """Write visits whose limits were met by `robot`."""

        def write_files(plan: ExperimentPlan, files: Path) -> ExperimentPlan:
            return write_visit_files(plan, files, self.settings, robot)

        return self._folder.add(plans, purpose, self._digest, write_files)


def _visit(visits: tuple[Visit, ...], number: int) -> Visit:
    """Return the visit of a number."""
    for visit in visits:
        if visit.number == number:
            return visit
    raise InvalidInput(f"visit {number}: the campaign has asked for {len(visits) or 'none'} so far")
