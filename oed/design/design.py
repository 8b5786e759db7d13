"""A relaxed design: weights of the candidates, with their certificate."""

from collections.abc import Mapping
from dataclasses import dataclass

from oed.design.certificate import efficiency_bound
from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.printing import ReprHtml

SHOWN = 8
"""Candidates that a design names when it is printed."""


@dataclass(frozen=True, eq=False)
class Design(ReprHtml):
    """Weights of the candidates, with their certificate.

    Attributes
    ----------
    weights : ndarray, (Q,)
        Shares that sum to one, or experiments where constraints say how many; of equal candidates
        one carries the weight.
    value : float
        The criterion, see `Objective.value` (for D: log det).
    gap : float
        Certified over all candidates, see `certificate`.
    support : ndarray of int
        Indices of the candidates with a positive weight.
    information : ndarray, (p, p), or (K, p, p)
        Information, for each sample: the prior and sum_i w_i H_i.
    criterion : str
        Name of the criterion that was optimised.
    names : tuple of str
        Names of the parameters.
    gaps : ndarray, (rounds,)
        Certified gap of each active set's answer, infinite where its solver gave none, or of very
        many candidates each pool's; `gap` is that of the final weights.
    solver : str
        Every method that took part, in the order used.
    witness : tuple of ndarray
        W_j of each of the criterion's terms, with which the gap was computed; the derivative at the
        weights where that is unique.
    sensitivity : ndarray, (Q,)
        What a unit of each weight adds to the logarithm of the efficiency; over a position's cost
        it is nowhere above that of the support.
    multipliers : mapping of str to float
        What a unit of each constraint's bound adds to it, by name.
    """

    weights: Array
    value: float
    gap: float
    support: IntArray
    information: Array
    criterion: str
    names: tuple[str, ...]
    gaps: Array
    solver: str
    witness: tuple[Array, ...]
    sensitivity: Array
    multipliers: Mapping[str, float]

    @property
    def rounds(self) -> int:
        """Active sets that were solved, or pools of very many candidates."""
        return len(self.gaps)

    @property
    def efficiency(self) -> float:
        """Certified lower bound on the efficiency against the true optimum."""
        return efficiency_bound(self.gap)

    def __str__(self) -> str:
        shares = ", ".join(f"{self.weights[i]:.3g} in {i}" for i in self.support[:SHOWN])
        more = len(self.support) - SHOWN
        return (
            f"{self.criterion}-optimal design: {len(self.support)} of {len(self.weights)} "
            f"candidates, certified gap {self.gap:.1e}\n"
            f"  weights {shares}{f' and {more} more' if more > 0 else ''}"
        )
