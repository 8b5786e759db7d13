"""Solve a design over a growing set of candidates until none of the others could help."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from oed.design.certificate import Candidates, Certificate, certify
from oed.design.conic import conic
from oed.design.coordinates import Coordinates
from oed.design.criteria import sensitivities
from oed.design.duplicates import distinct
from oed.design.inner_problem import InnerAnswer, InnerProblem
from oed.design.newton import newton
from oed.design.objective import Objective
from oed.design.polytope import Polytope
from oed.plans.ranking import largest
from robotmodels.arrays import Array, IntArray
from robotmodels.errors import InvalidInput, SolverFailed

# An active set must determine every direction at least this well beside all candidates.
_WEAKEST = 1e-6


@dataclass(frozen=True, eq=False)
class Problem:
    """Maximise objective(prior + sum_i w_i H_i) over the allowed weights."""

    candidates: Candidates
    objective: Objective
    allowed: Polytope
    prior: Array | None = None

    def information(self, weights: Array) -> Array:
        """Return the prior and sum_i w_i H_i, (p, p) or (K, p, p)."""
        own = self.candidates.combined(weights)
        return own if self.prior is None else own + self.prior


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


@dataclass(frozen=True, eq=False)
class _Scaled:
    """The problem in variables v_i: shares of the budget beyond the lower weights."""

    problem: Problem
    coordinates: Coordinates
    objective: Objective
    base: Array
    units: Array  # (Q,) what a share of one means for the weight

    def stack(self, indices: IntArray) -> Array:
        """Return each candidate's information for a share of one, (n, K, p, p)."""
        H = self.problem.candidates.take(indices)
        p = H.shape[-1]
        return np.asarray(H.reshape(len(H), -1, p, p) * self.units[indices, None, None, None])


def solve(
    problem: Problem, tolerance: float, max_rounds: int, solver: str, form: str = "dual"
) -> Solution:
    """Return a solution; the caller judges its gap.

    Raises
    ------
    NotIdentifiable : naming the parameters that all candidates together leave open.
    SolverFailed : if the solver gives no answer.
    """
    scaled = _scaled(problem)
    active = _first_active(scaled)
    best: Solution | None = None
    used: list[str] = []
    polished = not problem.objective.smooth
    for done in range(1, max_rounds + 1):
        solution, larger = _round(scaled, active, tolerance, solver, form, done)
        used = list(dict.fromkeys([*used, solution.solver]))
        closed = solution.certificate.gap <= 0.5 * tolerance
        if best is None or solution.certificate.gap < best.certificate.gap:
            best = solution
        if closed:
            solution = _with_derivative(problem, solution)
            if solution.certificate.gap <= tolerance:
                best = solution
                break
        if not closed and larger is not None:
            active = larger
        elif not polished:
            # The right candidates, but not precisely enough: once more, without the others. If
            # that does not help, candidates are nearly equal, and the solver's witness must do.
            polished, solver = True, "newton"
            active = active[solution.weights[active] > problem.allowed.lower[active]]
        else:
            break
    if best is None:
        raise InvalidInput(f"max_rounds: {max_rounds!r}; at least 1 is needed")
    return replace(best, rounds=done, solver=", ".join(used))


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
    scaled: _Scaled, active: IntArray, tolerance: float, solver: str, form: str, done: int
) -> tuple[Solution, IntArray | None]:
    """Solve one active set and price all candidates; return the next set, or None."""
    problem, allowed = scaled.problem, scaled.problem.allowed
    inner, row_scales = _inner(scaled, active)
    answer = _answer(inner, tolerance, solver, form)
    shares = _trimmed(inner, answer, min(tolerance, 1e-6))
    weights = allowed.lower.copy()
    weights[active] += shares * scaled.units[active]
    white, same = _at(inner, shares, answer.witness)
    witness = scaled.coordinates.witness(scaled.objective, white)
    multipliers = answer.row_multipliers[: len(allowed.rows)] / row_scales
    certificate = _certificate(problem, weights, witness, multipliers)
    solution = Solution(weights, certificate, witness, multipliers, done, answer.solver, same)
    excess = (certificate.prices - multipliers @ allowed.rows) * scaled.units
    excess[active] = -np.inf
    excess[allowed.upper <= allowed.lower] = -np.inf
    size = 2 * len(problem.candidates.names)
    worst = largest(excess, 4 * size)
    worst = worst[excess[worst] > 0.25 * tolerance]
    if not len(worst):
        return solution, None
    used = active[shares > 0]
    return solution, _distinct(scaled, np.concatenate([used, worst]), len(used) + size)


def _answer(inner: InnerProblem, tolerance: float, solver: str, form: str) -> InnerAnswer:
    """Solve; where the interior-point method gets stuck, cvxpy takes over."""
    if solver == "newton":
        try:
            return newton(inner, 1e-3 * tolerance)
        except SolverFailed as error:
            answer = conic(inner, form)
            return replace(answer, solver=f"{error}: {answer.solver}")
    return conic(inner, form)


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


def _scaled(problem: Problem) -> _Scaled:
    """Return the problem in shares and coordinates of order one, after the rank check."""
    allowed, candidates = problem.allowed, problem.candidates
    room = max(float(allowed.room[0]), 1e-12 * float(allowed.bounds[0]))
    units = room / allowed.rows[0]
    usable = allowed.upper > allowed.lower
    equal = np.where(usable, units, 0.0) / max(int(usable.sum()), 1)
    base = _samples(problem.information(allowed.lower))
    reference = base + _samples(candidates.combined(equal))
    coordinates = Coordinates.whitening(reference, problem.objective, candidates.names)
    return _Scaled(problem, coordinates, coordinates.objective(problem.objective), base, units)


def _samples(information: Array) -> Array:
    return information if information.ndim == 3 else information[None]


def _inner(scaled: _Scaled, active: IntArray) -> tuple[InnerProblem, Array]:
    """Return the problem over the active candidates, and what its rows were divided by."""
    allowed, units = scaled.problem.allowed, scaled.units[active]
    rows = allowed.rows[:, active] * units
    bounds = allowed.room
    scales = np.maximum(np.abs(rows).max(axis=1), np.abs(bounds))
    scales = np.where(scales > 0, scales, 1.0)
    rows, bounds = rows / scales[:, None], bounds / scales
    caps = (allowed.upper - allowed.lower)[active] / units
    # The budget alone keeps shares below one.
    capped = np.flatnonzero(caps < 1.0)
    unit = np.eye(len(active))[capped]
    inner = InnerProblem(
        scaled.objective,
        tuple(matrix[0] for matrix in scaled.coordinates.matrices(scaled.base[None])),
        scaled.coordinates.matrices(scaled.stack(active)),
        np.concatenate([rows, unit]),
        np.concatenate([bounds, caps[capped]]),
    )
    return inner, scales


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
    if len(inner.rows) == 1:
        kept /= kept.sum()
        shares = shares / shares.sum()
    before = inner.objective.log_value(inner.information(shares))
    after = inner.objective.log_value(inner.information(kept))
    return np.asarray(kept if after > before - 0.1 * tolerance else shares)


def _first_active(scaled: _Scaled) -> IntArray:
    """Return some candidates of largest trace that determine everything and obey the rows."""
    allowed, K = scaled.problem.allowed, len(scaled.base)
    size = 2 * len(scaled.problem.candidates.names)
    closed = allowed.upper <= allowed.lower
    whole = [np.eye(len(T)) for T in scaled.coordinates.transforms]

    def prices(white: Sequence[Array]) -> Array:
        pairs = zip(scaled.coordinates.transforms, white, strict=True)
        weight = np.stack([T.T @ W @ T for T, W in pairs])
        candidates = scaled.problem.candidates
        price = candidates.prices(weight if candidates.samples > 1 else weight[0]) * scaled.units
        price[closed] = -np.inf
        return price

    price = prices(whole)
    active = _distinct(scaled, largest(price, 4 * size), size)
    if len(allowed.rows) > 1 or np.isfinite(allowed.upper).any():
        vertex = allowed.best(np.where(closed, 0.0, price) / scaled.units)[0]
        more = np.flatnonzero((vertex > allowed.lower) & ~closed)
        active = np.union1d(active, more)
    open_count = int((~closed).sum())
    while len(active) < open_count:
        mean = [
            base[0] + H.mean(axis=0)
            for base, H in zip(
                scaled.coordinates.matrices(scaled.base[None]),
                scaled.coordinates.matrices(scaled.stack(active)),
                strict=True,
            )
        ]
        if min(np.linalg.eigvalsh(M)[0] for M in mean) > _WEAKEST:
            break
        # What the chosen ones leave open is priced highest.
        price = prices([np.linalg.inv(M + _WEAKEST * np.eye(len(M))) / K for M in mean])
        price[active] = -np.inf
        active = np.concatenate([active, largest(price, size // 2)])
    return np.asarray(active)


def _distinct(scaled: _Scaled, indices: IntArray, count: int) -> IntArray:
    """Return the first `count` candidates of `indices` without equals among them.

    Equal candidates only spread weight, but where each has a limit they are needed.
    """
    allowed = scaled.problem.allowed
    if np.isfinite((allowed.upper - allowed.lower)[indices]).any():
        return indices[:count]
    white = scaled.coordinates.matrices(scaled.stack(indices))
    rows = allowed.rows[1:, indices] * scaled.units[indices]
    sizes = np.maximum(np.abs(rows).max(axis=1, initial=0.0), 1e-300)
    parts = [H.reshape(len(indices), -1) for H in white] + [(rows / sizes[:, None]).T]
    kept = distinct(np.concatenate(parts, axis=1))
    return np.asarray(indices[kept[:count]])
