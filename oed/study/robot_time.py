"""How long the robot is needed for a plan."""

from dataclasses import dataclass

import numpy as np

from oed.study.parts import DesignedPlan, MeasuredData
from oed.study.results import FittedStudy, PlannedStudy
from oed.study.settings.study_file import Study
from robotmodels.common.arrays import Array, IntArray


@dataclass(frozen=True)
class RobotTime:
    """Time that a plan takes on the robot.

    Attributes
    ----------
    seconds : float, s
        Time of all visits, moves between them included where the study tells how the robot moves.
    bound : bool
        Whether it is a lower bound: of simulated data where the study does not tell how long a run
        takes, one period for each run, as long as neighbouring frequencies need to be told from
        each other; of records, the periods that were recorded.
    """

    seconds: float
    bound: bool


def robot_time(results: PlannedStudy) -> RobotTime | None:
    """Return how long a plan or its records take; None of measured FRFs or a single frequency."""
    plan, study = results.plan, results.study
    if isinstance(results, FittedStudy) and isinstance(results.data, MeasuredData):
        recorded = results.data.recorded
        return None if recorded is None else RobotTime(recorded, bound=True)
    if not isinstance(plan, DesignedPlan):
        return None
    moves = 0.0 if plan.order is None else plan.order.duration
    visit = visit_seconds(study, plan)
    if visit is not None:
        return RobotTime(plan.visits * visit + moves, bound=False)
    if len(plan.omega) < 2:
        return None
    shortest = 2 * np.pi / float(np.diff(plan.omega).min())
    return RobotTime(plan.runs * shortest + moves, bound=True)


def visit_seconds(study: Study, plan: DesignedPlan) -> float | None:
    """Return how long a visit takes without moves [s]; None where the study does not tell."""
    if study.design.measuring is not None:
        return study.design.measuring
    excitation = study.data.experiment
    if excitation is None:
        return None
    periods = excitation.blocks * (excitation.periods + excitation.transient_periods)
    return plan.runs_per_visit * periods * excitation.multisine.period + excitation.settle


def growing_time(study: Study, plan: DesignedPlan, order: IntArray) -> Array | None:
    """Return the robot time after each visit [s], (N,); None where the study does not tell.

    The moves of the plan count in proportion to the positions that have been visited.

    Parameters
    ----------
    order : ndarray of int, (N,)
        Position of each visit of the plan.
    """
    visit = visit_seconds(study, plan)
    if visit is None:
        return None
    moves = 0.0 if plan.order is None else plan.order.duration
    first = np.zeros(len(order))
    first[np.unique(order, return_index=True)[1]] = 1.0
    measuring = visit * np.arange(1, len(order) + 1)
    return np.asarray(measuring + moves * np.cumsum(first) / first.sum())
