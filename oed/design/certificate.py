"""How far a design can be from the optimum: a bound that holds whatever solver made the design.

An objective's value f is concave and proportional to the information. So for any positive
semidefinite W_j, with c from `Objective.log_polar`, no allowed weights w' have a value above

    [ sum_j tr(W_j M_0) + max_w' sum_i w'_i sum_j tr(W_j H_ij) ] / c,

and the gap is that divided by the design's value, less one. Where W is the derivative of log f
this is the equivalence theorem (Kiefer and Wolfowitz 1960; Pukelsheim 1993): for D and shares,
max_i tr(M^-1 H_i)/p - 1. E, maximin and a singular M need a better W than the derivative, which is
not unique. All of it is computed in white coordinates: in others the terms of a trace may cancel.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from oed.criteria.criteria import Criterion, objective_of
from oed.design.constraints import Constraints
from oed.design.polytope import Polytope
from oed.design.problem import DesignProblem
from oed.design.whitening import Whitening
from oed.information_sets.candidates import Matrices
from robotmodels.common.arrays import Array, real_numbers
from robotmodels.common.errors import InvalidInput, NotIdentifiable


@dataclass(frozen=True, eq=False)
class Certificate:
    """A gap, the bound behind it and the sensitivity function.

    Attributes
    ----------
    gap : float
        No allowed weights have more than (1 + gap) times the design's value.
    log_bound : float
        No allowed weights have a larger log value.
    sensitivity : ndarray, (Q,)
        The sensitivity function: derivative of the log value by each weight.
    """

    gap: float
    log_bound: float
    sensitivity: Array


def certify(
    problem: DesignProblem,
    weights: Array,
    witness: Sequence[Array] | None = None,
    multipliers: Array | None = None,
) -> Certificate:
    """Return the certificate of any weights (Q,).

    Parameters
    ----------
    problem : DesignProblem
        Problem that the design solves.
    weights : ndarray
        Weights of the design.
    witness : sequence of ndarray, optional
        W_j of each term; the derivative at the design if None.
    multipliers : ndarray, optional
        Multipliers of the rows, if known; they spare a linear program.
    """
    try:
        whitening = Whitening.of(problem)
    except NotIdentifiable:
        return _nothing(problem)
    return certified(whitening, weights, witness, multipliers)


def certified(
    whitening: Whitening,
    weights: Array,
    witness: Sequence[Array] | None = None,
    multipliers: Array | None = None,
) -> Certificate:
    """Return what `certify` does, for a problem's whitening."""
    problem, coordinates = whitening.problem, whitening.coordinates
    p = len(problem.candidates.names)
    white = coordinates.matrices(problem.information(weights).reshape(1, -1, p, p))
    information = tuple(matrix[0] for matrix in white)
    value = whitening.objective.log_value(information)
    if witness is None:
        witness = whitening.objective.witness(information)
    else:
        witness = coordinates.white_witness(problem.objective, witness)
    if not all(np.isfinite(W).all() for W in witness) or not value > -np.inf:
        return _nothing(problem)
    return bounded(whitening, value, tuple(witness), multipliers)


def _nothing(problem: DesignProblem) -> Certificate:
    """Return the certificate of a design that has none."""
    return Certificate(np.inf, np.inf, np.full(len(problem.candidates), np.inf))


def bounded(
    whitening: Whitening, value: float, witness: tuple[Array, ...], multipliers: Array | None
) -> Certificate:
    """Return the certificate of a white log value by a white witness.

    Parameters
    ----------
    whitening : Whitening
        Whitening of the problem.
    value : float
        Value of a design, in white coordinates.
    witness : tuple of ndarray
        W_j of each term, positive semidefinite.
    multipliers : ndarray or None
        Multipliers of the rows, or None for those of a linear program.
    """
    problem, objective = whitening.problem, whitening.objective
    p, K = len(problem.candidates.names), len(whitening.base)
    raw = whitening.coordinates.witness(objective, witness)
    weight = problem.objective.summed_by_sample(raw, (p, p) if K == 1 else (K, p, p))
    sensitivity = problem.candidates.directional_derivatives(weight)
    prior = 0.0 if problem.prior is None else float(np.vdot(weight, problem.prior))
    most = prior + problem.allowed.upper_bound(sensitivity, multipliers)
    if not most > 0:
        return Certificate(np.inf, np.inf, sensitivity)
    log_bound = float(np.log(most)) - objective.log_polar(witness)
    gap = float(np.expm1(log_bound - value))
    return Certificate(gap, log_bound + whitening.constant, sensitivity)


def optimality_gap(
    weights: Array,
    matrices: Array,
    criterion: str | Criterion = "D",
    constraints: Constraints | None = None,
    prior: Array | None = None,
    witness: Sequence[Array] | None = None,
) -> float:
    """Return how much better than this design another could be; 0 at an optimum.

    For D without constraints $max_i tr(M^-1 H_i) / p - 1$; infinite where the design leaves
    something undetermined that the criterion needs.

    Parameters
    ----------
    weights : ndarray, (Q,)
        Shares of the experiments, none negative; they are scaled to sum to one. With constraints
        they are taken as they are.
    matrices : ndarray, (Q, p, p), or (Q, K, p, p)
        Information of one experiment in each candidate position, the latter for K samples of theta.
    criterion : str or Criterion
        A criterion or its name; one that speaks of parameter names needs an `Objective`.
    constraints : Constraints, optional
        What limits the weights; by default they are shares.
    prior : ndarray, optional
        Information there is already, (p, p) or (K, p, p).
    witness : sequence of ndarray, optional
        Witness of a `Design`, needed for E, maximin and designs that leave something open, where
        the derivative is not unique.

    Raises
    ------
    InvalidInput
        If the weights do not fit, one is negative or not finite, or all are zero; if the weights
        violate a constraint.
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
    objective = objective_of(criterion, candidates.names, candidates.samples)
    return certify(DesignProblem(candidates, objective, allowed, prior), shares, witness).gap


def efficiency_bound(gap: float) -> float:
    """Return the least efficiency of a design with that gap.

    Values being proportional to information, it is the share of experiments with which an optimal
    design would do as well; for D it is $(det M / det M_opt)^(1/p)$.
    """
    return 1.0 / (1.0 + gap)


def checked_weights(weights: Array, n_candidates: int) -> Array:
    """Return `weights` as a (Q,) array that sums to one.

    Raises
    ------
    InvalidInput
        If the weights do not fit, one is negative or not finite, or all are zero.
    """
    array = not_negative(weights, n_candidates)
    return np.asarray(array / array.sum())


def not_negative(weights: Array, n_candidates: int) -> Array:
    """Return `weights` as a (Q,) array.

    Raises
    ------
    InvalidInput
        If the weights do not fit, one is negative or not finite, or all are zero.
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
