"""The best whole plans, and the proof that they are: branch and bound over repetitions.

Every node limits how often each candidate is used. Its relaxed optimum bounds all plans in it, and
the same tangent bounds what an experiment in each candidate loses: candidates that would bring a
plan below the best ones so far are ruled out before branching. Few of the whole set remain.
"""

from dataclasses import dataclass

import numpy as np

from oed.criteria.criteria import Criterion
from oed.design.constraints import Constraints
from oed.design.design import Design
from oed.exact.branch_and_bound import BranchAndBound
from oed.exact.exact_design import ExactDesign, as_exact_design, improve_by_exchange, relax
from oed.exact.exchange import ExactProblem
from oed.information_sets.candidates import Candidates
from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.errors import InvalidInput
from robotmodels.common.printing import ReprHtml
from robotmodels.common.progress import Progress


@dataclass(frozen=True, eq=False)
class BestPlans(ReprHtml):
    """The best different plans.

    Attributes
    ----------
    plans : tuple of ExactDesign
        The best first, each with the efficiency certified by the search.
    proven : bool
        Whether no other plan is better than the last of them.
    efficiency : float
        Efficiency of the first against every plan of whole experiments, at least; 1 if proven.
    considered : int
        Candidates that the first bound does not exclude.
    nodes : int
        Relaxed problems solved.
    """

    plans: tuple[ExactDesign, ...]
    proven: bool
    efficiency: float
    considered: int
    nodes: int

    def __str__(self) -> str:
        proof = "proven" if self.proven else f"not proven, efficiency >= {self.efficiency:.4f}"
        lines = [f"{len(self.plans)} best plans, {proof}, {self.nodes} relaxed problems"]
        return "\n  ".join([*lines, *map(str, self.plans)])


def best_plans(
    info: Candidates,
    n_experiments: int | None = None,
    plans: int = 1,
    design: Design | None = None,
    *,
    criterion: str | Criterion | None = None,
    constraints: Constraints | None = None,
    prior: Array | None = None,
    max_nodes: int = 500,
    progress: Progress | None = None,
) -> BestPlans:
    """Return the best different plans of whole experiments.

    Of plans whose values differ by less than one part in ten million any may be returned.

    Parameters
    ----------
    info : Candidates
        As in `exact_design`.
    n_experiments : int, optional
        As in `exact_design`.
    design : Design, optional
        As in `exact_design`.
    criterion : str or Criterion, optional
        As in `exact_design`.
    constraints : Constraints, optional
        As in `exact_design`.
    prior : ndarray, optional
        As in `exact_design`.
    plans : int
        How many.
    max_nodes : int
        Relaxed problems to solve at most; if that is not enough the answer says so.
    progress : Progress, optional
        Called with the number of them solved and `max_nodes`.

    Raises
    ------
    InvalidInput
        If `plans` is not positive, or as `exact_design`.
    NotIdentifiable
        As `exact_design`.
    """
    if plans < 1:
        raise InvalidInput(f"plans: {plans!r}; at least one is needed")
    problem, derivatives, weights, bound = relax(
        info, n_experiments, design, criterion=criterion, constraints=constraints, prior=prior
    )
    first = improve_by_exchange(problem, derivatives, weights)
    as_exact_design(problem, first, bound, per_experiment=True)  # refuses too few experiments
    search = BranchAndBound(problem, plans, max_nodes, progress)
    search.offer(first)
    for repetitions in _neighbours(problem, first):
        search.offer(repetitions)
    best_bound = min(bound, search.run())
    ranked = sorted(search.plans.values(), key=lambda pair: -pair[0])
    result = [
        as_exact_design(problem, counts, best_bound, per_experiment=constraints is None)
        for _, counts in ranked
    ]
    proven = search.complete and len(result) == plans
    return BestPlans(
        plans=tuple(result),
        proven=proven or (search.complete and search.exhausted),
        efficiency=1.0 if search.complete else result[0].efficiency,
        considered=search.considered,
        nodes=search.nodes,
    )


def _neighbours(problem: ExactProblem, counts: IntArray) -> list[IntArray]:
    """Return plans one exchange away, into the candidates of the largest derivatives."""
    information = problem.information(counts)
    objective = problem.objective
    gradient = objective.log_gradient(information)
    derivatives = problem.candidates.directional_derivatives(gradient)
    size = min(64, len(derivatives))
    plans = []
    for entering in np.argpartition(-derivatives, size - 1)[:size]:
        for leaving in np.flatnonzero(counts > problem.least):
            if leaving != entering:
                other = counts.copy()
                other[leaving] -= 1
                other[entering] += 1
                plans.append(other)
    return plans
