"""Designs of further experiments, based on the information of those already made."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from oed.criteria.criteria import Criterion
from oed.design.constraints import Constraints
from oed.design.optimal_design import checked_prior
from oed.exact.exact_design import ExactDesign, exact_design
from oed.exact.plan_score import standard_deviations
from oed.information_sets.candidates import Candidates, check_candidates
from robotmodels.common.arrays import Array, IntArray, check_above_zero, read_only
from robotmodels.common.deprecation import renamed_keywords
from robotmodels.common.errors import InvalidInput, NotIdentifiable, check_word
from robotmodels.common.printing import ReprHtml
from robotmodels.common.progress import Progress, tell


@dataclass(frozen=True, eq=False)
class NextExperiments(ReprHtml):
    """The best experiments to add, with standard deviations before and after.

    Attributes
    ----------
    plan : ExactDesign
        The experiments; its information includes what there was.
    before : ndarray, (p,)
        Standard deviations of what there was; infinite for what it leaves open.
    after : ndarray, (p,)
        Predicted with the plan.
    """

    plan: ExactDesign
    before: Array
    after: Array

    def __str__(self) -> str:
        return (
            f"{self.plan}\n  largest standard deviation {self.before.max():.3g} before, "
            f"{self.after.max():.3g} after"
        )


@dataclass(frozen=True, eq=False)
class ExperimentCurve(ReprHtml):
    """Plans of growing numbers of experiments, with their standard deviations.

    Attributes
    ----------
    counts : ndarray of int, (C,)
        Numbers of experiments; those that cannot identify every parameter are skipped.
    std : ndarray, (C, p)
        Predicted standard deviations, relative ones where parameters are ln theta.
    efficiency : ndarray, (C,)
        Certified, of each plan against all of as many experiments.
    plans : tuple of ExactDesign
        One for each number.
    names : tuple of str
        p parameter names.
    """

    counts: IntArray
    std: Array
    efficiency: Array
    plans: tuple[ExactDesign, ...]
    names: tuple[str, ...]

    def __str__(self) -> str:
        rows = zip(self.counts, self.std.max(axis=1), self.efficiency, strict=True)
        return "\n".join(
            f"{n} experiments: largest standard deviation {std:.3g}, efficiency >= {efficiency:.4f}"
            for n, std, efficiency in rows
        )


@dataclass(frozen=True, eq=False)
class RequiredExperiments(ReprHtml):
    """The number of experiments that reaches a required accuracy.

    Attributes
    ----------
    n_experiments : int
        N experiments to add to what there is; 0 if that is enough.
    plan : ExactDesign or None
        Plan that reaches it, or None for 0.
    std : ndarray, (p,)
        Predicted.
    critical : str
        The parameter that asks for the most.
    """

    n_experiments: int
    plan: ExactDesign | None
    std: Array
    critical: str

    def __str__(self) -> str:
        return f"{self.n_experiments} experiments are needed, the most for {self.critical}"


@renamed_keywords("0.2", known="prior")
def next_experiments(
    info: Candidates,
    n_experiments: int,
    prior: Array | None = None,
    *,
    criterion: str | Criterion = "D",
    constraints: Constraints | None = None,
) -> NextExperiments:
    """Return the experiments that add most to prior information.

    Parameters
    ----------
    info : Candidates
        Info of each candidate, computed at the parameters fitted so far.
    n_experiments : int
        How many to add.
    prior : ndarray, (p, p), optional
        Information of all that was measured: `measured_information`, or the inverse of the fit's
        covariance of ln theta.
    criterion : str or Criterion
        As in `exact_design`.
    constraints : Constraints, optional
        As in `exact_design`.

    Raises
    ------
    InvalidInput, NotIdentifiable
        As `exact_design`.
    """
    prior = checked_prior(prior, info)
    plan = exact_design(
        info, n_experiments, criterion=criterion, constraints=constraints, prior=prior
    )
    before = np.full(len(info.names), np.inf) if prior is None else standard_deviations(prior)
    return NextExperiments(
        plan, read_only(before), read_only(standard_deviations(plan.information))
    )


def measured_information(info: Candidates, repetitions: Sequence[int] | IntArray) -> Array:
    """Return the information, (p, p), of experiments already made: $sum_i n_i H_i$.

    Parameters
    ----------
    info : Candidates
        Info of each position measured, by `information` at the fitted parameters.
    repetitions : sequence of int or ndarray of int, (Q,)
        Experiments in each.

    Raises
    ------
    InvalidInput
        If there are not as many numbers as positions, or one is negative.
    """
    check_candidates(info)
    counts = np.asarray(repetitions, dtype=float)
    if counts.shape != (len(info),) or not (counts >= 0).all():
        raise InvalidInput(
            f"repetitions: shape {counts.shape}; {len(info)} numbers >= 0, one for each position, "
            "are needed"
        )
    return info.combined(counts)


@renamed_keywords("0.2", known="prior")
def experiment_curve(
    info: Candidates,
    counts: Sequence[int],
    prior: Array | None = None,
    *,
    criterion: str | Criterion = "D",
    constraints: Constraints | None = None,
    progress: Progress | None = None,
) -> ExperimentCurve:
    """Return the best plan of each number of experiments, with predicted standard deviations.

    Parameters
    ----------
    info : Candidates
        As in `next_experiments`.
    prior : ndarray, optional
        As in `next_experiments`.
    criterion : str or Criterion
        As in `next_experiments`.
    constraints : Constraints, optional
        As in `next_experiments`.
    counts : sequence of int
        Numbers of experiments.
    progress : Progress, optional
        Called with the number of plans done and their total.

    Raises
    ------
    InvalidInput
        If `counts` is empty.
    NotIdentifiable
        Naming the parameters, if even the largest number is too small.
    """
    numbers = sorted({int(n) for n in counts})
    if not numbers:
        raise InvalidInput("counts: none given; at least one number of experiments is needed")
    feasible, plans = [], []
    for i, n in enumerate(numbers):
        try:
            following = next_experiments(
                info, n, prior, criterion=criterion, constraints=constraints
            )
        except NotIdentifiable:
            if n == numbers[-1]:
                raise
        else:
            feasible.append(n)
            plans.append(following.plan)
        tell(progress, i + 1, len(numbers))
    return ExperimentCurve(
        counts=read_only(np.array(feasible)),
        std=read_only(np.array([standard_deviations(plan.information) for plan in plans])),
        efficiency=read_only(np.array([plan.efficiency for plan in plans])),
        plans=tuple(plans),
        names=info.names,
    )


@renamed_keywords("0.2", known="prior")
def experiments_needed(
    info: Candidates,
    std: float,
    prior: Array | None = None,
    *,
    parameters: Sequence[str] | None = None,
    criterion: str | Criterion = "D",
    constraints: Constraints | None = None,
    most: int = 1000,
) -> RequiredExperiments:
    """Return how many experiments bring every standard deviation to at most `std`.

    Of plans that `exact_design` finds for the criterion; one for the worst parameter, such as E
    or A, may do with fewer. Numbers are doubled, then halved in between.

    Parameters
    ----------
    info : Candidates
        As in `next_experiments`.
    prior : ndarray, optional
        As in `next_experiments`.
    criterion : str or Criterion
        As in `next_experiments`.
    constraints : Constraints, optional
        As in `next_experiments`.
    std : float
        Required, relative where parameters are ln theta: 0.01 is one percent.
    parameters : sequence of str, optional
        Names of those that count; all by default.
    most : int
        Experiments to consider.

    Raises
    ------
    InvalidInput
        If `std` is not positive, a name is unknown, or `most` experiments are too few (saying what
        they reach).
    """
    check_above_zero(std, "std (0.01 for one percent)")
    check_candidates(info)
    indices = _parameter_indices(info.names, parameters)
    attempt = partial(_attempt, info, prior=prior, criterion=criterion, constraints=constraints)
    outcomes: dict[int, tuple[ExactDesign | None, Array]] = {}

    def enough(n: int) -> bool:
        outcomes[n] = attempt(n)
        return bool(outcomes[n][1][indices].max() <= std)

    low, high = -1, 0
    while not enough(high):
        if high >= most:
            worst = indices[int(np.argmax(outcomes[high][1][indices]))]
            raise InvalidInput(
                f"std: {std:g} is out of reach of {most} experiments: {info.names[worst]!r} comes "
                f"to {outcomes[high][1][worst]:.3g}; allow more, or free fewer parameters"
            )
        low, high = high, min(max(1, 2 * high), most)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle) else (middle, high)
    plan, values = outcomes[high]
    worst = indices[int(np.argmax(values[indices]))]
    return RequiredExperiments(high, plan, read_only(values), info.names[worst])


def _attempt(
    info: Candidates,
    n_experiments: int,
    *,
    prior: Array | None,
    criterion: str | Criterion,
    constraints: Constraints | None,
) -> tuple[ExactDesign | None, Array]:
    """Return the plan of so many more experiments, and the standard deviations (p,) with it."""
    nothing = np.full(len(info.names), np.inf)
    if n_experiments == 0:
        prior = checked_prior(prior, info)
        return None, nothing if prior is None else standard_deviations(prior)
    try:
        following = next_experiments(
            info, n_experiments, prior, criterion=criterion, constraints=constraints
        )
    except NotIdentifiable:
        return None, nothing
    return following.plan, following.after


def _parameter_indices(names: tuple[str, ...], parameters: Sequence[str] | None) -> list[int]:
    if parameters is None:
        return list(range(len(names)))
    for name in parameters:
        check_word("parameters:", name, names)
    if not parameters:
        raise InvalidInput("parameters: none given; at least one is needed")
    return [names.index(name) for name in parameters]
