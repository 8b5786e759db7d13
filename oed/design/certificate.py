"""How far a design can be from the optimum: a bound that does not care who made the design.

An objective's value f is concave and proportional to the information. So for any positive
semidefinite W_j, with c from `Objective.log_polar`, no allowed weights w' have a value above

    [ sum_j tr(W_j M_0) + max_w' sum_i w'_i sum_j tr(W_j H_ij) ] / c,

and the gap is that divided by the design's own value, less one. Where W is the derivative of log f
this is the equivalence theorem (Kiefer and Wolfowitz 1960; Pukelsheim 1993): for D and shares,
max_i tr(M^-1 H_i)/p - 1. E and maximin need a better W than the derivative, which is not unique.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from oed.design.constraints import Constraints
from oed.design.criteria import Criterion, sensitivities
from oed.design.criteria import objective as stated
from oed.design.objective import Objective
from oed.design.polytope import Polytope
from robotmodels.arrays import Array, IntArray, real_numbers
from robotmodels.errors import InvalidInput


class Candidates(Protocol):
    """What designs need of candidates, in memory or not; `InformationSet` is one."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the p parameters."""
        ...

    @property
    def samples(self) -> int:
        """Number K of parameter values for which the information is known."""
        ...

    def __len__(self) -> int: ...

    def take(self, indices: IntArray) -> Array:
        """Return matrices, (n, p, p), or (n, K, p, p) with samples."""
        ...

    def prices(self, weight: Array) -> Array:
        """Return tr(W H_i), (Q,), summed over samples; W is (p, p) or (K, p, p)."""
        ...

    def combined(self, weights: Array) -> Array:
        """Return sum_i w_i H_i, (p, p) or (K, p, p)."""
        ...


@dataclass(frozen=True, eq=False)
class Certificate:
    """A gap and what it was found with.

    Attributes
    ----------
    gap : no allowed weights have more than (1 + gap) times the design's value.
    prices : (Q,) what a unit of each weight adds to the log value, the sensitivity function.
    """

    gap: float
    prices: Array


def certify(
    weights: Array,
    candidates: Candidates,
    objective: Objective,
    allowed: Polytope,
    prior: Array | None = None,
    witness: Sequence[Array] | None = None,
    multipliers: Array | None = None,
) -> Certificate:
    """Return the certificate of weights (Q,).

    Parameters
    ----------
    weights, candidates, objective, allowed : the design's problem.
    prior : M_0, of the shape of one candidate's information.
    witness : W_j of each term; the derivative at the design if None.
    multipliers : of the rows of `allowed`, if known; they spare a linear program.
    """
    own = candidates.combined(weights)
    information = own if prior is None else own + prior
    value = objective.log_value(information)
    if witness is None:
        witness = objective.witness(information)
    if not all(np.isfinite(W).all() for W in witness) or not value > -np.inf:
        return Certificate(np.inf, np.full(len(candidates), np.inf))
    weight = objective.price(witness, information.shape)
    prices = candidates.prices(weight)
    known = 0.0 if prior is None else float(np.vdot(weight, prior))
    most = known + allowed.most(prices, multipliers)
    if not most > 0:
        return Certificate(np.inf, prices)
    log_bound = np.log(most) - objective.log_polar(witness)
    return Certificate(float(np.expm1(log_bound - value)), prices)


def optimality_gap(
    weights: Array,
    matrices: Array,
    criterion: str | Criterion = "D",
    constraints: Constraints | None = None,
    prior: Array | None = None,
    witness: Sequence[Array] | None = None,
) -> float:
    """Return how much better than this design another could be; 0 at an optimum.

    For D without constraints max_i tr(M^-1 H_i)/p - 1; infinite where the design leaves something
    open that the criterion asks for.

    Parameters
    ----------
    weights : (Q,) shares of the experiments, none negative; they are scaled to sum to one. With
        constraints they are taken as they are.
    matrices : (Q, p, p), or (Q, K, p, p) for K samples of theta, information of one experiment in
        each candidate position.
    criterion : a criterion or its name; one that speaks of parameter names needs an `Objective`.
    constraints : what limits the weights; by default they are shares.
    prior : information there is already, (p, p) or (K, p, p).
    witness : of a `Design`, needed for E and maximin, where the derivative is not unique.

    Raises
    ------
    InvalidInput : if the weights do not fit, one is negative or not finite, or all are zero; if
        the weights violate a constraint.
    """
    allowed = Polytope.shares(len(matrices))
    if constraints is None:
        shares = checked_weights(weights, len(matrices))
    else:
        allowed = constraints.polytope(len(matrices))
        shares = not_negative(weights, len(matrices))
        if allowed.violation(shares) > 1e-6:
            raise InvalidInput("weights: they violate the constraints")
    matrices = np.asarray(matrices, dtype=float)
    candidates = Matrices(tuple(str(i) for i in range(matrices.shape[-1])), matrices)
    objective = stated(criterion, candidates.names, candidates.samples)
    return certify(shares, candidates, objective, allowed, prior, witness).gap


@dataclass(frozen=True, eq=False)
class Matrices:
    """Candidates without positions, as they are: matrices (Q, p, p) or (Q, K, p, p)."""

    names: tuple[str, ...]
    matrices: Array

    def __len__(self) -> int:
        return len(self.matrices)

    @property
    def samples(self) -> int:
        """Number K of parameter values."""
        return 1 if self.matrices.ndim == 3 else self.matrices.shape[1]

    def take(self, indices: IntArray) -> Array:
        """Return matrices, see `Candidates`."""
        return np.asarray(self.matrices[indices])

    def prices(self, weight: Array) -> Array:
        """Return tr(W H_i), see `Candidates`."""
        return sensitivities(weight, self.matrices)

    def combined(self, weights: Array) -> Array:
        """Return sum_i w_i H_i, see `Candidates`."""
        return np.asarray(np.tensordot(weights, self.matrices, axes=1))


def efficiency_bound(gap: float) -> float:
    """Return the least efficiency of a design with that gap.

    Values being proportional to information, it is the share of experiments with which an optimal
    design would do as well; for D it is (det M / det M_optimal)^(1/p).
    """
    return 1.0 / (1.0 + gap)


def checked_weights(weights: Array, n_candidates: int) -> Array:
    """Return `weights` as a (Q,) array that sums to one.

    Raises
    ------
    InvalidInput : if the weights do not fit, one is negative or not finite, or all are zero.
    """
    array = not_negative(weights, n_candidates)
    return np.asarray(array / array.sum())


def not_negative(weights: Array, n_candidates: int) -> Array:
    """Return `weights` as a (Q,) array.

    Raises
    ------
    InvalidInput : if the weights do not fit, one is negative or not finite, or all are zero.
    """
    array = real_numbers(weights, "weights")
    if array.shape != (n_candidates,):
        raise InvalidInput(
            f"weights: shape {array.shape}, one weight for each of {n_candidates} candidates "
            "is needed"
        )
    wrong = ~(np.isfinite(array) & (array >= 0))
    if wrong.any():
        i = int(np.argmax(wrong))
        raise InvalidInput(f"weights: {array[i]:g} of candidate {i} is not a number >= 0")
    if array.sum() == 0:
        raise InvalidInput("weights: all are zero; at least one candidate must be used")
    return array
