"""A barrier method for designs over a few candidates, whatever is singular at the optimum.

It maximises, for a falling mu,

    log value(w) + mu [ sum_i log w_i + sum_i log (u_i - w_i) + sum_j log (b - R w)_j ]

by Newton's method with primal-dual scaling and a line search, and stops at a positive mu. Weights
are then positive, mu over what each candidate costs above its price: the information stays regular,
its derivative is unique, and the gap, (n + m) mu, follows from the weights alone.

Two kinds of objective are smoothed by the same mu. The least of several groups' log values v_g is
the largest t + mu sum_g log (v_g - t). The logarithm of the smallest eigenvalue of (B'M^-1 B)^-1 is
the largest log s + mu log det (M - s B B').
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import lu_factor, lu_solve, solve_triangular

from oed.design.matrix_means import MatrixMean, between
from oed.design.white_problem import Answer, WhiteProblem
from robotmodels.arrays import Array
from robotmodels.errors import SolverFailed

_MOST_STEPS = 60  # for one mu
_TO_BOUNDARY = 0.99
_ARMIJO = 1e-4
# Where a step promises less than this part of mu, Newton's method converges without a line search;
# less than the others, it has converged: well enough to go on, or so that multipliers, too, which
# have the root of this relative error, are precise.
_CLOSE, _CENTRED, _CONVERGED = 0.1, 1e-2, 1e-13
# Duals stay within this factor of mu over their primals.
_TRUST = 1e6
_SHARE_OF_GOAL = 0.15


@dataclass(frozen=True, eq=False)
class _Smooth:
    """The smoothed log value at some weights, and what Newton's method needs of it.

    Attributes
    ----------
    value : of the objective.
    slopes : (G, n) of the groups' values, and their multipliers (G,), which sum to one.
    curvature : (n, n) minus the second derivative at these multipliers.
    rooms : (G,) of the groups above t.
    sizes : (n, k) minus the mixed derivatives by w and by each smoothed eigenvalue's s, and (k,)
        minus the second ones by s.
    witness : of each term.
    """

    value: float
    slopes: Array
    multipliers: Array
    curvature: Array
    rooms: Array
    mixed: Array
    sizes: Array
    witness: tuple[Array, ...]

    @property
    def gradient(self) -> Array:
        return np.asarray(self.multipliers @ self.slopes)


@dataclass(frozen=True, eq=False)
class _Point:
    """Weights and the duals of weights, caps and rows, all positive."""

    weights: Array
    lower: Array
    upper: Array
    rows: Array


def barrier(problem: WhiteProblem, goal: float) -> Answer:
    """Return a design whose log value is within about a fifth of `goal` of the best.

    Raises
    ------
    SolverFailed : if it cannot go on; a certificate tells how good an answer is.
    """
    n, m = problem.rows.shape[1], len(problem.rows)
    plain = problem.objective.smooth and len(problem.objective.groups) == 1
    pairs = n + m + int(np.isfinite(problem.caps).sum()) + len(problem.objective.groups)
    pairs += sum(len(problem.base[t.sample]) for t in problem.objective.terms if t.mean.kind == "E")
    last = _SHARE_OF_GOAL * goal / pairs
    mu = max(1.0 / pairs, last)
    point = _centred(problem, problem.start, mu)
    try:
        while True:
            point, model = _newton(problem, point, mu, _CENTRED if mu > last else _CONVERGED)
            if mu <= last:
                break
            mu = max(last, min(mu / 5, mu**1.5) if plain else mu / 10)
    except np.linalg.LinAlgError as error:
        raise SolverFailed(f"barrier method: {error} at mu {mu:.1g}") from error
    return Answer(point.weights, point.rows, model.witness, "newton")


def _newton(
    problem: WhiteProblem, point: _Point, mu: float, least: float
) -> tuple[_Point, _Smooth]:
    """Return the point of the central path at mu, or as near to it as rounding lets come.

    Steps end where the next one promises less than `least` of mu.
    """
    model = _model(problem, point.weights, mu)
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
        model, value = _model(problem, weights, mu), there
    return point, model


def _rooms(problem: WhiteProblem, weights: Array) -> tuple[Array, Array]:
    """Return what caps (n,) and rows (m,) leave."""
    return problem.caps - weights, problem.bounds - problem.rows @ weights


def _centred(problem: WhiteProblem, weights: Array, mu: float) -> _Point:
    above, slack = _rooms(problem, weights)
    if not (min(weights.min(), above.min(), slack.min()) > 0):
        raise SolverFailed("barrier method: no room between the constraints")
    return _Point(weights, mu / weights, mu / above, mu / slack)


def _merit(problem: WhiteProblem, weights: Array, mu: float) -> float:
    """Return the function that is maximised at mu; -inf outside."""
    above, slack = _rooms(problem, weights)
    if not (min(weights.min(), above.min(), slack.min()) > 0):
        return -np.inf
    information = problem.information(weights)
    try:
        values = [
            sum(t.share * _value(t.mean, information[t.sample], mu / t.share) for t in group)
            for group in problem.objective.groups
        ]
    except np.linalg.LinAlgError:
        return -np.inf
    value = _least(np.array(values) - problem.objective.log_references, mu)[0]
    capped = above[np.isfinite(above)]
    return value + mu * float(np.log(weights).sum() + np.log(capped).sum() + np.log(slack).sum())


def _direction(
    problem: WhiteProblem, point: _Point, model: _Smooth, mu: float
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


def _longest(problem: WhiteProblem, weights: Array, move: Array) -> float:
    """Return the longest step that keeps weights and rooms positive."""
    above, slack = _rooms(problem, weights)
    values = np.concatenate([weights, above, slack])
    moves = np.concatenate([move, -move, -problem.rows @ move])
    shrinking = moves < 0
    return float(np.min(-values[shrinking] / moves[shrinking], initial=np.inf))


def _moved(
    problem: WhiteProblem, point: _Point, move: _Point, weights: Array, length: float, mu: float
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


def _model(problem: WhiteProblem, weights: Array, mu: float) -> _Smooth:
    objective, information = problem.objective, problem.information(weights)
    n, groups = len(weights), len(objective.groups)
    values, slopes, parts = np.zeros(groups), np.zeros((groups, n)), []
    for g, group in enumerate(objective.groups):
        for term in group:
            M, H = information[term.sample], problem.matrices[term.sample]
            part = _term(term.mean, M, H, mu / term.share)
            values[g] += term.share * part.value
            slopes[g] += term.share * part.slopes
            parts.append((g, term.share, part))
    value, rooms = _least(values - objective.log_references, mu)
    multipliers = mu / rooms if groups > 1 else np.ones(1)
    curvature, mixed, sizes, witness = np.zeros((n, n)), [], [], []
    for g, share, part in parts:
        factor = multipliers[g] * share
        curvature += factor * part.curvature
        witness.append(factor * part.witness)
        if part.mixed is not None:
            mixed.append(factor * part.mixed)
            sizes.append(factor * part.size)
    return _Smooth(
        value,
        slopes,
        multipliers,
        curvature,
        rooms,
        np.array(mixed).reshape(-1, n).T,
        np.array(sizes),
        tuple(witness),
    )


@dataclass(frozen=True, eq=False)
class _Term:
    value: float
    slopes: Array
    curvature: Array
    witness: Array
    mixed: Array | None = None
    size: float = 0.0


def _term(mean: MatrixMean, information: Array, matrices: Array, mu: float) -> _Term:
    """Return one mean's logarithm, smoothed by mu if it is that of the smallest eigenvalue."""
    if mean.kind != "E":
        value, slopes, curvature = mean.second_order(information, matrices)
        return _Term(value, slopes, -curvature, mean.log_gradient(information))
    T, U, ratios, largest, log_det = _spectrum(mean, information)
    s, left = _largest_size(ratios, mu)
    # X = M - s B B': its inverse is G G'.
    G = T.T @ np.concatenate([U / np.sqrt(left), _complement(U)], axis=1)
    white = between(G.T, matrices, G)
    flat = white.reshape(len(white), -1)
    inner = s * ratios / left  # of G's columns along B, times s
    k = len(ratios)
    diagonal = np.einsum("ijj->ij", white)
    value = np.log(s) - np.log(largest) + mu * (log_det + float(np.log(left).sum()))
    return _Term(
        float(value),
        mu * diagonal.sum(axis=1),
        mu * flat @ flat.T,
        mu * G @ G.T,
        -mu * diagonal[:, :k] @ inner,
        float(1.0 + mu * (inner**2).sum()),
    )


def _value(mean: MatrixMean, information: Array, mu: float) -> float:
    """Return the value of `_term` alone."""
    if mean.kind != "E":
        return mean.log_value(information)
    _, _, ratios, largest, log_det = _spectrum(mean, information)
    s, left = _largest_size(ratios, mu)
    return float(np.log(s) - np.log(largest) + mu * (log_det + float(np.log(left).sum())))


def _spectrum(mean: MatrixMean, information: Array) -> tuple[Array, Array, Array, float, float]:
    """Return T with T'T = M^-1, then U, l and c in T B = U sqrt(c l) V', and log det M."""
    L = np.linalg.cholesky(information)
    T = solve_triangular(L, np.eye(len(information)), lower=True, check_finite=False)
    root = T if mean.combinations is None else T @ mean.combinations
    U, sizes, _ = np.linalg.svd(root, full_matrices=False)
    return (
        T,
        U,
        (sizes / sizes[0]) ** 2,
        float(sizes[0] ** 2),
        2 * float(np.log(np.diagonal(L)).sum()),
    )


def _largest_size(ratios: Array, mu: float) -> tuple[float, Array]:
    """Return the s that maximises log s + mu sum_k log (1 - s l_k), and 1 - s l_k; l_0 = 1.

    With d = 1 - s it solves 1 = mu sum_k s l_k / (1 - s l_k), and 1 - s l = (1 - l) + d l.
    """
    d = mu / (1.0 + mu)
    low, high = d, d * len(ratios)
    high = min(high, 1.0)
    for _ in range(100):
        left = (1.0 - ratios) + d * ratios
        s = 1.0 - d
        excess = mu * float((s * ratios / left).sum()) - 1.0
        if excess > 0:
            low = d
        else:
            high = d
        slope = -mu * float((ratios / left + s * ratios**2 / left**2).sum())
        step = d - excess / slope
        following = step if low < step < high else 0.5 * (low + high)
        if abs(following - d) <= 1e-15 * d:
            break
        d = following
    return 1.0 - d, (1.0 - ratios) + d * ratios


def _least(values: Array, mu: float) -> tuple[float, Array]:
    """Return the largest t + mu sum_g log (v_g - t), (G,), and v_g - t there."""
    if len(values) == 1:
        return float(values[0]), np.zeros(1)
    above = values - values.min()
    # sum_g mu / (above_g + d) = 1 for d between mu and G mu.
    low, high = mu, mu * len(values)
    d = low
    for _ in range(100):
        excess = float((mu / (above + d)).sum()) - 1.0
        if excess > 0:
            low = d
        else:
            high = d
        slope = -float((mu / (above + d) ** 2).sum())
        step = d - excess / slope
        following = step if low <= step <= high else 0.5 * (low + high)
        if abs(following - d) <= 1e-15 * d:
            break
        d = following
    rooms = above + d
    return float(values.min() - d + mu * np.log(rooms).sum()), rooms


def _complement(basis: Array) -> Array:
    """Return an orthonormal basis of what the columns of one, (r, k), leave."""
    return np.asarray(np.linalg.qr(basis, mode="complete")[0][:, basis.shape[1] :])
