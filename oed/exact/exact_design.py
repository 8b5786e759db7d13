"""The exact design: how many whole experiments go to each candidate position.

Rounding of the relaxed weights gives a start, exchanges over all candidates improve it, and the
relaxed optimum bounds how much better any other plan could be.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from oed.criteria.criteria import CRITERIA, Criterion, objective_of
from oed.design.certificate import certify, checked_weights, efficiency_bound, not_negative
from oed.design.constraints import Constraints
from oed.design.design import SHOWN, Design
from oed.design.optimal_design import checked_prior, optimal_design
from oed.design.polytope import Polytope
from oed.design.problem import DesignProblem
from oed.exact.exchange import ExactProblem, Pool, complete_greedily, exchange
from oed.exact.minimum_experiments import first_sample, too_few
from oed.information_sets.candidates import Candidates, check_candidates
from oed.information_sets.null_space import open_combinations, unidentifiable
from robotmodels.common.arrays import Array, IntArray, check_count, read_only
from robotmodels.common.errors import InvalidInput, NotIdentifiable
from robotmodels.common.printing import ReprHtml

_POOL = 256  # candidates that exchanges begin with, at least
_EXPERIMENTS = 15  # where nothing says how many


@dataclass(frozen=True, eq=False)
class ExactDesign(ReprHtml):
    """Whole experiments per candidate, with a certified efficiency.

    Attributes
    ----------
    repetitions : ndarray of int, (Q,)
        Experiments in each candidate position.
    efficiency : float
        Lower bound on the efficiency against every plan within the same limits, whole or not, taken
        from the relaxed design and its gap; for D it is (det M / det M_best)^(1/p).
    value : float
        Value of the criterion, comparable with `Design.value`: of the information per experiment
        (for D: log det), or of all of it where constraints say how many experiments.
    support : ndarray of int
        Indices of the candidates used.
    information : ndarray, (p, p), or (K, p, p)
        Information, for each sample, of the whole plan: the prior and sum_i n_i H_i.
    names : tuple of str
        p parameter names.
    criterion : str
        Name of what was maximised.
    """

    repetitions: IntArray
    efficiency: float
    value: float
    support: IntArray
    information: Array
    names: tuple[str, ...]
    criterion: str = "D"

    @property
    def n_experiments(self) -> int:
        """Number of experiments of the plan."""
        return int(self.repetitions.sum())

    def __str__(self) -> str:
        counts = ", ".join(f"{self.repetitions[i]} in {i}" for i in self.support[:SHOWN])
        more = len(self.support) - SHOWN
        return (
            f"{self.criterion}: {self.n_experiments} experiments in {len(self.support)} of "
            f"{len(self.repetitions)} candidates, efficiency >= {self.efficiency:.4f}: {counts}"
            f"{f' and {more} more' if more > 0 else ''}"
        )


def exact_design(
    info: Candidates,
    n_experiments: int | None = None,
    design: Design | None = None,
    *,
    criterion: str | Criterion | None = None,
    constraints: Constraints | None = None,
    prior: Array | None = None,
) -> ExactDesign:
    """Return an efficient plan of whole experiments.

    Parameters
    ----------
    info : Candidates
        Information of each candidate, in memory or in a store.
    n_experiments : int, optional
        Number of experiments, at most so many where the constraints limit time; by default what the
        constraints say, or 15 where they name neither a number nor a time.
    design : Design, optional
        Relaxed design of the same problem; computed if None. Its gap is certified anew.
    criterion : str or Criterion, optional
        "D", "A", "E" or an object of `oed.criteria.criteria`; by default the design's, or D.
    constraints : Constraints, optional
        Limits on the experiments.
    prior : ndarray, (p, p) or (K, p, p), optional
        Information there is before these experiments.

    Raises
    ------
    InvalidInput
        If `n_experiments` is not a positive whole number or contradicts the constraints, `design`
        does not fit, or no whole plan satisfies the constraints.
    NotIdentifiable
        Naming the parameters, if so few experiments leave a direction open (and how many are
        needed), or all candidates together do.
    """
    problem, derivatives, weights, bound = relax(
        info, n_experiments, design, criterion=criterion, constraints=constraints, prior=prior
    )
    counts = improve_by_exchange(problem, derivatives, weights)
    return as_exact_design(problem, counts, bound, per_experiment=constraints is None)


def improve_by_exchange(problem: ExactProblem, derivatives: Array, weights: Array) -> IntArray:
    """Return the best plan (Q,) that exchanges lead to from the relaxed weights.

    Raises
    ------
    InvalidInput
        If the search reaches no whole plan that satisfies the constraints.
    """
    pool = Pool(problem, _promising(derivatives, weights))
    plans = [exchange(pool, start) for start in _starts(problem, pool, weights)]
    if not plans:
        raise InvalidInput(
            f"constraints: no plan of whole experiments was found that satisfies "
            f"{', '.join(problem.allowed.names)} and the limits of each position"
        )
    return max(plans, key=problem.value)


def relax(
    info: Candidates,
    n_experiments: int | None,
    design: Design | None = None,
    *,
    criterion: str | Criterion | None = None,
    constraints: Constraints | None = None,
    prior: Array | None = None,
) -> tuple[ExactProblem, Array, Array, float]:
    """Return the exact problem, derivatives and weights (Q,) of its relaxation, and a log bound.

    No allowed weights, whole or not, have a log value above the bound. Arguments and errors are
    those of `exact_design`.
    """
    check_candidates(info)
    objective = objective_of(_criterion(criterion, design), info.names, info.samples)
    allowed = _allowed(n_experiments, constraints, len(info))
    prior_information = checked_prior(prior, info)
    if design is None:
        design = optimal_design(info, objective, allowed, prior_information)
        weights = design.weights
    elif constraints is None:
        weights = float(allowed.bounds[0]) * checked_weights(design.weights, len(info))
    else:
        weights = not_negative(design.weights, len(info))
    reference = (
        info.combined(weights)
        if prior_information is None
        else info.combined(weights) + prior_information
    )
    rows = np.array(list(design.multipliers.values()))
    certificate = certify(
        DesignProblem(info, objective, allowed, prior_information),
        weights,
        design.witness if len(design.witness) == len(objective.terms) else None,
        rows if rows.shape == allowed.bounds.shape else None,
    )
    if not np.isfinite(certificate.gap):
        names = unidentifiable(first_sample(reference), info.names)
        raise NotIdentifiable(names or info.names, "the relaxed design is singular")
    bound = objective.log_value(reference) - float(np.log(efficiency_bound(certificate.gap)))
    problem = ExactProblem(info, objective, allowed, prior_information, reference=reference)
    return problem, certificate.sensitivity, weights, bound


def as_exact_design(
    problem: ExactProblem, counts: IntArray, log_bound: float, per_experiment: bool
) -> ExactDesign:
    """Return a plan (Q,) as an `ExactDesign` with its certified efficiency.

    Raises
    ------
    NotIdentifiable
        Naming the parameters that the plan leaves open.
    """
    information = problem.information(counts)
    log_value = problem.objective.log_value(information)
    if not log_value > -np.inf:
        names = problem.candidates.names
        first = first_sample(information)
        raise NotIdentifiable(
            unidentifiable(first, names) or names,
            too_few(problem, int(counts.sum())),
            open_combinations(first, names),
        )
    share = information / counts.sum() if per_experiment else information
    return ExactDesign(
        repetitions=read_only(counts),
        efficiency=min(1.0, float(np.exp(log_value - log_bound))),
        value=problem.objective.value(share),
        support=read_only(np.flatnonzero(counts)),
        information=read_only(information),
        names=problem.candidates.names,
        criterion=problem.objective.name,
    )


def _criterion(criterion: str | Criterion | None, design: Design | None) -> str | Criterion:
    if criterion is not None:
        return criterion
    if design is None or design.criterion in CRITERIA:
        return "D" if design is None else design.criterion
    raise InvalidInput(
        f"design: it is for criterion {design.criterion}; give the same one as `criterion`"
    )


def _allowed(
    n_experiments: int | None, constraints: Constraints | None, n_candidates: int
) -> Polytope:
    if n_experiments is not None:
        check_count(n_experiments, "n_experiments")
    number = float(_EXPERIMENTS if n_experiments is None else n_experiments)
    if constraints is None:
        return replace(Polytope.shares(n_candidates), bounds=np.array([number]))
    if constraints.experiments is None:
        if n_experiments is not None or constraints.time is None:
            constraints = replace(constraints, experiments=number)
    elif n_experiments not in (None, constraints.experiments):
        raise InvalidInput(
            f"n_experiments: {n_experiments} contradicts the constraints, which say "
            f"experiments={constraints.experiments:g}; leave out one of them"
        )
    return constraints.polytope(n_candidates)


def _promising(derivatives: Array, weights: Array) -> IntArray:
    """Return the relaxed design's support and the candidates of the largest derivatives."""
    size = min(len(derivatives), max(_POOL, 16 * int(np.count_nonzero(weights))))
    best = np.argpartition(-derivatives, size - 1)[:size]
    return np.union1d(best, np.flatnonzero(weights))


def _starts(problem: ExactProblem, pool: Pool, weights: Array) -> Iterator[IntArray]:
    """Yield different allowed plans: weights rounded in two ways, or additions one by one."""
    floored = np.floor(weights + 1e-9).astype(np.int64)
    starts = [complete_greedily(pool, np.maximum(floored, problem.least))]
    total = weights.sum()
    if round(total) >= np.count_nonzero(weights) and abs(total - round(total)) < 1e-6:
        rounded = efficient_rounding(weights / total, round(total))
        if (rounded >= problem.least).all() and not np.array_equal(rounded, starts[0]):
            starts.append(rounded)
    else:
        starts.append(complete_greedily(pool, problem.least))
    yield from (plan for plan in starts if plan.any() and problem.feasible(plan))


def efficient_rounding(weights: Array, n_experiments: int) -> IntArray:
    """Return whole numbers (Q,) near `weights` times `n_experiments`.

    No other rounding of the weights alone guarantees more (Pukelsheim and Rieder 1992); it needs
    at least one experiment per supported candidate.

    Raises
    ------
    InvalidInput
        If there are fewer experiments than supported candidates.
    """
    support = np.flatnonzero(weights)
    if n_experiments < len(support):
        raise InvalidInput(
            f"n_experiments: {n_experiments} cannot be shared by {len(support)} positions; "
            f"efficient rounding needs at least {len(support)}"
        )
    shares = weights[support]
    counts = np.ceil((n_experiments - len(support) / 2) * shares)
    while counts.sum() < n_experiments:
        counts[np.argmin(counts / shares)] += 1
    while counts.sum() > n_experiments:
        counts[np.argmax((counts - 1) / shares)] -= 1
    rounded = np.zeros(len(weights), dtype=np.int64)
    rounded[support] = counts
    return rounded
