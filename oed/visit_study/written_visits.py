"""Visits of a study as files: plans, and what a controller is told, a folder each."""

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from oed.campaign.driven_robot import write_visit_files
from oed.campaign.simulated import simulate_visits
from oed.campaign.visits import Visit, VisitFolder
from oed.experiment.experiment_plan import ExperimentPlan
from oed.visit_study.study_file import VisitStudy
from robotmodels import ElasticRobot, load_robot
from robotmodels.common.errors import InvalidInput
from robotmodels.common.fingerprints import fingerprint
from robotmodels.common.progress import Progress
from robotmodels.library.robot_digest import robot_digest


def write_visits(
    study: VisitStudy, plans: Sequence[ExperimentPlan], robot: ElasticRobot
) -> tuple[Visit, ...]:
    """Write visits into ``visits`` of the output; those with records stay if they are the same.

    Raises
    ------
    InvalidInput
        If there are records of other visits, which would be lost, or visits of a campaign.
    """
    visits = VisitFolder(study.output / "visits")
    there = visits.all()
    if any(visit.purpose != "study" for visit in there):
        raise InvalidInput(
            f"output: {visits.folder} is a campaign's; give the study another output"
        )
    if measured := sum(visit.state == "measured" for visit in there):
        if len(there) == len(plans) and all(map(_same, there, plans)):
            return there
        raise InvalidInput(
            f"output: {visits.folder} has records of {measured} visits of another plan; move that "
            "folder away, or give the study another output"
        )
    if visits.folder.exists():
        shutil.rmtree(visits.folder)
    digest = robot_digest(robot)

    def write_files(plan: ExperimentPlan, folder: Path) -> ExperimentPlan:
        return write_visit_files(plan, folder, study, robot)

    return visits.add(plans, "study", digest, write_files)


def _same(visit: Visit, plan: ExperimentPlan) -> bool:
    """Tell whether a visit is that of a plan, whose amplitudes its files may have lowered."""
    return fingerprint(replace(visit.plan, scale=plan.scale)) == fingerprint(plan)


def simulate_study_visits(study: VisitStudy, progress: Progress | None = None) -> tuple[Visit, ...]:
    """Simulate the visits of a study that have no records yet; return all.

    Raises
    ------
    InvalidInput
        If none is planned yet, or the robot file was changed since.
    """
    folder, robot = VisitFolder(study.output / "visits"), load_robot(study.robot)
    visits = folder.all()
    if not visits:
        raise InvalidInput(f"{folder.folder}: no visit is planned yet; oed design plans them")
    if any(visit.robot_digest != robot_digest(robot) for visit in visits):
        raise InvalidInput(
            f"robot {robot.name!r}: its file was changed after the visits were planned; plan them "
            "anew by oed design"
        )
    truth = robot if study.truth is None else load_robot(study.truth)
    waiting = [visit for visit in visits if visit.state == "open"]
    simulate_visits(study, robot, truth, waiting, progress)
    return visits
