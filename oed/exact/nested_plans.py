"""The visits of a plan in the order of what they tell, and its accuracy as it grows."""

from dataclasses import dataclass

import numpy as np

from oed.design.design import Design
from oed.exact.plan_score import standard_deviations
from robotmodels.common.arrays import Array, IntArray

_RIDGE = 1e-12  # of a matrix with unit diagonal, so that parameters still open can be compared


@dataclass(frozen=True, eq=False)
class NestedPlans:
    """Plans of 1 to N visits, each with one visit more.

    Attributes
    ----------
    order : ndarray of int, (N,)
        Position of each visit, an index of those of the plan.
    std : ndarray, (N, p)
        Standard deviations of ln theta after each visit; infinite where a parameter is open.
    log_determinants : ndarray, (N,)
        ln det of the information.
    """

    order: IntArray
    std: Array
    log_determinants: Array

    @property
    def positions(self) -> IntArray:
        """Positions in the order of their first visit, the most informative first, (Q,)."""
        return np.array([*dict.fromkeys(self.order.tolist())], dtype=np.int64)

    def efficiency(self, design: Design, visit_share: float = 1.0) -> Array:
        """Return the certified D-efficiency of each against all of as many visits, (N,).

        That is (det M / det M_best)^(1/p) with the design's M and gap; not a number where a
        parameter is open.

        Parameters
        ----------
        design : Design
            The D-optimal relaxed design without limits.
        visit_share : float
            Part of a candidate's information that a visit has.
        """
        visits, p = np.arange(1, len(self.order) + 1), self.std.shape[1]
        _, best = np.linalg.slogdet(visit_share * design.information / design.weights.sum())
        efficiency = np.exp((self.log_determinants - best) / p) / visits * design.efficiency
        return np.asarray(np.where(np.isfinite(self.std).all(axis=1), efficiency, np.nan))


def nested_plans(information: Array, repetitions: IntArray) -> NestedPlans:
    """Return the plans in a plan: without the visit that tells least, and so on.

    Backward elimination by the determinant of the information.

    Parameters
    ----------
    information : ndarray, (Q, p, p)
        Information of one visit to each position.
    repetitions : ndarray of int, (Q,)
        Visits to each position.
    """
    counts = np.array(repetitions)
    size = np.sqrt(np.einsum("q,qii->i", counts, information))
    scaled = information / np.outer(size, size)
    ridge, order = _RIDGE * np.eye(len(size)), []
    while counts.any():
        total = np.einsum("q,qij->ij", counts, scaled)
        used = np.flatnonzero(counts)
        order.append(used[np.argmax(np.linalg.slogdet(total - scaled[used] + ridge)[1])])
        counts[order[-1]] -= 1
    visits = np.array(order[::-1], dtype=np.int64)
    growing = np.cumsum(information[visits], axis=0)
    std = np.array([standard_deviations(total) for total in growing])
    return NestedPlans(visits, std, np.linalg.slogdet(growing)[1])
