"""Solve a design over a growing set of candidates until none of the others could help."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from oed.design.certificate import Certificate, certify
from oed.design.conic import conic
from oed.design.criteria import sensitivities
from oed.design.inner_problem import InnerAnswer, InnerProblem
from oed.design.newton import newton
from oed.design.ranking import largest
from oed.design.scaled_problem import Problem, ScaledProblem
from robotmodels.arrays import Array, IntArray
from robotmodels.errors import InvalidInput, SolverFailed

Solver = Callable[[InnerProblem], InnerAnswer]

# Rounds of the interior-point method that look for the candidates cvxpy then states.
_SCOUTING = 10


@dataclass(frozen=True, eq=False)
class Solution:
    """Weights (Q,) with their certificate, and the multipliers of the rows, (m,)."""

    weights: Array
    certificate: Certificate
    witness: tuple[Array, ...]
    row_multipliers: Array
    rounds: int
    solver: str
    by_derivative: bool


def solve(
    problem: Problem, tolerance: float, max_rounds: int, solver: str, form: str = "dual"
) -> Solution:
    """Return a solution; the caller judges its gap.

    Raises
    ------
    InvalidInput : if `max_rounds` is not positive.
    NotIdentifiable : naming the parameters that all candidates together leave open.
    SolverFailed : if the solver gives no answer.
    """
    if max_rounds < 1:
        raise InvalidInput(f"max_rounds: {max_rounds!r}; at least 1 is needed")
    scaled = ScaledProblem.of(problem)
    active = scaled.first_active()
    fast = partial(newton, tolerance=1e-3 * tolerance)
    finishes = _finishes(problem, partial(_or_conic, fast, form), form)
    answer: Solver = finishes[0][0] if solver == "newton" else partial(conic, form=form)
    if solver != "newton" and problem.objective.smooth:
        active = _scouted(scaled, active, tolerance, fast)
    best: Solution | None = None
    used: list[str] = []
    rounds, trim = 0, True
    while rounds < max_rounds:
        rounds += 1
        solution = _round(scaled, active, tolerance, answer, trim)
        used = list(dict.fromkeys([*used, solution.solver]))
        if best is None or solution.certificate.gap < best.certificate.gap:
            best = solution
        closed = solution.certificate.gap <= 0.5 * tolerance
        larger = None if closed else _larger(scaled, solution, active, tolerance)
        if larger is None:
            solution = _with_derivative(problem, solution)
            if solution.certificate.gap <= tolerance:
                best = solution
                break
        if larger is not None:
            active = larger
        elif finishes:
            # The right candidates, but not precisely enough: once more, without the others.
            answer, trim = finishes.pop(0)
            active = _used(scaled, solution, active)
        else:
            break
    assert best is not None  # of one round at least
    return replace(best, rounds=rounds, solver=", ".join(used))


def _finishes(problem: Problem, surest: Solver, form: str) -> list[tuple[Solver, bool]]:
    """Return what answers more precisely, and whether shares that vanish are then left out.

    First they are, then they stay, for nearly equal candidates may need theirs however small. If
    that does not help either, the solver's witness must do. Without second derivatives it is the
    other form of the problem that may, where there is one.
    """
    if problem.objective.smooth:
        return [(surest, True), (surest, False)]
    if len(problem.objective.groups) > 1:
        return []
    return [(partial(conic, form="primal" if form == "dual" else "dual"), True)]


def _scouted(scaled: ScaledProblem, active: IntArray, tolerance: float, answer: Solver) -> IntArray:
    """Return the candidates that a fast method finds to matter, and as many others as parameters.

    It spares the slow one most rounds; what it misses or cannot solve is left to those that follow.
    """
    for _ in range(_SCOUTING):
        try:
            solution = _round(scaled, active, tolerance, answer)
        except SolverFailed:
            break
        larger = _larger(scaled, solution, active, tolerance)
        if larger is None:
            used = _used(scaled, solution, active)
            others = largest(_excess(scaled, solution, used), 4 * scaled.parameters)
            both = np.concatenate([used, others])
            return scaled.distinct(both, len(used) + scaled.parameters)
        active = larger
    return active


def _with_derivative(problem: Problem, solution: Solution) -> Solution:
    """Return the solution certified by the derivative at its weights, where there is one.

    That is what anybody finds who checks the weights; it asks more of them than the solver's
    witness does, for weights near the best ones may have a poor derivative.
    """
    one_group = len(problem.objective.groups) == 1
    if solution.by_derivative or not (problem.objective.smooth and one_group):
        return solution
    witness = problem.objective.witness(problem.information(solution.weights))
    certificate = _certificate(problem, solution.weights, witness, solution.row_multipliers)
    return replace(solution, certificate=certificate, witness=witness, by_derivative=True)


def _certificate(
    problem: Problem, weights: Array, witness: tuple[Array, ...], multipliers: Array
) -> Certificate:
    p = problem
    return certify(weights, p.candidates, p.objective, p.allowed, p.prior, witness, multipliers)


def _round(
    scaled: ScaledProblem, active: IntArray, tolerance: float, answer: Solver, trim: bool = True
) -> Solution:
    """Solve one active set and price all candidates."""
    problem, allowed = scaled.problem, scaled.problem.allowed
    inner, row_scales = scaled.inner(active)
    found = answer(inner)
    shares = _complete(inner, found.weights)
    if trim:
        shares = _trimmed(inner, found, min(tolerance, 1e-6))
    weights = allowed.lower.copy()
    weights[active] += shares * scaled.units[active]
    white, same = _at(inner, shares, found.witness)
    witness = scaled.coordinates.witness(scaled.objective, white)
    multipliers = found.row_multipliers[: len(allowed.rows)] / row_scales
    certificate = _certificate(problem, weights, witness, multipliers)
    return Solution(weights, certificate, witness, multipliers, 1, found.solver, same)


def _larger(
    scaled: ScaledProblem, solution: Solution, active: IntArray, tolerance: float
) -> IntArray | None:
    """Return the candidates used and those worth most above their price; None if there is none."""
    excess = _excess(scaled, solution, active)
    worst = largest(excess, 2 * scaled.batch)
    worst = worst[excess[worst] > 0.25 * tolerance]
    if not len(worst):
        return None
    used = _used(scaled, solution, active)
    return scaled.distinct(np.concatenate([used, worst]), len(used) + scaled.batch)


def _excess(scaled: ScaledProblem, solution: Solution, active: IntArray) -> Array:
    """Return what a share of each candidate is worth above its price, (Q,); -inf if active."""
    priced = solution.row_multipliers @ scaled.problem.allowed.rows
    excess = (solution.certificate.prices - priced) * scaled.units
    excess[active] = -np.inf
    excess[scaled.closed] = -np.inf
    return np.asarray(excess)


def _used(scaled: ScaledProblem, solution: Solution, active: IntArray) -> IntArray:
    return active[solution.weights[active] > scaled.problem.allowed.lower[active]]


def _or_conic(fast: Solver, form: str, inner: InnerProblem) -> InnerAnswer:
    """Solve; where the interior-point method gets stuck, cvxpy takes over."""
    try:
        return fast(inner)
    except SolverFailed as error:
        answer = conic(inner, form)
        return replace(answer, solver=f"{error}: {answer.solver}")


def _at(
    inner: InnerProblem, shares: Array, witness: tuple[Array, ...]
) -> tuple[tuple[Array, ...], bool]:
    """Return the derivative at the shares and True, if it is the solver's witness but for rounding.

    That saves to price all candidates by both.
    """
    if len(inner.objective.groups) > 1 or not inner.objective.smooth:
        return witness, False
    derivative = inner.objective.witness(inner.information(shares))
    pairs = zip(derivative, witness, strict=True)
    same = all(np.abs(a - b).max() <= 1e-6 * np.abs(b).max() for a, b in pairs)
    return (derivative, True) if same else (witness, False)


def _trimmed(inner: InnerProblem, answer: InnerAnswer, tolerance: float) -> Array:
    """Return shares without those that vanish at the optimum, if that costs nothing.

    There either a share or what its candidate costs above its price is zero; of two small numbers
    the larger one is not.
    """
    shares = answer.weights
    terms = zip(inner.objective.terms, answer.witness, strict=True)
    prices = sum(sensitivities(W, inner.matrices[term.sample]) for term, W in terms)
    excess = answer.row_multipliers @ inner.rows - prices
    kept = np.where(shares > np.maximum(0.1 * tolerance, excess), shares, 0.0)
    kept, shares = _complete(inner, kept), _complete(inner, shares)
    before = inner.objective.log_value(inner.information(shares))
    after = inner.objective.log_value(inner.information(kept))
    return np.asarray(kept if after > before - 0.1 * tolerance else shares)


def _complete(inner: InnerProblem, shares: Array) -> Array:
    """Return shares that use up the budget, where nothing else limits them, and no more of a limit.

    Solvers meet limits but for their tolerance. Rows with negative entries, which ask for a least
    use, stay as they are.
    """
    if len(inner.rows) == 1:
        return np.asarray(shares / shares.sum())
    for row, bound in zip(inner.rows, inner.bounds, strict=True):
        taken = float(row @ shares)
        if taken > bound and (row >= 0).all():
            shares = np.where(row > 0, shares * (max(bound, 0.0) / taken), shares)
    return shares
