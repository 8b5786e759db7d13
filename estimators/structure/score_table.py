"""What score tests came to: a table, the strongest evidence first."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np
from scipy.special import ndtri, stdtrit

from robotmodels.common.arrays import Array
from robotmodels.common.printing import ReprHtml
from robotmodels.description.robot_file import Spring

TOLD_APART = 10.8
"""Squared misfit from which an alternative is distinguished in 95 %: Phi(-sqrt(10.8)/2) = 5 %."""

_LEVEL = 0.95


@dataclass(frozen=True, eq=False)
class Score:
    """Score test of one element, such as a spring, that a fitted robot may lack.

    Attributes
    ----------
    name : str
        Spring, number or line.
    spring : Spring or None
        The spring, with the stiffness and damping of the one-step estimate where it is positive.
    estimate, std : float
        One-step estimate and its standard deviation, in `unit`; a compliance of a spring.
    unit : str
        Unit of the estimate.
    degrees_of_freedom : float
        Degrees of freedom of the standard deviation.
    probability : float
        Of evidence as strong if the fit is right, corrected for the number of tests.
    fall : float
        Expected decrease in the fit's cost if the model had it.
    damping_time : float, s
        Of those tried the one that the data favour; not a number for other things than springs.
    twins : tuple of str
        Springs that would explain the residuals so nearly as well that noise decides.
    """

    name: str
    spring: Spring | None
    estimate: float
    std: float
    unit: str
    degrees_of_freedom: float
    probability: float
    fall: float
    damping_time: float = np.nan
    twins: tuple[str, ...] = ()

    @property
    def ratio(self) -> float:
        """Estimate over standard deviation: z."""
        return self.estimate / self.std if self.std > 0 else 0.0

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the estimate; a compliance is not negative."""
        at = (1 + _LEVEL) / 2
        finite = np.isfinite(self.degrees_of_freedom)
        half = self.std * float(stdtrit(self.degrees_of_freedom, at) if finite else ndtri(at))
        low, high = self.estimate - half, self.estimate + half
        return (max(low, 0.0), max(high, 0.0)) if self.spring is not None else (low, high)

    @property
    def stiffness(self) -> tuple[float, float, float]:
        """Estimated stiffness of a spring and the ends of its interval; infinite if rigid."""
        low, high = self.interval
        value, least, most = (1 / c if c > 0 else np.inf for c in (self.estimate, high, low))
        return value, least, most

    def __str__(self) -> str:
        low, high = self.interval
        text = (
            f"{self.name}: p = {self.probability:.2g}, {self.estimate:.3g} {self.unit} "
            f"({low:.3g} to {high:.3g}), cost would fall by {self.fall:.3g}"
        )
        if self.spring is not None and self.estimate > 0:
            value, least, most = self.stiffness
            text += f"; stiffness {value:.3g} ({least:.3g} to {most:.3g})"
        return text + (f"; as well: {', '.join(self.twins)}" if self.twins else "")


@dataclass(frozen=True, eq=False)
class ScoreTable(ReprHtml, Sequence[Score]):
    """Score tests, the strongest evidence first.

    Attributes
    ----------
    scores : tuple of Score
        The tests.
    independent : float
        Number of independent tests that they are worth: probabilities are multiplied by it.
    """

    scores: tuple[Score, ...]
    independent: float

    @overload
    def __getitem__(self, index: int) -> Score: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Score, ...]: ...
    def __getitem__(self, index: int | slice) -> Score | tuple[Score, ...]:
        return self.scores[index]

    def __len__(self) -> int:
        return len(self.scores)

    @property
    def springs(self) -> tuple[Score, ...]:
        """The tests of springs."""
        return tuple(score for score in self.scores if score.spring is not None)

    def significant(self, level: float = 0.05) -> tuple[Score, ...]:
        """Return the tests that fire at `level` over all."""
        return tuple(score for score in self.scores if score.probability < level)

    def __str__(self) -> str:
        firing = self.significant()
        head = f"{len(self)} score tests, {len(firing)} significant at 5 % (family-wise)"
        return "\n".join([head, *(f"  {score}" for score in self.scores[: max(len(firing), 5)])])


def twins(correlation: Array, ratios: Array, names: Sequence[str]) -> list[tuple[str, ...]]:
    """Return for each spring those that the data cannot tell from it.

    With z^2 the decrease in squared misfit by the right one, an alternative leaves
    z^2 (1 - rho^2) of it.

    Parameters
    ----------
    correlation : ndarray, (c, c)
        Correlations rho of the springs' regressors.
    ratios : ndarray, (c,)
        z of each spring.
    names : sequence of str
        Springs.
    """
    misfit = ratios[:, None] ** 2 * (1 - np.maximum(correlation, 0.0) ** 2)
    shown = (ratios > 0) & (ratios**2 > TOLD_APART)  # else everything is alike
    alike = (misfit < TOLD_APART) & (correlation > 0) & shown[:, None]
    np.fill_diagonal(alike, False)
    return [tuple(name for name, one in zip(names, row, strict=True) if one) for row in alike]
