"""The probability that data will show springs, and tell where they are, before measuring.

Of data without noise a model with alternative j in the spring's place, refitted, leaves d_j of the
whitened data. In data with noise e the fits of both move along their tangents, P the projections:

    chi^2_j - chi^2 = |d_j|^2 + 2 d_j'e - |P_j e|^2 + |P e|^2

All alternatives together lose, and the test fires, in a share of draws of e. The largest part is
2 d_j'e, so that one alternative loses with Phi(|d_j|/2); the last two count where d_j is small.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import orth
from scipy.special import ndtr, ndtri

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

_ALTERNATIVES = 4 * SHORTLIST
"""Alternatives of one spring that are refitted."""

_CERTAIN = 150.0
"""Squared misfit from which on no noise makes an alternative the better one."""

_DRAWS = 10_000
"""Draws of the noise."""


@dataclass(frozen=True)
class StructurePower:
    """The power of data to identify a spring that a robot is assumed to have.

    Attributes
    ----------
    name : str
        Spring.
    misfit : float
        Squared misfit lambda of the best fit without it, to data without noise.
    alternative_misfit : float
        The same with the best alternative in its place; infinite where no other spring comes near.
    twins : tuple of str
        Alternatives that are not distinguished in 95 %.
    detection : float
        Probability that its score test fires and the refit falls as far: Phi(z - c), z the smaller
        one of the test's and sqrt(lambda), c the tests' limit.
    right_place : float
        Probability that it fires and none of the alternatives fits better.
    """

    name: str
    misfit: float
    alternative_misfit: float
    twins: tuple[str, ...]
    detection: float
    right_place: float

    def __str__(self) -> str:
        group = f"; not distinguished from {', '.join(self.twins)}" if self.twins else ""
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
    """Return the power of data like those of a fit to identify springs of assumed values.

    Of the fit's data only positions, lines, weights and inputs count; of simulated data, the plan.

    Parameters
    ----------
    fit : FittedModel
        Fit of the robot without the springs.
    springs : sequence of Spring
        Springs with assumed values, all of them present.
    elements : sequence of Spring, optional
        Alternatives; by default all of `possible_springs`.
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
    alternatives = possible_springs(robot) if elements is None else tuple(elements)
    names = {spring.name for spring in springs}
    alternatives = (
        *springs,
        *(alternative for alternative in alternatives if alternative.name not in names),
    )
    refits = Refits(robot, alternatives, tuple(damping_times))
    exact = _without_noise(fit, springs)
    return tuple(_power(refits, exact, springs, spring, level) for spring in springs)


def _power(
    refits: Refits, exact: FittedModel, springs: Sequence[Spring], spring: Spring, level: float
) -> StructurePower:
    trial = refits.replacements(exact, springs, spring, alternatives=_ALTERNATIVES)
    misfit, count = max(trial.rise, 0.0), trial.table.independent
    size = min(float(np.sqrt(misfit)), _size(trial.score, count))
    shows = size + float(ndtri(level / count))
    detection = float(ndtr(shows))
    near = [trial.alternatives[name] for name, each in trial.misfits.items() if each < _CERTAIN]
    change = _whitened(trial.fit)[0]
    unit = np.sqrt(misfit / max(float(change @ change), 1e-300))
    parts = [(unit * remainder, tangents) for remainder, tangents in map(_whitened, near)]
    return StructurePower(
        spring.name,
        misfit,
        max(min(trial.misfits.values(), default=np.inf), 0.0),
        tuple(name for name, each in trial.misfits.items() if each < TOLD_APART),
        detection,
        detection
        if not near
        else min(detection, share_of_right(shows, change, _whitened(exact)[1], parts)),
    )


def _size(score: Score | None, independent: float) -> float:
    """Return a score test in standard deviations, what its search for a damping time costs off."""
    return -np.inf if score is None else float(-ndtri(score.probability / independent))


def _whitened(fit: FittedModel) -> tuple[Array, Array]:
    """Return whitened residuals (r,) of a fit and tangents (r, p) of its model, as real numbers."""
    residuals, slopes = fit.problem.residuals(fit.parameters.values)
    columns = np.hstack([residuals.reshape(-1, 1), slopes.reshape(-1, slopes.shape[-1])])
    parts = np.concatenate([columns.real, columns.imag])
    return parts[:, 0], parts[:, 1:]


def share_of_right(
    margin: float, change: Array, tangents: Array, alternatives: Sequence[tuple[Array, Array]]
) -> float:
    """Return the share of draws in which the score test fires and no alternative fits better.

    Parameters
    ----------
    margin : float
        Of the test above its limit, in standard deviations.
    change : ndarray, (r,)
        What the model without the spring leaves of the data: direction of the test.
    tangents : ndarray, (r, p)
        Of the right model.
    alternatives : sequence of pairs of ndarray, (r,) and (r, p)
        What each alternative leaves, in standard deviations of the noise, and its tangents.
    """
    parts = [change[:, None] / np.linalg.norm(change), orth(tangents)]
    for remainder, slopes in alternatives:
        parts += [remainder[:, None], orth(slopes)]
    factor = np.linalg.qr(np.hstack(parts), mode="r")
    draws = np.random.default_rng(0).standard_normal((_DRAWS, len(factor))) @ factor
    ends = np.cumsum([part.shape[1] for part in parts])[:-1]
    test, right, *others = np.split(draws, ends, axis=1)
    fires = test[:, 0] > -margin
    for (remainder, _), linear, moved in zip(alternatives, others[::2], others[1::2], strict=True):
        gain = np.square(right).sum(axis=1) - np.square(moved).sum(axis=1)
        fires &= remainder @ remainder + 2 * linear[:, 0] + gain > 0
    return float(fires.mean())


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
