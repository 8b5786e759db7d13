"""The probability that data will show springs, and tell where they are, before measuring."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr, ndtri

from estimators.fitting.fitted_model import FittedModel
from estimators.fitting.least_squares import Fit, as_fit
from estimators.fitting.run_problem import RunProblem
from estimators.fitting.trust_region import SearchResult
from estimators.structure.refits import SHORTLIST, Refits
from estimators.structure.score_table import TOLD_APART
from estimators.structure.score_tests import DAMPING_TIMES, fitted_robot
from robotmodels.common.arrays import check_level
from robotmodels.description.robot_file import Spring
from robotmodels.elastic.possible_springs import possible_springs, with_springs
from robotmodels.elastic.tool_response import underlying_robot
from robotmodels.linear.response import frequency_response


@dataclass(frozen=True)
class StructurePower:
    """What data will tell of a spring that a robot is assumed to have.

    Attributes
    ----------
    name : str
        Spring.
    misfit : float
        Squared misfit lambda of the best fit without it, to data without noise.
    rival_misfit : float
        The same with the best rival in its place; infinite where no other spring comes near.
    twins : tuple of str
        Rivals that are not told apart in 95 %.
    detection : float
        Probability that its score test fires: Phi(sqrt(lambda) - c), c the tests' limit.
    right_place : float
        Probability that it fires and no rival fits better: that times Phi(sqrt(lambda_T) / 2).
    """

    name: str
    misfit: float
    rival_misfit: float
    twins: tuple[str, ...]
    detection: float
    right_place: float

    def __str__(self) -> str:
        group = f"; not told from {', '.join(self.twins)}" if self.twins else ""
        return (
            f"{self.name}: shows with probability {self.detection:.3f}, at its place with "
            f"{self.right_place:.3f}{group}"
        )


def structure_power(
    fit: FittedModel,
    springs: Sequence[Spring],
    elements: Sequence[Spring] | None = None,
    *,
    level: float = 0.01,
    damping_times: Sequence[float] = DAMPING_TIMES,
) -> tuple[StructurePower, ...]:
    """Return what data like those of a fit tell of springs of assumed stiffness and damping.

    Of the fit's data only positions, lines, weights and inputs count; of simulated data, the plan.

    Parameters
    ----------
    fit : FittedModel
        Fit of the robot without the springs.
    springs : sequence of Spring
        Springs with assumed values, all of them present.
    elements : sequence of Spring, optional
        Rivals; by default all of `possible_springs`.
    level : float
        As in `choose_structure`.
    damping_times : sequence of float
        As of `score_tests`.

    Raises
    ------
    InvalidInput
        If the robot cannot have a spring.
    """
    check_level(level, "structure_power")
    robot = fitted_robot(fit)
    rivals = possible_springs(robot) if elements is None else tuple(elements)
    names = {spring.name for spring in springs}
    rivals = (*springs, *(rival for rival in rivals if rival.name not in names))
    refits = Refits(robot, rivals, tuple(damping_times))
    exact = _without_noise(fit, springs)
    return tuple(_power(refits, exact, springs, spring, level) for spring in springs)


def _power(
    refits: Refits, exact: FittedModel, springs: Sequence[Spring], spring: Spring, level: float
) -> StructurePower:
    trial = refits.replacements(exact, springs, spring, rivals=2 * SHORTLIST)
    misfit = max(trial.rise, 0.0)
    best = max(min(trial.misfits.values(), default=np.inf), 0.0)
    limit = float(-ndtri(level / trial.table.independent))
    detection = float(ndtr(np.sqrt(misfit) - limit))
    return StructurePower(
        spring.name,
        misfit,
        best,
        tuple(name for name, each in trial.misfits.items() if each < TOLD_APART),
        detection,
        detection * float(ndtr(np.sqrt(best) / 2)),
    )


def _without_noise(fit: FittedModel, springs: Sequence[Spring]) -> FittedModel:
    """Return the fit of a robot with springs to data that it explains exactly."""
    robot, problem = with_springs(underlying_robot(fit.model), springs, free=True), fit.problem
    fitted = dict(zip(fit.parameters.names, fit.parameters.values, strict=True))
    pairs = zip(robot.parameters.names, robot.parameters.values, strict=True)
    values = np.array([fitted.get(name, value) for name, value in pairs])
    response = frequency_response(robot, problem.positions, problem.omega, values)
    bounds = np.outer([1e-4, 1e4], values)
    if isinstance(problem, RunProblem):
        outputs = np.einsum("qfmn,qefn->qefm", response, problem.data.inputs)
        data = replace(problem.data, outputs=outputs)
        problem = replace(problem, model=robot, bounds=bounds, data=data)
    else:
        assert isinstance(fit, Fit)
        exact = replace(fit.estimate, response=response)
        problem = replace(fit.problem, model=robot, bounds=bounds, data=exact)
    return as_fit(problem, values, SearchResult(values, 0.0, 1, "without noise", 0))
