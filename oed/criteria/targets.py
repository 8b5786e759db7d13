"""Standard deviations that are asked for, and the criterion of reaching them all."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np

from oed.criteria.matrix_means import MatrixMean
from oed.criteria.objective import KINDS, Objective, Term
from robotmodels.common.arrays import Array, check_above_zero
from robotmodels.common.errors import InvalidInput, check_word, nearest


def by_name_or_kind(values: float | Mapping[str, float], names: Sequence[str], what: str) -> Array:
    """Return a positive number for each of p names, (p,); nan where none is meant.

    Parameters
    ----------
    values : float or mapping of str to float
        One number for all, or numbers by name, which comes first, by kind ("stiffness" is that of
        all springs) or by pattern ("g*.damping").
    names : sequence of str
        Names.
    what : str
        What the numbers are, for messages.

    Raises
    ------
    InvalidInput
        If a number is not positive, or a key fits no name.
    """
    keyed = values if isinstance(values, Mapping) else {"*": values}
    numbers = np.full(len(names), np.nan)
    for key, value in sorted(keyed.items(), key=lambda item: item[0] in names):
        check_above_zero(value, what if key == "*" else f"{what}: {key}")
        fits = [fnmatchcase(name, key) or key in name.split(".")[1:] for name in names]
        if not any(fits):
            kinds = [*names, *dict.fromkeys(".".join(name.split(".")[1:2]) for name in names)]
            raise InvalidInput(
                f"{what}: {key!r} is no free parameter and no kind of them{nearest(key, kinds)}"
            )
        numbers[fits] = value
    return numbers


@dataclass(frozen=True, eq=False)
class TargetCriterion:
    """The accuracy of all parameters together, in units of each one's target.

    Its value is the least of (target / standard deviation)^2, so that a plan of value one reaches
    every target, the last one exactly.

    Attributes
    ----------
    deviations : float or mapping of str to float
        Standard deviations, relative where parameters are ln theta, by name, kind or pattern; see
        `by_name_or_kind`. Parameters without one are nuisance.
    kind : {"maximin", "average"}
        With samples of theta, whether targets are reached at each of them, or by the geometric
        means of the standard deviations over them.
    """

    deviations: float | Mapping[str, float]
    name: str = "targets"
    kind: str = "maximin"

    @classmethod
    def of(cls, targets: "Targets") -> "TargetCriterion":
        """Return the criterion of targets: themselves, or to be reached at every sample."""
        return targets if isinstance(targets, TargetCriterion) else cls(targets)

    def objective(self, names: Sequence[str], samples: int = 1) -> Objective:
        """Return the least of the variances' inverses in units of the targets.

        Raises
        ------
        InvalidInput
            If a target is not positive or fits no parameter, there is none, or the kind is unknown.
        """
        check_word("kind", self.kind, KINDS)
        targets = by_name_or_kind(self.deviations, names, "targets")
        if np.isnan(targets).all():
            raise InvalidInput("targets: none given; at least one is needed")
        columns = np.eye(len(names))
        means = [
            MatrixMean("A", columns[:, [i]] / targets[i])
            for i in np.flatnonzero(~np.isnan(targets))
        ]
        if self.kind == "average":
            share = 1.0 / samples
            groups = tuple(tuple(Term(m, share, k) for k in range(samples)) for m in means)
        else:
            groups = tuple((Term(m, 1.0, k),) for k in range(samples) for m in means)
        return Objective(self.name, groups, (0.0,) * len(groups))


Targets = float | Mapping[str, float] | TargetCriterion
"""Standard deviations that are asked for, see `TargetCriterion`."""
