"""A design problem, the scaled problem over a few candidates that solvers see, and the solver.

A design takes three shapes: `DesignProblem` over all candidates (`ExactProblem` in whole numbers),
`ScaledProblem` with its `SolverAnswer`, and the `Design` with its certificate.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from oed.criteria.objective import Objective
from oed.design.polytope import Polytope
from oed.information_sets.candidates import Candidates
from robotmodels.common.arrays import Array, IntArray


@dataclass(frozen=True, eq=False)
class DesignProblem:
    """Maximise objective(prior + sum_i w_i H_i) over the allowed weights.

    Attributes
    ----------
    candidates : Candidates
        Information of the candidates.
    objective : Objective
        Function of the information that is maximised.
    allowed : Polytope
        Constraints on the weights.
    prior : ndarray or None
        M_0, of the shape of one candidate's information, or None.
    """

    candidates: Candidates
    objective: Objective
    allowed: Polytope
    prior: Array | None = None

    def information(self, weights: Array | IntArray) -> Array:
        """Return the prior and sum_i w_i H_i, (p, p) or (K, p, p)."""
        total = self.candidates.combined(np.asarray(weights, dtype=float))
        return total if self.prior is None else total + self.prior


@dataclass(frozen=True, eq=False)
class ScaledProblem:
    """Maximise objective(base + sum_i w_i H_i) over 0 <= w <= caps, rows w <= bounds.

    Attributes
    ----------
    objective : Objective
        Each term's `sample` is an index into `base` and `matrices`.
    base : tuple of ndarray
        Information that does not depend on the weights, (r, r) for each sample.
    matrices : tuple of ndarray
        Matrices for each sample, (n, r, r), of the candidates.
    rows, bounds : ndarray, (m, n)
        (m,); each row's largest number is one.
    caps : ndarray, (n,)
        Infinite where nothing limits a candidate by itself.
    start : ndarray, (n,)
        Weights that leave room in every row, or lie on it where no weights do.
    """

    objective: Objective
    base: tuple[Array, ...]
    matrices: tuple[Array, ...]
    rows: Array
    bounds: Array
    caps: Array
    start: Array

    def information(self, weights: Array) -> tuple[Array, ...]:
        """Return each sample's information, (r, r)."""
        pairs = zip(self.base, self.matrices, strict=True)
        return tuple(
            base + (weights @ H.reshape(len(H), -1)).reshape(base.shape) for base, H in pairs
        )

    def completed(self, weights: Array) -> Array:
        """Return weights that use up the budget, where nothing else limits them, and no limit more.

        Solvers meet limits but for their tolerance. Rows with negative entries, which ask for a
        least use, stay as they are.
        """
        if len(self.rows) == 1 and np.isinf(self.caps).all():
            return np.asarray(weights * (self.bounds[0] / (self.rows[0] @ weights)))
        weights = np.minimum(weights, self.caps)
        for row, bound in zip(self.rows, self.bounds, strict=True):
            taken = float(row @ weights)
            if taken > bound and (row >= 0).all():
                weights = np.where(row > 0, weights * (max(bound, 0.0) / taken), weights)
        return weights

    def violation(self, weights: Array) -> float:
        """Return by how much weights exceed rows, relative to their size, and caps, at most.

        Of answers that are as exact as their solver is: `Polytope.violation` is strict.
        """
        sizes = np.maximum(np.abs(self.bounds), np.abs(self.rows).max(axis=1) * weights.sum())
        rows = (self.rows @ weights - self.bounds) / sizes
        return float(max(rows.max(initial=0.0), (weights - self.caps).max()))


@dataclass(frozen=True, eq=False)
class SolverAnswer:
    """The solution of a scaled problem, by one method.

    Attributes
    ----------
    weights : ndarray, (n,)
        Weights.
    row_multipliers : ndarray, (m,)
        Multipliers of the rows, not negative: derivative of the log value by each bound.
    witness : tuple of ndarray
        One (r, r) for each term, the derivative of the log value, or its equal in the dual.
    method : str
        Method that gave the answer, as `Design.solver` shows it.
    mu : float
        Where a barrier method stopped; 0 for any other method. Positive weights of such a method
        are certified by their derivative.
    """

    weights: Array
    row_multipliers: Array
    witness: tuple[Array, ...]
    method: str
    mu: float = 0.0


@runtime_checkable
class DesignSolver(Protocol):
    """A method that solves a design over a few candidates.

    `optimal_design` chooses the candidates, grows their number and certifies every answer over all
    of them, so a poor answer costs time and never a wrong certificate. Where a solver fails or its
    answers are too rough, `Newton` goes on.
    """

    @property
    def first_goal(self) -> float:
        """Accuracy asked for while candidates are still added; 0 for the final one at once."""

    def check(self, objective: Objective) -> None:
        """Raise `InvalidInput` if the solver does not take an objective."""

    def solve(
        self, problem: ScaledProblem, goal: float, near: SolverAnswer | None = None
    ) -> SolverAnswer:
        """Return weights whose log value is within `goal` of the largest.

        Parameters
        ----------
        problem : ScaledProblem
            Problem whose objective is maximised.
        goal : float
            Accuracy of the maximum.
        near : SolverAnswer, optional
            A rougher answer to the same problem, to go on from.

        Raises
        ------
        SolverFailed
            If there is no answer.
        """
