"""A study of visits: the table of what could be run, the best plan, and its visits."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from oed.criteria.targets import by_name_or_kind
from oed.design.optimal_spectra import SpectraDesign
from oed.exact.visit_plan import (
    TimeCurve,
    VisitPlan,
)
from oed.information_sets.experiment_candidates import ExperimentCandidates
from oed.visit_study.study_file import VisitStudy
from oed.visit_study.study_inputs import check_known, parameter_robots, planner_of
from oed.visit_study.visit_problem import StudyVisit, VisitProblem, over_samples
from robotmodels import ElasticRobot, load_robot
from robotmodels.common.arrays import Array, read_only
from robotmodels.common.progress import StageProgress
from robotmodels.linear.noise import InputOutputNoise


@dataclass(frozen=True, eq=False)
class VisitStudyResults:
    """What a study of visits computed.

    Attributes
    ----------
    study : VisitStudy
        Its settings.
    robot : ElasticRobot
        The robot at its file's values.
    noise : InputOutputNoise
        Noise of a period.
    table : ExperimentCandidates
        Visits that could be made, at typical torques.
    plan : VisitPlan
        The best of them, at typical torques.
    curve : TimeCurve
        The best of other times.
    spectra : SpectraDesign or None
        Designed spectra; None where they are flat.
    visits : tuple of StudyVisit
        The visits in order, their amplitudes inside the limits.
    std : ndarray, (K, p)
        Predicted standard deviations of ln theta after these visits, for each sample of theta.
    targets : ndarray, (p,)
        Standard deviations asked for; not numbers where none is.
    """

    study: VisitStudy
    robot: ElasticRobot
    noise: InputOutputNoise
    table: ExperimentCandidates
    plan: VisitPlan
    curve: TimeCurve
    spectra: SpectraDesign | None
    visits: tuple[StudyVisit, ...]
    std: Array
    targets: Array

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the p parameters."""
        return self.table.information.names

    @property
    def omega(self) -> Array:
        """Excited lines, (F,) [rad/s]."""
        return self.visits[0].plan.multisine.omega

    @property
    def overall_std(self) -> Array:
        """Predicted standard deviations at worst over samples of theta, or their mean, (p,)."""
        robust = self.study.design.robust
        return over_samples(self.std, "average" if robust is None else robust.kind)

    @cached_property
    def seconds(self) -> Array:
        """Robot time of each visit, its move and settling included, (V,) [s]."""
        return np.array([one.plan.duration for one in self.visits])


def run_visit_study(study: VisitStudy, progress: StageProgress | None = None) -> VisitStudyResults:
    """Plan the visits of a study.

    Raises
    ------
    InvalidInput
        Naming the key that does not fit, or what would be feasible: the minutes that are needed,
        the accuracy within those allowed.
    NotIdentifiable
        Naming the parameters that all candidates leave open.
    """
    robot = load_robot(study.robot)
    targets = np.full(len(robot.parameters), np.nan)
    if study.design.targets is not None:
        targets = by_name_or_kind(study.design.targets, robot.parameters.names, "design.targets")
    check_known(study, robot)
    planner = planner_of(study, robot, progress)
    robots = parameter_robots(study, planner)
    noise = InputOutputNoise.of_levels(
        planner.levels, len(planner.grid.lines), study.noise.torque, speed=study.noise.speed
    )
    problem = VisitProblem(study, planner, robots, noise)
    spectra = problem.spectra()
    table = problem.table(spectra)
    plan, visits, std = problem.reached(table, targets)
    return VisitStudyResults(
        study=study,
        robot=robot,
        noise=noise,
        table=table,
        plan=plan,
        curve=problem.curve(table, plan),
        spectra=spectra,
        visits=visits,
        std=read_only(std),
        targets=read_only(targets),
    )
