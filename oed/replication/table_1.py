"""[WM] Table 1 from this study's models, and how often each parameter is reasonable."""

from dataclasses import dataclass

import numpy as np

from estimators.uncertainty.covariance import Uncertainty
from oed.replication.six_estimators import (
    BEST_COST,
    BEST_COUNT,
    REASONABLE_RANGE,
    REFERENCE,
    Evaluation,
)
from robotmodels import ElasticRobot
from robotmodels.common.arrays import Array


@dataclass(frozen=True, eq=False)
class Table1:
    """Parameters of the best LLS15U models over those of the very best, (p,) each.

    Attributes
    ----------
    names : tuple of str
        p parameters.
    minimum, median, maximum, mean, std : ndarray
        Over the best models.
    theory : ndarray
        Relative standard deviations of the best model by Theorem 1.
    count : int
        Number of best models.
    within : int
        Number of models with a normalised cost below 1.05.
    """

    names: tuple[str, ...]
    minimum: Array
    median: Array
    maximum: Array
    mean: Array
    std: Array
    theory: Array
    count: int
    within: int


def table_1(evaluation: Evaluation, theorem1: Uncertainty) -> Table1:
    """Return the statistics of the best models beside the standard deviations of the best one.

    Parameters
    ----------
    theorem1 : Uncertainty
        Theorem1 of the best LLS15U model.
    """
    row = evaluation.of(REFERENCE)
    count = min(BEST_COUNT, evaluation.values.shape[1])
    best = evaluation.relative[row, :count]
    return Table1(
        evaluation.parameters,
        best.min(axis=0),
        np.asarray(np.median(best, axis=0)),
        best.max(axis=0),
        best.mean(axis=0),
        best.std(axis=0, ddof=1) if count > 1 else np.full(best.shape[1], np.nan),
        theorem1.std,
        count,
        int((evaluation.user_normalised[row] < BEST_COST).sum()),
    )


@dataclass(frozen=True, eq=False)
class Groups:
    """Indices of the parameters of gearboxes and of the arm structure, dampers after springs.

    Attributes
    ----------
    gear_springs, arm_springs, gear_dampers, arm_dampers : tuple of int
        Indices; pairs are in the same order.
    """

    gear_springs: tuple[int, ...]
    arm_springs: tuple[int, ...]
    gear_dampers: tuple[int, ...]
    arm_dampers: tuple[int, ...]

    @property
    def springs(self) -> tuple[int, ...]:
        """Gearboxes, then arm."""
        return self.gear_springs + self.arm_springs

    @property
    def dampers(self) -> tuple[int, ...]:
        """Gearboxes, then arm."""
        return self.gear_dampers + self.arm_dampers


def groups_of(robot: ElasticRobot) -> Groups:
    """Return which free parameters belong to gearboxes and which to the arm structure."""
    names = robot.parameters.names
    pairs = [
        (spring.axis == "drive", f"{spring.name}.stiffness", f"{spring.name}.damping")
        for spring in robot.file.springs
    ]
    pairs = [pair for pair in pairs if pair[1] in names and pair[2] in names]

    def indices(gear: bool, which: int) -> tuple[int, ...]:
        return tuple(names.index(pair[which]) for pair in pairs if pair[0] == gear)

    return Groups(indices(True, 1), indices(False, 1), indices(True, 2), indices(False, 2))


def success_share(evaluation: Evaluation) -> Array:
    """Return for each parameter (p,) the part of the reference's models within [0.5, 2]."""
    low, high = REASONABLE_RANGE
    relative = evaluation.relative[evaluation.of(REFERENCE)]
    return np.asarray(((relative >= low) & (relative <= high)).mean(axis=0))


def hardest_spring(evaluation: Evaluation, theorem1: Uncertainty, groups: Groups) -> str:
    """Return the arm spring of the largest standard deviation, which [WM] leave out."""
    arm = groups.arm_springs or groups.gear_springs
    return evaluation.parameters[max(arm, key=lambda i: float(theorem1.std[i]))]
