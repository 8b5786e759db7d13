"""Criteria over samples of theta: good on average, or at worst."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from oed.criteria.criteria import Criterion, averaged, checked_shares, objective_of
from oed.criteria.objective import KINDS, Objective, Term
from robotmodels.common.arrays import real_numbers
from robotmodels.common.errors import InvalidInput, check_word


@dataclass(frozen=True, eq=False)
class AverageCriterion:
    """The geometric mean of a criterion's efficiencies over samples of theta (pseudo-Bayesian).

    Attributes
    ----------
    criterion : str or Criterion
        Criterion of each sample.
    shares : sequence of float or None
        Weight of each sample; equal if None.
    """

    criterion: str | Criterion = "D"
    shares: Sequence[float] | None = None

    @property
    def name(self) -> str:
        """What reports call it."""
        return f"average {_name(self.criterion)}"

    def objective(self, names: Sequence[str], samples: int = 1) -> Objective:
        """Return the mean of the samples' log values.

        Raises
        ------
        InvalidInput
            If shares do not fit, or the criterion is robust already.
        """
        shares = checked_shares(self.shares, samples, f"criterion {self.name}")
        return replace(averaged(_of_one(self.criterion, names, self.name), shares), name=self.name)


@dataclass(frozen=True, eq=False)
class MaximinCriterion:
    """The worst of a criterion's values, or efficiencies, over samples of theta.

    Attributes
    ----------
    criterion : str or Criterion
        Criterion of each sample.
    references : sequence of float or None
        log value, see `Objective.log_value`, of the best design of each sample; the values
        themselves are compared if None. `robust_design` finds and uses them.
    """

    criterion: str | Criterion = "D"
    references: Sequence[float] | None = None

    @property
    def name(self) -> str:
        """What reports call it."""
        return f"maximin {_name(self.criterion)}"

    def objective(self, names: Sequence[str], samples: int = 1) -> Objective:
        """Return the least of the samples' log values.

        Raises
        ------
        InvalidInput
            If references do not fit, or the criterion is robust already.
        """
        terms = _of_one(self.criterion, names, self.name).groups[0]
        groups = tuple(
            tuple(Term(term.mean, term.share, k) for term in terms) for k in range(samples)
        )
        if self.references is None:
            return Objective(self.name, groups)
        references = real_numbers(self.references, f"criterion {self.name}: references")
        if references.shape != (samples,) or not np.isfinite(references).all():
            raise InvalidInput(
                f"criterion {self.name}: references {references}; {samples} numbers are needed"
            )
        return Objective(self.name, groups, tuple(references.tolist()))


def _of_one(criterion: str | Criterion, names: Sequence[str], name: str) -> Objective:
    """Return a criterion of one sample."""
    if isinstance(criterion, AverageCriterion | MaximinCriterion):
        raise InvalidInput(f"criterion {name}: {criterion.name} is robust already")
    one = objective_of(criterion, names)
    if len(one.groups) > 1:
        raise InvalidInput(
            f"criterion {name}: {one.name} is the least of several values, which holds at every "
            "sample as it is"
        )
    return one


def robust_objective(
    criterion: str | Criterion,
    names: Sequence[str],
    samples: int,
    kind: str,
    best: Callable[[Objective], float],
) -> Objective:
    """Return the objective of a criterion over samples of theta, on average or at worst.

    Parameters
    ----------
    criterion : str or Criterion
        Criterion of each sample.
    names : sequence of str
        Names of the p parameters.
    samples : int
        Number of samples.
    kind : str
        "average", as of `objective_of`, or "maximin", the least efficiency of all.
    best : callable
        The largest log value of an objective of one sample, against which "maximin" compares.

    Raises
    ------
    InvalidInput
        If the kind is unknown or the criterion does not fit.
    """
    check_word("kind", kind, KINDS)
    if kind == "average" or samples == 1:
        return objective_of(criterion, names, samples)
    worst = MaximinCriterion(criterion).objective(names, samples)
    values = [best(Objective(worst.name, (group,), one_sample=True)) for group in worst.groups]
    return MaximinCriterion(criterion, values).objective(names, samples)


def _name(criterion: str | Criterion) -> str:
    return criterion if isinstance(criterion, str) else criterion.name
