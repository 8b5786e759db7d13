"""The choice of springs: forward by score tests, with exchanges, and backward.

A step is the refit of a shortlist of springs from several starts. It is accepted if the cost falls
near what the score test expects: the right spring may be named and its refit still end in a worse
minimum. After each addition every earlier one is exchanged where another spring does better, as the
first that are added stand in for several, and dropped where it is no longer needed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import ndtr

from estimators.fitting.fitted_model import FittedModel
from estimators.structure.refits import SHORTLIST, Refits
from estimators.structure.score_table import TOLD_APART, Score, ScoreTable
from estimators.structure.score_tests import DAMPING_TIMES, fitted_robot
from robotmodels.common.arrays import check_count, check_level
from robotmodels.common.printing import ReprHtml
from robotmodels.description.robot_file import Spring
from robotmodels.elastic.possible_springs import possible_springs

_PASSES = 4
"""Steps for each spring that may be added, at most: exchanges could go round in a circle."""


@dataclass(frozen=True, eq=False)
class StructureStep:
    """One step of the selection of springs.

    Attributes
    ----------
    action : str
        "add", "exchange" or "drop".
    spring : str
        Spring that was added or dropped.
    instead_of : str
        Spring that it replaced.
    expected, fall : float
        Expected and actual decrease in cost; of an exchange `expected` is that from the fit
        without either spring.
    bic : float
        Schwarz's criterion after the step: twice the cost and ln N for each parameter; of weights
        that make no likelihood of the cost it means nothing.
    fit : FittedModel
        Fit after the step.
    """

    action: str
    spring: str
    instead_of: str
    expected: float
    fall: float
    bic: float
    fit: FittedModel

    def __str__(self) -> str:
        instead = f" instead of {self.instead_of}" if self.instead_of else ""
        return (
            f"{self.action} {self.spring}{instead}: cost falls by {self.fall:.4g} (expected "
            f"{self.expected:.4g}), BIC {self.bic:.6g}"
        )


@dataclass(frozen=True, eq=False)
class StructureChoice(ReprHtml):
    """Springs identified in addition to those of a robot, step by step.

    Attributes
    ----------
    fit : FittedModel
        Fit of the robot with them.
    springs : tuple of Spring
        Springs that were added, with fitted values.
    twins : dict of str to tuple of str
        For each of them the springs that explain the data so nearly as well that noise decides.
    steps : tuple of StructureStep
        How they were chosen.
    table : ScoreTable
        Score tests of the last fit: of springs, numbers of the robot file, and lines.
    bic : tuple of float
        Schwarz's criterion of the first and of the last fit.
    stopped : str
        Why no further spring was added.
    level : float
        Probability of a false alarm of all score tests together.
    """

    fit: FittedModel
    springs: tuple[Spring, ...]
    twins: dict[str, tuple[str, ...]]
    steps: tuple[StructureStep, ...]
    table: ScoreTable
    bic: tuple[float, float]
    stopped: str
    level: float

    @property
    def contradicted(self) -> tuple[str, ...]:
        """Numbers of the robot file, and lines, that the data contradict beside the springs."""
        firing = self.table.significant(self.level)
        return tuple(score.name for score in firing if score.spring is None)

    @property
    def caution(self) -> str:
        """What to do about these first; nothing where there are none."""
        names = self.contradicted
        more = f" and {len(names) - 3} more" if len(names) > 3 else ""
        return (
            f"the data contradict {', '.join(names[:3])}{more}: correct, free or leave out the "
            "first of these and select springs again, as springs may stand in for it"
            if names
            else ""
        )

    def __str__(self) -> str:
        count = len(self.springs)
        lines = [f"{count} spring{'s' * (count != 1)} added; {self.stopped}"]
        for spring in self.springs:
            twins = self.twins[spring.name]
            group = f"; the data cannot tell it from {', '.join(twins)}: tie them" if twins else ""
            stiffness = float(spring.stiffness)  # type: ignore[arg-type]  # none hardens
            lines.append(f"  {spring.name}: {stiffness:.4g}, damping {spring.damping:.4g}{group}")
        first, last = self.bic
        lines.append(f"  BIC {first:.6g} before, {last:.6g} now")
        lines += [f"  {step}" for step in self.steps]
        return "\n".join([*lines, f"  {self.caution}"] if self.caution else lines)


def choose_structure(
    fit: FittedModel,
    elements: Sequence[Spring] | None = None,
    *,
    level: float = 0.01,
    most: int = 8,
    damping_times: Sequence[float] = DAMPING_TIMES,
) -> StructureChoice:
    """Return the springs that significantly improve a fitted robot, selected step by step.

    Parameters
    ----------
    fit : FittedModel
        Fit of a robot to FRFs or runs.
    elements : sequence of Spring, optional
        Springs that it may get; by default all of `possible_springs`.
    level : float
        Probability of a false alarm of all score tests of a step together.
    most : int
        Number of springs that are added at most, 0 for none.
    damping_times : sequence of float
        As of `score_tests`.

    Raises
    ------
    InvalidInput
        As `score_tests`.
    SolverFailed
        If the search could not begin.
    """
    check_level(level, "choose_structure")
    check_count(most, "choose_structure: most", 0)
    robot = fitted_robot(fit)
    springs = possible_springs(robot) if elements is None else tuple(elements)
    choice = _Choice(Refits(robot, springs, tuple(damping_times)), level, fit)
    stopped = ""
    while not stopped and len(choice.added) < most:
        stopped = choice.add()
        while not stopped and choice.improve() and len(choice.steps) < _PASSES * most:
            pass
    stopped = stopped or f"no more than {most} were requested"
    end = choice.fit
    values = dict(zip(end.parameters.names, end.parameters.values, strict=True))
    return StructureChoice(
        end,
        tuple(_at(spring, values) for spring in choice.added),
        {spring.name: choice.twins(spring) for spring in choice.added},
        tuple(choice.steps),
        choice.refits.scores(end, numbers=True),
        (_bic(fit), _bic(end)),
        stopped,
        level,
    )


@dataclass
class _Choice:
    """A choice as it goes on."""

    refits: Refits
    level: float
    fit: FittedModel
    added: list[Spring] = field(default_factory=list)
    steps: list[StructureStep] = field(default_factory=list)

    def add(self) -> str:
        """Add the best spring of a shortlist; return why there is none, or nothing."""
        table = self.refits.scores(self.fit)
        firing = [score for score in table.significant(self.level) if score.fall > 0]
        if not firing:
            return f"no score test of a further spring is significant at {100 * self.level:g} %"
        for first in range(0, min(len(firing), 3 * SHORTLIST), SHORTLIST):
            best = self.refits.best(self.fit, self.added, firing[first : first + SHORTLIST])
            if best is not None:
                self._accept("add", "", *best)
                return ""
        return f"{firing[0].name} has evidence, but no refit lowers the cost as expected"

    def improve(self) -> bool:
        """Exchange or drop added springs, where that is better; return whether it was."""
        before = len(self.steps)
        for old in tuple(self.added) if len(self.added) > 1 else ():
            trial = self.refits.replacements(self.fit, self.added, old, alternatives=0)
            others = [spring for spring in self.added if spring.name != old.name]
            tail = float(ndtr(-np.sqrt(max(trial.rise, 0.0)))) * trial.table.independent
            if trial.score is None or tail > self.level:
                self.added = others
                self._note("drop", old.name, "", 0.0, trial.fit)
                continue
            alternatives = [
                s for s in trial.table if s.name != old.name and s.fall > trial.score.fall / 2
            ]
            best = self.refits.best(trial.fit, others, alternatives[:SHORTLIST])
            if best is not None and best[1].cost < self.fit.cost:
                self._accept("exchange", old.name, *best)
        return len(self.steps) > before

    def twins(self, spring: Spring) -> tuple[str, ...]:
        """Return the springs that explain the data as well as an added one, but for noise."""
        trial = self.refits.replacements(self.fit, self.added, spring, alternatives=2 * SHORTLIST)
        return tuple(name for name, misfit in trial.misfits.items() if misfit < TOLD_APART)

    def _accept(self, action: str, old: str, score: Score, fit: FittedModel) -> None:
        assert score.spring is not None
        self.added = [*(s for s in self.added if s.name != old), score.spring]
        self._note(action, score.name, old, score.fall, fit)

    def _note(
        self, action: str, name: str, replaced: str, expected: float, fit: FittedModel
    ) -> None:
        fall = self.fit.cost - fit.cost
        self.steps.append(StructureStep(action, name, replaced, expected, fall, _bic(fit), fit))
        self.fit = fit


def _at(spring: Spring, values: dict[str, float]) -> Spring:
    """Return a spring with the values of a fit."""
    entries = ("stiffness", "damping")
    return spring.model_copy(update={e: float(values[f"{spring.name}.{e}"]) for e in entries})


def _bic(fit: FittedModel) -> float:
    return 2 * fit.cost + len(fit.parameters) * float(np.log(max(fit.problem.used_data, 1)))
