"""Score tests: where a spring is missing, and which numbers of a robot file are wrong.

A spring that is absent is rigid: compliance zero. The derivative of the FRF there, projected off
the parameters, is one regressor of the residuals, and its coefficient the compliance by one linear
step of the old parameters and the new one together. A compliance cannot be negative, so tests are
one-sided. Its damping time cannot be seen before the spring is: a few are tried. As functions of
the damping time the normalised regressors are a curve on the sphere, and with its length l

    P(largest z > c) <= Phi(-c) + l/(2 pi) exp(-c^2/2)

with equality for an arc of a great circle (Hotelling 1939, Naiman 1986), as where compliance and
damper are both free: the chi-bar-square law with the weights 1/2 and l/(2 pi).
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr, ndtri, stdtr

from estimators.fitting.fit_problem import Derived, FitProblem
from estimators.fitting.fitted_model import FittedModel
from estimators.structure.directions import number_columns, spring_columns
from estimators.structure.score_table import Score, ScoreTable, twins
from estimators.trust.directed_tests import OneStep, one_step
from estimators.trust.line_correlation import LineCorrelation, white_errors
from estimators.trust.line_scatter import Scatter, cautious_scatter
from estimators.trust.linearised_fit import LinearisedFit, Lines
from estimators.trust.residual_size import line_probabilities
from estimators.trust.rule import find_correlation
from robotmodels.common.arrays import Array, BoolArray, ComplexArray
from robotmodels.common.errors import InvalidInput
from robotmodels.description.robot_file import Spring
from robotmodels.elastic.possible_springs import possible_springs
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.elastic.tool_response import underlying_robot

DAMPING_TIMES = (2e-4, 1e-3, 8e-3)
"""Of absent springs [s]: ratios of damping to stiffness."""

_LEVEL, _DRAWS = 0.05, 20_000
"""Level at which dependent tests are counted, and draws of their joint law."""


def score_tests(
    fit: FittedModel,
    elements: Sequence[Spring] | None = None,
    *,
    damping_times: Sequence[float] = DAMPING_TIMES,
    numbers: bool = True,
) -> ScoreTable:
    """Return score tests of elements that a fitted robot may lack, strongest evidence first.

    Noise counts as the data state it: it is not enlarged where residuals are too large, as a spring
    that is missing makes them so.

    Parameters
    ----------
    fit : FittedModel
        Fit of a robot to FRFs or runs.
    elements : sequence of Spring, optional
        Springs that may be missing; by default all of `possible_springs`.
    damping_times : sequence of float
        Of absent springs, damping over stiffness [s].
    numbers : bool
        Whether numbers of the robot file are tested beside springs: delay, gains, gear ratios,
        numbers that are fixed, payload, friction behind gears, gears that harden; and single lines.

    Raises
    ------
    InvalidInput
        If the fit is not of a robot, it cannot have an element, or a damping time is negative.
    SolverFailed
        If the search could not begin.
    """
    times = np.array(damping_times, dtype=float)
    if not times.size or not (np.isfinite(times) & (times >= 0)).all():
        raise InvalidInput(f"damping_times: {list(damping_times)}; times of 0 s or more are needed")
    robot = fitted_robot(fit)
    springs = possible_springs(robot) if elements is None else tuple(elements)
    problem, values = fit.problem, fit.parameters.values
    at = problem.derived(values)
    tests = _linear(problem, values, at)
    rows = list[_Row]()
    if springs:
        columns = spring_columns(problem, springs, values, times)
        rows += _of_springs(tests, robot, springs, columns, times)
    if numbers:
        rows += _of_numbers(tests, number_columns(problem, values, at))
    return _table(rows, _of_lines(tests.fit) if numbers else None)


def fitted_robot(fit: FittedModel) -> ElasticRobot:
    """Return the robot of a fit.

    Raises
    ------
    InvalidInput
        If it is no fit, or not of a robot.
    SolverFailed
        If the search could not begin.
    """
    if not isinstance(fit, FittedModel):
        raise InvalidInput(f"fit: a {type(fit).__name__}; what estimators.fit returns is needed")
    fit.check_begun("score tests")
    return underlying_robot(fit.model)


_Row = tuple[Score, bool, Array]
"""A test, whether it is one-sided, and its regressor: whitened, off the parameters, of length 1."""


@dataclass(frozen=True, eq=False)
class _Linear:
    """A fit about its solution, and how its errors hang together along the lines."""

    fit: LinearisedFit
    correlation: LineCorrelation
    changes: Callable[[ComplexArray], Lines]

    def step(self, columns: ComplexArray) -> tuple[OneStep, Scatter] | None:
        """Return coefficients of changes of FRFs (Q, F, m, n, r) and their variances, if seen."""
        step = one_step(self.fit, self.changes(columns))
        if not step.seen.any():
            return None
        return step, cautious_scatter(self.fit, step.rows, self.correlation)

    def regressors(self, off: Lines) -> Array:
        """Return columns (Q, F, k, r) whitened by the noise, as unit vectors of real numbers."""
        white = (np.sqrt(self.fit.noise_weights)[..., None] * off).reshape(-1, off.shape[-1])
        parts = white.real if self.fit.real else np.concatenate([white.real, white.imag])
        return np.asarray(parts / np.linalg.norm(parts, axis=0))


def _linear(problem: FitProblem, values: Array, at: Derived) -> _Linear:
    fit = problem.linearise(values)
    # Residuals show the model's errors beside the noise: here they are no estimate of it.
    estimated = fit.deviations is not None or len(fit.line_correlation) > 0
    correlation = find_correlation(fit) if estimated else white_errors(len(problem.omega))
    return _Linear(fit, correlation, problem.changes(values, at))


def _of_springs(
    tests: _Linear,
    robot: ElasticRobot,
    springs: Sequence[Spring],
    columns: Iterator[ComplexArray],
    times: Array,
) -> Iterator[_Row]:
    """Yield the tests of springs that show in the data."""
    for spring, column in zip(springs, columns, strict=True):
        if (seen := tests.step(column)) is None:
            continue
        step, scatter = seen
        std = np.sqrt(scatter.variance)
        best = int(np.argmax(step.estimates / std))
        estimate, freedom = float(step.estimates[best]), float(scatter.degrees_of_freedom[best])
        white, time = tests.regressors(step.off), float(times[step.seen][best])
        cosines = (white[:, 1:] * white[:, :-1]).sum(axis=0)
        tail = _tail(estimate / std[best], freedom)
        length = float(np.arccos(np.clip(cosines, -1.0, 1.0)).sum())
        tail += length / (2 * np.pi) * float(np.exp(-(ndtri(tail) ** 2) / 2))
        fall = max(estimate, 0.0) ** 2 * float(step.powers[best])
        unit = "m/N" if robot.elements.linear(spring) else "rad/(N m)"
        spring = _with_values(spring, estimate, time)
        numbers = estimate, float(std[best]), unit, freedom, min(tail, 1.0), fall
        yield Score(spring.name, spring, *numbers, damping_time=time), True, white[:, best]


def _of_numbers(
    tests: _Linear, columns: Iterator[tuple[str, str, bool, ComplexArray]]
) -> Iterator[_Row]:
    """Yield the tests of numbers of the robot file that show in the data."""
    for name, unit, one_sided, column in columns:
        if (seen := tests.step(column[..., None])) is None:
            continue
        step, scatter = seen
        estimate, std = float(step.estimates[0]), float(np.sqrt(scatter.variance[0]))
        freedom = float(scatter.degrees_of_freedom[0])
        ratio = estimate / std
        tail = _tail(ratio, freedom) if one_sided else 2 * _tail(abs(ratio), freedom)
        fall = estimate**2 * float(step.powers[0])
        score = Score(name, None, estimate, std, unit, freedom, tail, fall)
        yield score, one_sided, tests.regressors(step.off)[:, 0]


def _of_lines(fit: LinearisedFit) -> Score:
    """Return the test of the least probable single line."""
    by_noise = fit.noise_fit
    probabilities = line_probabilities(by_noise)
    q, f, k = np.unravel_index(int(probabilities.argmin()), probabilities.shape)
    weights = fit.weights[q, f, k] if fit.weights.ndim == 3 else fit.weights[q, f, k, k]
    size = np.abs(by_noise.errors[q, f, k])
    return Score(
        f"line {f + 1} of element {k + 1} in position {q + 1}",
        None,
        float(np.sqrt(by_noise.noise_weights[q, f, k]) * size),
        1.0,
        "standard deviations",
        float(by_noise.degrees_of_freedom[q]),
        min(float(probabilities[q, f, k]) * int(fit.used.sum()), 1.0),
        float(np.real(weights) * size**2),
    )


def _table(rows: list[_Row], line: Score | None) -> ScoreTable:
    """Return the table of tests, their probabilities corrected for their number."""
    rows = sorted(rows, key=lambda row: (row[0].probability, -abs(row[0].ratio)))
    count, scores = 1.0, [score for score, _, _ in rows]
    if rows:
        correlation = np.stack([row for _, _, row in rows])
        correlation = correlation @ correlation.T
        count = effective_number(correlation, np.array([one for _, one, _ in rows]))
        index = [i for i, score in enumerate(scores) if score.spring is not None]
        several = [scores[i] for i in index]
        groups = twins(
            correlation[np.ix_(index, index)],
            np.array([score.ratio for score in several]),
            [score.name for score in several],
        )
        for i, group in zip(index, groups, strict=True):
            scores[i] = replace(scores[i], twins=group)
    if line is not None:
        scores, count = [*scores, line], count + 1
    corrected = [replace(s, probability=min(s.probability * count, 1.0)) for s in scores]
    corrected.sort(key=lambda score: (score.probability, -abs(score.ratio)))
    return ScoreTable(tuple(corrected), count)


def effective_number(correlation: Array, one_sided: BoolArray) -> float:
    """Return how many independent tests several dependent ones are worth, at a level of 5 %.

    The probability that the least of their probabilities is below a small one, in units of that
    one, by draws of their joint normal distribution.

    Parameters
    ----------
    correlation : ndarray, (r, r)
        Of the tests' z.
    one_sided : ndarray of bool, (r,)
        Tests of z, the others of its magnitude.
    """
    values, vectors = np.linalg.eigh(correlation)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    z = np.random.default_rng(0).standard_normal((_DRAWS, len(root))) @ root.T
    least = np.where(one_sided, ndtr(-z), 2 * ndtr(-np.abs(z))).min(axis=1)
    single = _LEVEL / len(root)
    return min(max(float((least < single).mean() / single), 1.0), float(len(root)))


def _tail(ratio: float, freedom: float) -> float:
    """Return the probability of a ratio at least as large, by the t law."""
    return float(stdtr(freedom, -ratio) if np.isfinite(freedom) else ndtr(-ratio))


def _with_values(spring: Spring, compliance: float, time: float) -> Spring:
    """Return the spring with the values of a compliance and a damping time, where these are any."""
    if not 1e-12 < compliance < 1e6:
        return spring
    damping = max(time / compliance, 1e-9)
    return spring.model_copy(update={"stiffness": 1 / compliance, "damping": damping})
