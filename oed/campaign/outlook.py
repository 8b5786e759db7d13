"""What a campaign can still reach: the minutes that its accuracies need, and those it has."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from oed.criteria.targets import TargetCriterion
from oed.design.constraints import Constraints
from oed.design.fastest_design import FastestDesign, fastest_design
from oed.design.optimal_design import optimal_design
from oed.exact.plan_score import standard_deviations
from oed.information_sets.experiment_candidates import ExperimentCandidates
from robotmodels.common.arrays import Array

_GAP = 1e-2
"""Of the least time: visits are rounded to runs and periods anyway."""


@dataclass(frozen=True, eq=False)
class Outlook:
    """What visits can still bring, were they divisible: a bound for whole ones.

    Attributes
    ----------
    needed : float, min
        Robot time that every accuracy needs at least.
    remaining : float, min
        Robot time that is left.
    shortest : float, min
        Duration of the shortest visit.
    std : ndarray, (p,)
        Relative standard deviations that the time left can bring, the worst target as near as can
        be.
    """

    needed: float
    remaining: float
    shortest: float
    std: Array

    @property
    def reachable(self) -> bool:
        """Whether the time left may suffice."""
        return self.needed <= self.remaining


@dataclass(frozen=True, eq=False)
class Forecast:
    """Visits to choose from, and how fast they reach the targets, were they divisible.

    Attributes
    ----------
    candidates : ExperimentCandidates
        Visits that could be made.
    targets : dict of str to float
        As of `TargetCriterion`.
    information : ndarray, (p, p)
        Information there is already.
    relaxed : FastestDesign
        Design of the least time.
    """

    candidates: ExperimentCandidates
    targets: dict[str, float]
    information: Array
    relaxed: FastestDesign

    @classmethod
    def of(
        cls, candidates: ExperimentCandidates, targets: Mapping[str, float], information: Array
    ) -> "Forecast":
        """Return how fast `candidates` reach the targets."""
        info, duration = candidates.information, candidates.duration
        relaxed = fastest_design(info, duration, dict(targets), information, _GAP)
        return cls(candidates, dict(targets), information, relaxed)

    @property
    def shortest(self) -> float:
        """Duration of the shortest visit [min]."""
        return float(self.candidates.duration.min()) / 60

    def outlook(self, minutes: float, quoted: Array | float = 1.0, faster: float = 1.0) -> Outlook:
        """Return what `minutes` can bring.

        Parameters
        ----------
        minutes : float, min
            Robot time that is left.
        quoted : ndarray, (p,), or float
            Quoted standard deviations over those of the information.
        faster : float
            Times as fast as these candidates that others may be.
        """
        duration = self.candidates.duration
        total = self.information
        if minutes > 0:
            objective = TargetCriterion(self.targets).objective(self.relaxed.names)
            limits = Constraints(time=60 * minutes * faster, durations=duration)
            info = self.candidates.information
            total = optimal_design(info, objective, limits, total).information
        return Outlook(
            needed=self.relaxed.bound / 60 / faster,
            remaining=max(minutes, 0.0),
            shortest=self.shortest,
            std=np.asarray(quoted * standard_deviations(total)),
        )
