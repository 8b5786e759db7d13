"""What no choice of sensors within a budget can exceed.

In the relaxation each experiment may use its own sensors, and only their mean cost keeps to the
budget. Its columns are positions with the sensors used there; at multipliers y of the mean cost the
dearest column of position q has the price tr(W H_q0) + sum_s max(0, tr(W H_qs) - y c_s), so that
the few columns that matter are found one round after the other.
"""

from dataclasses import dataclass

import numpy as np

from oed.criteria.objective import Objective
from oed.design.constraints import Constraints
from oed.design.design import Design
from oed.design.optimal_design import optimal_design
from oed.design.polytope import Polytope
from oed.design.solvers import fast_solver
from oed.information_sets.information_set import InformationSet
from robotmodels.common.arrays import Array, BoolArray, IntArray
from robotmodels.common.errors import SolverFailed

_ROUNDS = 60
_TOLERANCE = 1e-4  # of the bound, in the logarithm of the efficiency


@dataclass(frozen=True, eq=False)
class Shop:
    """What can be bought, and what is wanted of it.

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
    wanted : Objective
        What is maximised.
    prior : ndarray or None
        (p, p) or None.
    """

    base: InformationSet
    added: Array
    costs: Array
    budget: float
    wanted: Objective
    prior: Array | None = None

    def matrices(self, positions: IntArray, used: BoolArray) -> Array:
        """Return the information of columns: positions (n,) with the sensors used there, (n, S)."""
        more = np.einsum("is,siab->iab", used.astype(float), self.added[:, positions])
        return np.asarray(self.base.matrices[positions] + more)

    def design(self, used: BoolArray, tolerance: float) -> Design:
        """Return the best design with the same sensors (S,) everywhere."""
        places = np.arange(len(self.base))
        matrices = self.matrices(places, np.broadcast_to(used, (len(places), len(used))))
        info = InformationSet(self.base.positions, matrices, self.base.names)
        return self.solved(info, None, tolerance)

    def solved(
        self, info: InformationSet, limits: Constraints | Polytope | None, tolerance: float
    ) -> Design:
        """Return a design for what is wanted."""
        solver = fast_solver(self.wanted)
        return optimal_design(info, self.wanted, limits, self.prior, tolerance, solver=solver)


def relaxed_choice(shop: Shop, reached: float) -> tuple[float, Array]:
    """Return an upper bound on the log value of every choice, and the sensors' shares of use.

    Parameters
    ----------
    shop : Shop
        What can be bought.
    reached : float
        log value of the best choice known; the bound is no less.
    """
    positions = np.repeat(np.arange(len(shop.base)), 2)
    used = np.zeros((len(positions), len(shop.costs)), dtype=bool)
    used[1::2] = True
    bound, usage = np.inf, np.zeros(len(shop.costs))
    for _ in range(_ROUNDS):
        try:
            design = _over(shop, positions, used)
        except SolverFailed:
            break
        limit, prices, worth = _priced(shop, design)
        bound = min(bound, limit)
        usage = np.asarray(design.weights @ used)
        if bound <= shop.wanted.log_value(design.information) + _TOLERANCE:
            break
        dearest = np.argsort(-prices)[: 2 * len(shop.base.names)]
        kept = design.support
        positions = np.concatenate([positions[kept], dearest])
        used = np.concatenate([used[kept], worth[dearest] > 0])
    return max(bound, reached), usage


def _over(shop: Shop, positions: IntArray, used: BoolArray) -> Design:
    """Return the best shares of columns whose mean cost is within the budget."""
    places = positions[:, None].astype(float)
    info = InformationSet(places, shop.matrices(positions, used), shop.base.names)
    n = len(positions)
    limits = Polytope(
        np.stack([np.ones(n), used @ shop.costs]),
        np.array([1.0, shop.budget]),
        np.zeros(n),
        np.full(n, np.inf),
        ("experiments", "cost"),
    )
    return shop.solved(info, limits, 0.1 * _TOLERANCE)


def _priced(shop: Shop, design: Design) -> tuple[float, Array, Array]:
    """Return the bound at a design's prices, each position's (Q,), and what sensors add (Q, S)."""
    weight = shop.wanted.price(design.witness, design.information.shape)
    y = max(design.multipliers["cost"], 0.0)
    worth = np.tensordot(shop.added, weight).T - y * shop.costs
    prices = np.tensordot(shop.base.matrices, weight) + np.maximum(worth, 0.0).sum(axis=1)
    known = 0.0 if shop.prior is None else float(np.vdot(weight, shop.prior))
    most = known + float(prices.max()) + y * shop.budget
    return float(np.log(most) - shop.wanted.log_polar(design.witness)), prices, worth
