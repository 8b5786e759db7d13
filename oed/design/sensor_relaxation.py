"""An upper bound on every choice of sensors within a budget.

In the relaxation each experiment may use other sensors, and only their mean cost keeps to the
budget. Its columns are positions with the sensors used there; at multipliers y of the mean cost the
best column of position q has the value tr(W H_q0) + sum_s max(0, tr(W H_qs) - y c_s), so that
the few columns that matter are generated one round after the other.
"""

from dataclasses import dataclass

import numpy as np

from oed.criteria.objective import Objective
from oed.design.constraints import Constraints
from oed.design.design import Design
from oed.design.optimal_design import optimal_design
from oed.design.polytope import Polytope
from oed.information_sets.information_set import InformationSet
from robotmodels.common.arrays import Array, BoolArray, IntArray
from robotmodels.common.errors import SolverFailed

_ROUNDS = 60
_TOLERANCE = 1e-4  # of the bound, in the logarithm of the efficiency


@dataclass(frozen=True, eq=False)
class SensorProblem:
    """Sensors to choose from within a budget, and the objective.

    Attributes
    ----------
    base : InformationSet
        Information of each candidate position without sensors.
    added : ndarray, (S, Q, p, p)
        What each sensor adds in each position.
    costs : ndarray, (S,)
        Costs of the sensors.
    budget : float
        Largest sum of costs.
    objective : Objective
        Function of the information that is maximised.
    prior : ndarray or None
        (p, p) or None.
    """

    base: InformationSet
    added: Array
    costs: Array
    budget: float
    objective: Objective
    prior: Array | None = None

    def matrices(self, positions: IntArray, used: BoolArray) -> Array:
        """Return the information of columns: positions (n,) with the sensors used there, (n, S)."""
        more = np.einsum("is,siab->iab", used.astype(float), self.added[:, positions])
        return np.asarray(self.base.matrices[positions] + more)

    def design(self, used: BoolArray, tolerance: float) -> Design:
        """Return the best design with the same sensors (S,) everywhere."""
        every = np.arange(len(self.base))
        matrices = self.matrices(every, np.broadcast_to(used, (len(every), len(used))))
        info = InformationSet(self.base.positions, matrices, self.base.names)
        return self.optimal(info, None, tolerance)

    def optimal(
        self, info: InformationSet, limits: Constraints | Polytope | None, tolerance: float
    ) -> Design:
        """Return the optimal design over columns `info`."""
        return optimal_design(info, self.objective, limits, self.prior, tolerance)


def relaxed_choice(problem: SensorProblem, reached: float) -> tuple[float, Array]:
    """Return an upper bound on the log value of every choice, and the sensors' shares of use.

    Parameters
    ----------
    problem : SensorProblem
        Sensors and budget.
    reached : float
        Log value of the best choice so far; the bound is no less.
    """
    positions = np.repeat(np.arange(len(problem.base)), 2)
    used = np.zeros((len(positions), len(problem.costs)), dtype=bool)
    used[1::2] = True
    bound, usage = np.inf, np.zeros(len(problem.costs))
    for _ in range(_ROUNDS):
        try:
            design = _over(problem, positions, used)
        except SolverFailed:
            break
        limit, derivatives, reduced = _bounded(problem, design)
        bound = min(bound, limit)
        usage = np.asarray(design.weights @ used)
        if bound <= problem.objective.log_value(design.information) + _TOLERANCE:
            break
        best = np.argsort(-derivatives)[: 2 * len(problem.base.names)]
        support = design.support
        positions = np.concatenate([positions[support], best])
        used = np.concatenate([used[support], reduced[best] > 0])
    return max(bound, reached), usage


def _over(problem: SensorProblem, positions: IntArray, used: BoolArray) -> Design:
    """Return the best shares of columns whose mean cost is within the budget."""
    labels = positions[:, None].astype(float)
    info = InformationSet(labels, problem.matrices(positions, used), problem.base.names)
    n = len(positions)
    limits = Polytope(
        np.stack([np.ones(n), used @ problem.costs]),
        np.array([1.0, problem.budget]),
        np.zeros(n),
        np.full(n, np.inf),
        ("experiments", "cost"),
    )
    return problem.optimal(info, limits, 0.1 * _TOLERANCE)


def _bounded(problem: SensorProblem, design: Design) -> tuple[float, Array, Array]:
    """Return the bound, values of the best columns (Q,) and reduced ones of sensors (Q, S)."""
    weight = problem.objective.summed_by_sample(design.witness, design.information.shape)
    y = max(design.multipliers["cost"], 0.0)
    reduced = np.tensordot(problem.added, weight).T - y * problem.costs
    derivatives = np.tensordot(problem.base.matrices, weight) + np.maximum(reduced, 0.0).sum(axis=1)
    prior_value = 0.0 if problem.prior is None else float(np.vdot(weight, problem.prior))
    most = prior_value + float(derivatives.max()) + y * problem.budget
    return float(np.log(most) - problem.objective.log_polar(design.witness)), derivatives, reduced
