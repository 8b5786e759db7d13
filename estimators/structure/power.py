"""The probability that data will show springs, and tell where they are, before measuring.

With d_0 the change of the whitened data by a model without the spring, fitted to data without
noise, and d_j that by one with rival j instead, regressors are g_0 = d_0/|d_0|, and of rivals
g_j = (d_0 - d_j)/|d_0 - d_j|. The test is of size z + g_0'e, e the noise, and rival j fits worse if

    (g_0 - g_j)'e / |g_0 - g_j| > -sqrt(lambda_j / (2 + 2 g_0'g_j)),  lambda_j = |d_j|^2,

which is exact where one linear step is. All hold together by one normal law.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr, ndtri
from scipy.stats import multivariate_normal

from estimators.fitting.fitted_model import FittedModel
from estimators.fitting.least_squares import Fit, as_fit
from estimators.fitting.run_problem import RunProblem
from estimators.fitting.trust_region import SearchResult
from estimators.structure.refits import SHORTLIST, Refits
from estimators.structure.score_table import TOLD_APART, Score
from estimators.structure.score_tests import DAMPING_TIMES, fitted_robot
from robotmodels.common.arrays import Array, check_level
from robotmodels.description.robot_file import Spring
from robotmodels.elastic.possible_springs import possible_springs, with_springs
from robotmodels.elastic.tool_response import underlying_robot
from robotmodels.linear.response import frequency_response

_RIVALS = 4 * SHORTLIST
"""Rivals of one spring that are refitted."""

_CERTAIN = 7.0
"""Standard deviations from which on an event counts as certain."""


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
        Probability that its score test fires and the refit falls as far: Phi(z - c), z the smaller
        one of the test's and sqrt(lambda), c the tests' limit.
    right_place : float
        Probability that it fires and none of the rivals fits better.
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
    trial = refits.replacements(exact, springs, spring, rivals=_RIVALS)
    misfit, count = max(trial.rise, 0.0), trial.table.independent
    size = min(float(np.sqrt(misfit)), _size(trial.score, count))
    shows = size + float(ndtri(level / count))
    rivals = np.maximum(list(trial.misfits.values()), 0.0)
    changes = [_change(each) for each in trial.rivals.values()]
    margins, correlation = rivalry(_change(trial.fit), changes, rivals)
    detection = float(ndtr(shows))
    return StructurePower(
        spring.name,
        misfit,
        float(min(rivals, default=np.inf)),
        tuple(name for name, each in trial.misfits.items() if each < TOLD_APART),
        detection,
        min(all_above(np.array([shows, *margins]), correlation), detection),
    )


def _size(score: Score | None, independent: float) -> float:
    """Return a score test in standard deviations, what its search for a damping time costs off."""
    return -np.inf if score is None else float(-ndtri(score.probability / independent))


def _change(fit: FittedModel) -> Array:
    """Return the residuals of a fit to data without noise, whitened and real, (r,)."""
    white = fit.problem.residuals(fit.parameters.values)[0].ravel()
    return np.concatenate([white.real, white.imag])


def rivalry(change: Array, by_rivals: Sequence[Array], misfits: Array) -> tuple[Array, Array]:
    """Return margins (j,) of rivals, and correlations (1 + j, 1 + j) of the test and of them.

    Parameters
    ----------
    change : ndarray, (r,)
        Residuals d_0 without the spring.
    by_rivals : sequence of ndarray, (r,)
        Residuals d_j with rivals in its place.
    misfits : ndarray, (j,)
        Squared misfits lambda_j.
    """
    missing = _unit(change)
    regressors = np.reshape([_unit(change - each) for each in by_rivals], (-1, len(change)))
    directions = np.stack([missing, *(_unit(missing - each) for each in regressors)])
    return np.sqrt(misfits / (2 + 2 * regressors @ missing)), directions @ directions.T


def _unit(vector: Array) -> Array:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-300))


def all_above(margins: Array, correlation: Array) -> float:
    """Return the probability that standard normal n_j > -margins_j, (r,), for all of them.

    Parameters
    ----------
    margins : ndarray, (r,)
        Margins.
    correlation : ndarray, (r, r)
        Of the n_j.
    """
    near = margins < _CERTAIN
    correlation = correlation + np.diag(1 - np.diag(correlation))  # 0 of a rival like the spring
    if not near.any():
        return 1.0
    law = multivariate_normal(cov=correlation[np.ix_(near, near)], allow_singular=True, seed=0)
    return float(np.clip(law.cdf(margins[near]), 0.0, 1.0))


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
