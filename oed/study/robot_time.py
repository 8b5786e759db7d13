"""How long the robot is needed for a plan."""

from dataclasses import dataclass

import numpy as np

from oed.study.parts import DesignedPlan
from oed.study.results import PlannedStudy


@dataclass(frozen=True)
class RobotTime:
    """Time that a plan takes on the robot.

    Attributes
    ----------
    seconds : float, s
        Time of all visits, moves between them included where the study tells how the robot moves.
    bound : bool
        Whether it is a lower bound, since the study does not tell how long a run takes: one period
        for each run, as long as neighbouring frequencies need to be told from each other.
    """

    seconds: float
    bound: bool


def robot_time(results: PlannedStudy) -> RobotTime | None:
    """Return how long a plan takes; None of measured data, and where there is one frequency."""
    plan, study = results.plan, results.study
    if not isinstance(plan, DesignedPlan):
        return None
    moves = 0.0 if plan.order is None else plan.order.duration
    if study.design.measuring is not None:
        return RobotTime(plan.visits * study.design.measuring + moves, bound=False)
    excitation = study.data.experiment
    if excitation is not None:
        periods = excitation.blocks * (excitation.periods + excitation.transient_periods)
        run = periods * excitation.multisine.period
        return RobotTime(plan.runs * run + plan.visits * excitation.settle + moves, bound=False)
    if len(plan.omega) < 2:
        return None
    shortest = 2 * np.pi / float(np.diff(plan.omega).min())
    return RobotTime(plan.runs * shortest + moves, bound=True)
