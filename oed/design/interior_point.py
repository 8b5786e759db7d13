"""A barrier method for designs over a few candidates, whatever is singular at the optimum.

It maximises, for a falling mu,

    log value(w) + mu [ sum_i log w_i + sum_i log (u_i - w_i) + sum_j log (b - R w)_j ]

by Newton's method with primal-dual scaling and a line search, and stops at a positive mu. Weights
are then positive, mu over their reduced costs: the information stays regular,
its derivative is unique, and the gap, (n + m) mu, follows from the weights alone. What has no
second derivatives is smoothed by the same mu, see `smoothing`.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from oed.criteria.objective import Objective
from oed.design.problem import ScaledProblem, SolverAnswer
from oed.design.smoothing import Smoothed, smoothed, smoothed_value, smoothed_witness
from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput, SolverFailed

_MOST_STEPS = 60  # for one mu
_TO_BOUNDARY = 0.99
_ARMIJO = 1e-4
# Where a step promises less than this part of mu, Newton's method converges without a line search;
# less than the others, it has converged: well enough to go on, to stop, or to stop with precise
# multipliers of groups and of E, which have the root of this relative error.
_CLOSE, _CENTRED, _CONVERGED, _PRECISE = 0.1, 0.5, 1e-5, 1e-13
# Duals stay within this factor of mu over their primals.
_TRUST = 1e6
_SHARE_OF_GOAL = 0.15


@dataclass(frozen=True, eq=False)
class _Point:
    """Weights and the duals of weights, caps and rows, all positive."""

    weights: Array
    lower: Array
    upper: Array
    rows: Array


@dataclass(frozen=True)
class Newton:
    """A design solver: the barrier method of this package, for every criterion but E.

    Attributes
    ----------
    first_goal : float
        Accuracy asked for while candidates are still added: which of them matter shows long before
        their weights are precise.
    """

    first_goal: float = 0.03

    def __post_init__(self) -> None:
        if not 0 <= self.first_goal < np.inf:
            raise InvalidInput(f"first_goal: {self.first_goal!r}; a number >= 0 is needed")

    def check(self, objective: Objective) -> None:
        """Refuse an objective without second derivatives.

        Raises
        ------
        InvalidInput
            Naming the criterion.
        """
        if not objective.smooth:
            raise InvalidInput(f'criterion {objective.name} is not smooth: use solver="cvxpy"')

    def solve(
        self, problem: ScaledProblem, goal: float, near: SolverAnswer | None = None
    ) -> SolverAnswer:
        """Return a design whose log value is within about a fifth of `goal` of the best.

        Parameters
        ----------
        problem : ScaledProblem
            Problem whose objective is maximised; what has no second derivatives is smoothed.
        goal : float
            Accuracy of the maximum.
        near : SolverAnswer, optional
            An answer to go on from, at its mu.

        Raises
        ------
        SolverFailed
            If it cannot go on; a certificate tells how good an answer is.
        """
        n, m = problem.rows.shape[1], len(problem.rows)
        plain = problem.objective.smooth and len(problem.objective.groups) == 1
        pairs = n + m + int(np.isfinite(problem.caps).sum()) + len(problem.objective.groups)
        pairs += sum(
            len(problem.base[t.sample]) for t in problem.objective.terms if t.mean.kind == "E"
        )
        last = _SHARE_OF_GOAL * goal / pairs
        mu, weights = max(1.0 / pairs, last), problem.start
        if near is not None:
            # Complete weights are on the boundary.
            inside = (1.0 - max(near.mu, last)) * near.weights
            if _merit(problem, inside, last) > -np.inf:
                mu, weights = max(near.mu, last), inside
        point = _centred(problem, weights, mu)
        try:
            while True:
                least = _CONVERGED if plain else _PRECISE
                point, model = _newton(problem, point, mu, _CENTRED if mu > last else least)
                if mu <= last:
                    break
                mu = max(last, min(mu / 5, mu**1.5) if plain else mu / 10)
        except np.linalg.LinAlgError as error:
            raise SolverFailed(f"barrier method: {error} at mu {mu:.1g}") from error
        witness = smoothed_witness(problem, point.weights, last, model.multipliers)
        return SolverAnswer(point.weights, point.rows, witness, "newton", last)


def _newton(
    problem: ScaledProblem, point: _Point, mu: float, least: float
) -> tuple[_Point, Smoothed]:
    """Return the point of the central path at mu, or as near to it as rounding lets come.

    Steps end where the next one promises less than `least` of mu.
    """
    model = smoothed(problem, point.weights, mu)
    value = _merit(problem, point.weights, mu)
    best = np.inf
    for step in range(_MOST_STEPS):
        move, gain = _direction(problem, point, model, mu)
        if gain <= least * mu or (step > 5 and gain < _CLOSE * mu and gain > 0.5 * best):
            break
        best = min(best, gain)
        length = min(1.0, _TO_BOUNDARY * _longest(problem, point.weights, move.weights))
        for _ in range(60):
            weights = point.weights + length * move.weights
            there = _merit(problem, weights, mu)
            enough = gain < _CLOSE * mu and there > -np.inf
            if enough or there >= value + _ARMIJO * length * gain:
                break
            length *= 0.5
        else:
            break  # rounding: no step makes progress
        point = _moved(problem, point, move, weights, length, mu)
        model, value = smoothed(problem, weights, mu), there
    return point, model


def _rooms(problem: ScaledProblem, weights: Array) -> tuple[Array, Array]:
    """Return what caps (n,) and rows (m,) leave."""
    return problem.caps - weights, problem.bounds - problem.rows @ weights


def _centred(problem: ScaledProblem, weights: Array, mu: float) -> _Point:
    above, slack = _rooms(problem, weights)
    if not (min(weights.min(), above.min(), slack.min()) > 0):
        raise SolverFailed("barrier method: no room between the constraints")
    return _Point(weights, mu / weights, mu / above, mu / slack)


def _merit(problem: ScaledProblem, weights: Array, mu: float) -> float:
    """Return the function that is maximised at mu; -inf outside."""
    above, slack = _rooms(problem, weights)
    if not (min(weights.min(), above.min(), slack.min()) > 0):
        return -np.inf
    try:
        value = smoothed_value(problem, weights, mu)
    except np.linalg.LinAlgError:
        return -np.inf
    capped = above[np.isfinite(above)]
    return value + mu * float(np.log(weights).sum() + np.log(capped).sum() + np.log(slack).sum())


def _direction(
    problem: ScaledProblem, point: _Point, model: Smoothed, mu: float
) -> tuple[_Point, float]:
    """Return the move of the weights with the new duals, and the first-order gain of it.

    Duals of rows and groups are not eliminated: active ones would swamp the curvature.
    """
    w, (above, slack) = point.weights, _rooms(problem, point.weights)
    n, m, k, groups = len(w), len(slack), len(model.sizes), len(model.slopes)
    several = groups if groups > 1 else 0
    size = n + m + k + (several + 1 if several else 0)
    capped = np.isfinite(above)
    system, right = np.zeros((size, size)), np.zeros(size)
    diagonal = point.lower / w + np.where(capped, point.upper / np.where(capped, above, 1.0), 0.0)
    system[:n, :n] = model.curvature
    system[np.arange(n), np.arange(n)] += diagonal
    push = mu / w - np.where(capped, mu / above, 0.0)
    right[:n] = push + (0.0 if several else model.gradient)
    rows, tail = slice(n, n + m), np.arange(n, n + m)
    system[rows, :n] = problem.rows
    system[tail, tail] = -slack / point.rows
    right[rows] = -mu / point.rows
    sizes, tail = slice(n + m, n + m + k), np.arange(n + m, n + m + k)
    system[sizes, :n] = model.mixed.T
    system[tail, tail] = model.sizes
    if several:
        # v_g + J dw - t - dt = room + d room, with room lambda = mu.
        first = n + m + k
        inner, tail = slice(first, first + groups), np.arange(first, first + groups)
        system[inner, :n] = -model.slopes
        system[tail, tail] = -model.rooms / model.multipliers
        system[inner, size - 1] = 1.0
        system[size - 1, inner] = 1.0
        right[inner] = -mu / model.multipliers
        right[size - 1] = 1.0
    system[:n, n:] = system[n:, :n].T
    # Unit diagonal: the weights that vanish have huge entries.
    s = np.ones(size)
    scaled = np.concatenate([np.arange(n), np.arange(n + m, n + m + k)])
    s[scaled] = 1.0 / np.sqrt(np.diagonal(system)[scaled])
    factor = lu_factor(s[:, None] * system * s, check_finite=False)
    x = s * lu_solve(factor, s * right, check_finite=False)
    if not np.isfinite(x).all():
        raise np.linalg.LinAlgError("singular Newton system")
    dw = x[:n]
    lower = (mu - point.lower * dw) / w
    upper = np.where(capped, (mu + point.upper * dw) / np.where(capped, above, 1.0), 0.0)
    gradient = model.gradient + push - problem.rows.T @ (mu / slack)
    return _Point(dw, lower, upper, x[rows]), float(gradient @ dw)


def _longest(problem: ScaledProblem, weights: Array, move: Array) -> float:
    """Return the longest step that keeps weights and rooms positive."""
    above, slack = _rooms(problem, weights)
    values = np.concatenate([weights, above, slack])
    moves = np.concatenate([move, -move, -problem.rows @ move])
    shrinking = moves < 0
    return float(np.min(-values[shrinking] / moves[shrinking], initial=np.inf))


def _moved(
    problem: ScaledProblem, point: _Point, move: _Point, weights: Array, length: float, mu: float
) -> _Point:
    """Return the next point, its duals positive and not too far from mu over their primals."""
    above, slack = _rooms(problem, weights)

    def dual(old: Array, new: Array, primal: Array) -> Array:
        step = np.maximum(old + length * (new - old), (1 - _TO_BOUNDARY) * old)
        return np.clip(step, mu / (_TRUST * primal), _TRUST * mu / primal)

    return _Point(
        weights,
        dual(point.lower, move.lower, weights),
        dual(point.upper, move.upper, above),
        dual(point.rows, move.rows, slack),
    )
