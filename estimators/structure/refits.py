"""Refits of a robot with springs added, exchanged or left out, from several starts."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimators.fitting.fitted_model import FittedModel
from estimators.fitting.least_squares import as_fit
from estimators.fitting.search import search_or_reason
from estimators.structure.score_table import Score, ScoreTable
from estimators.structure.score_tests import score_tests
from robotmodels.description.robot_file import Spring
from robotmodels.elastic.possible_springs import with_springs
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.elastic.tool_response import underlying_robot

NEAR = 0.5
"""Share of the expected decrease in cost from which on a refit is accepted."""

_CLOSE = 0.8
"""Share from which on no further start is tried."""

SHORTLIST = 3
"""Springs that are refitted before the best of them is taken."""

_FACTORS = 1e-4, 1e4  # bounds of a new spring's values, about its estimate
_EVALUATIONS, _TOLERANCE = 60, 1e-8


@dataclass(frozen=True, eq=False)
class Replacements:
    """A fit without one of its springs, and with others in its place.

    Attributes
    ----------
    fit : FittedModel
        Fit without the spring.
    table : ScoreTable
        Its score tests.
    score : Score or None
        That of the spring; None where it does not show.
    rise : float
        Rise of the squared misfit without the spring.
    misfits : dict of str to float
        Rise with the best alternatives in its place.
    alternatives : dict of str to FittedModel
        Fits with these.
    """

    fit: FittedModel
    table: ScoreTable
    score: Score | None
    rise: float
    misfits: dict[str, float]
    alternatives: dict[str, FittedModel]


@dataclass(frozen=True, eq=False)
class Refits:
    """Refits of a robot to the data of a fit.

    Attributes
    ----------
    robot : ElasticRobot
        Robot before springs were added.
    elements : tuple of Spring
        Springs that it may get.
    damping_times : tuple of float, s
        Of starts.
    """

    robot: ElasticRobot
    elements: tuple[Spring, ...]
    damping_times: tuple[float, ...]

    def scores(self, fit: FittedModel, *, numbers: bool = False) -> ScoreTable:
        """Return the score tests of the elements that a fit's robot has not, and of numbers."""
        names = {spring.name for spring in underlying_robot(fit.model).file.springs}
        absent = [spring for spring in self.elements if spring.name not in names]
        return score_tests(fit, absent, damping_times=self.damping_times, numbers=numbers)

    def replacements(
        self, fit: FittedModel, springs: Sequence[Spring], spring: Spring, alternatives: int
    ) -> Replacements:
        """Return the fit without one of its added springs, and misfits of its best alternatives."""
        others = [other for other in springs if other.name != spring.name]
        without = self.refit(fit, others)
        table = self.scores(without)
        score = next((s for s in table if s.name == spring.name), None)
        # Costs in units of the noise's variance: of weights that are no likelihood, too.
        scale = next((s.ratio**2 / s.fall for s in table if s.fall > 0), 2.0)
        least = 0.0 if score is None else NEAR * score.fall
        near = [s for s in table if s.name != spring.name and s.fall > least][:alternatives]
        best = [self.best(without, others, [alternative]) for alternative in near]
        fits = {pair[0].name: pair[1] for pair in best if pair is not None}
        misfits = {
            name: scale * (alternative.cost - fit.cost) for name, alternative in fits.items()
        }
        rise = scale * (without.cost - fit.cost)
        return Replacements(without, table, score, rise, misfits, fits)

    def best(
        self, fit: FittedModel, springs: Sequence[Spring], shortlist: Sequence[Score]
    ) -> tuple[Score, FittedModel] | None:
        """Return the refit of least cost, if that falls near what the score test expects."""
        refits = [(score, self.refit(fit, springs, score)) for score in shortlist if score.fall > 0]
        near = [pair for pair in refits if fit.cost - pair[1].cost >= NEAR * pair[0].fall]
        return min(near, key=lambda pair: pair[1].cost) if near else None

    def refit(
        self, fit: FittedModel, springs: Sequence[Spring], score: Score | None = None
    ) -> FittedModel:
        """Return the best fit of the robot with springs, and one more, from several starts."""
        new = None if score is None else score.spring
        robot = with_springs(self.robot, [*springs, *([] if new is None else [new])], free=True)
        if new is None or score is None:
            return _search(fit, robot, None)
        best: FittedModel | None = None
        for start in self._starts(new, score.damping_time):
            end = _search(fit, robot, start)
            best = end if best is None or end.cost < best.cost else best
            if fit.cost - best.cost >= _CLOSE * score.fall:
                break
        assert best is not None
        return best

    def _starts(self, spring: Spring, favoured: float) -> Iterator[Spring]:
        """Yield starts: the step's compliance, and a tenth, with the favoured damping time first.

        Close to rigid the cost falls for certain, with the step's compliance fast.
        """
        for time in sorted(
            self.damping_times, key=lambda t: abs(np.log((t + 1e-9) / (favoured + 1e-9)))
        ):
            for share in (1.0, 0.1):
                stiffness = float(spring.stiffness) / share  # type: ignore[arg-type]  # none hardens
                values = {"stiffness": stiffness, "damping": max(time * stiffness, 1e-9)}
                yield spring.model_copy(update=values)


def _search(fit: FittedModel, robot: ElasticRobot, new: Spring | None) -> FittedModel:
    """Return the fit of another robot to a fit's data, from the fit's values and a new spring's."""
    values = dict(zip(fit.parameters.names, fit.parameters.values, strict=True))
    low, high = (dict(zip(fit.parameters.names, row, strict=True)) for row in fit.bounds)
    if new is not None:
        for entry in ("stiffness", "damping"):
            name, value = f"{new.name}.{entry}", float(getattr(new, entry))
            values[name], low[name], high[name] = value, _FACTORS[0] * value, _FACTORS[1] * value
    names = robot.parameters.names
    bounds = np.array([[each[name] for name in names] for each in (low, high)])
    problem = replace(fit.problem, model=robot, bounds=bounds)
    start = np.clip(np.array([values[name] for name in names]), *bounds)
    return as_fit(problem, start, search_or_reason(problem, start, _EVALUATIONS, _TOLERANCE))
