"""The convex problem over a few candidates, in coordinates where information is of order one."""

from dataclasses import dataclass

from oed.design.objective import Objective
from robotmodels.arrays import Array


@dataclass(frozen=True, eq=False)
class InnerProblem:
    """Maximise objective(base + sum_i w_i H_i) over w >= 0, rows w <= bounds.

    Attributes
    ----------
    objective : its samples are the places of `base` and `matrices`.
    base : for each sample, (p, p), information there is already.
    matrices : for each sample, (n, p, p), of the candidates.
    rows, bounds : (m, n), (m,).
    """

    objective: Objective
    base: tuple[Array, ...]
    matrices: tuple[Array, ...]
    rows: Array
    bounds: Array

    def information(self, weights: Array) -> tuple[Array, ...]:
        """Return each sample's information, (p, p)."""
        pairs = zip(self.base, self.matrices, strict=True)
        return tuple(
            base + (weights @ H.reshape(len(H), -1)).reshape(base.shape) for base, H in pairs
        )


@dataclass(frozen=True, eq=False)
class InnerAnswer:
    """What a solver found.

    Attributes
    ----------
    weights : (n,).
    row_multipliers : (m,) none negative, what a unit of each bound would add to the log value.
    witness : one (p, p) for each term, the derivative of the log value, or its equal in the dual.
    solver : that gave the answer.
    """

    weights: Array
    row_multipliers: Array
    witness: tuple[Array, ...]
    solver: str
