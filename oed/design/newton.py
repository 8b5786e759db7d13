"""A primal-dual interior-point method for designs of smooth criteria over a few candidates.

It maximises t subject to v_g(w) >= t for each group's log value v_g, w >= 0 and R w <= b. Its
systems have one row for each candidate; whitened problems take 15 to 30 steps.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from oed.design.inner_problem import InnerAnswer, InnerProblem
from robotmodels.arrays import Array
from robotmodels.errors import SolverFailed

_MAX_STEPS = 100
# Steps without progress, which end the search: rounding allows no more.
_PATIENCE = 12
_TO_BOUNDARY = 0.995


@dataclass(frozen=True, eq=False)
class _Point:
    """Variables, and the pairs of which products go to zero.

    inside: candidates' weights, the rows' slacks and the groups' slacks, above zero; outside: their
    multipliers. `level` is t.
    """

    inside: Array
    outside: Array
    level: float

    def moved(self, step: "_Point", length: float) -> "_Point":
        return _Point(
            self.inside + length * step.inside,
            self.outside + length * step.outside,
            self.level + length * step.level,
        )


@dataclass(frozen=True, eq=False)
class _Model:
    """The groups' log values (G,), slopes (G, n), the Hessian (n, n) and what is left to solve."""

    hessian: Array
    slopes: Array
    dual: Array
    rows: Array
    groups: Array
    balance: float

    @property
    def error(self) -> float:
        return float(
            max(
                np.abs(self.dual).max(),
                np.abs(self.rows).max(initial=0.0),
                np.abs(self.groups).max(),
                abs(self.balance),
            )
        )


def newton(problem: InnerProblem, tolerance: float) -> InnerAnswer:
    """Return a design whose log value is within about `tolerance` of the best.

    Raises
    ------
    SolverFailed : if it cannot go on; a certificate tells how good an answer is.
    """
    point = _start(problem)
    model = _model(problem, point)
    best, since, careful = (np.inf, point), 0, False
    for _ in range(_MAX_STEPS):
        products = float(point.inside @ point.outside)
        merit = max(products, model.error)
        if merit < best[0]:
            best, since = (merit, point), 0
        since += 1
        if merit <= tolerance or since > _PATIENCE:
            break
        try:
            step = _direction(problem, point, model, careful)
            point, model, careful = _advance(problem, point, step, model)
        except np.linalg.LinAlgError:
            break
    merit, point = best
    if not merit <= 1e-3:
        raise SolverFailed(f"interior-point method stopped {merit:.1g} from its goal")
    n, m = problem.rows.shape[1], len(problem.rows)
    multipliers = point.outside[n + m :] / point.outside[n + m :].sum()
    information = problem.information(point.inside[:n])
    witness = problem.objective.witness(information, multipliers)
    return InnerAnswer(point.inside[:n], point.outside[n : n + m], witness, "newton")


def _start(problem: InnerProblem) -> _Point:
    n, m, groups = problem.rows.shape[1], len(problem.rows), len(problem.objective.groups)
    # Equal weights, as large as every row with room for them allows.
    use = problem.rows.sum(axis=1)
    room = (problem.bounds > 0) & (use > 0)
    size = float(np.min(problem.bounds[room] / use[room], initial=np.inf))
    size = 0.9 * size if np.isfinite(size) else 1.0 / n
    slack = problem.bounds - use * size
    scale = np.maximum(np.abs(problem.bounds), size)
    slack = np.maximum(slack, 0.1 * scale)
    weights = np.full(n, size)
    values = problem.objective.group_values(problem.information(weights))
    level = float(values.min()) - 0.1
    inside = np.concatenate([weights, slack, values - level])
    # About one unit of log value is shared by the products of all pairs.
    target = 1.0 / (n + m + groups)
    outside = np.concatenate([target / weights, target / slack, np.full(groups, 1.0 / groups)])
    return _Point(inside, outside, level)


def _model(problem: InnerProblem, point: _Point) -> _Model:
    n, m = problem.rows.shape[1], len(problem.rows)
    weights, slack, room = np.split(point.inside, [n, n + m])
    z, y, mu = np.split(point.outside, [n, n + m])
    information = problem.information(weights)
    hessian, slopes, values = np.zeros((n, n)), np.zeros((len(mu), n)), np.zeros(len(mu))
    for g, group in enumerate(problem.objective.groups):
        for term in group:
            matrices = problem.matrices[term.sample]
            value, slope, curvature = term.mean.second_order(information[term.sample], matrices)
            values[g] += term.share * value
            slopes[g] += term.share * slope
            hessian -= mu[g] * term.share * curvature
    values -= problem.objective.log_references
    return _Model(
        hessian,
        slopes,
        dual=problem.rows.T @ y - z - mu @ slopes,
        rows=problem.rows @ weights + slack - problem.bounds,
        groups=values - point.level - room,
        balance=1.0 - float(mu.sum()),
    )


def _direction(problem: InnerProblem, point: _Point, model: _Model, careful: bool) -> _Point:
    """Return Mehrotra's step: one without centring says how much centring is needed.

    After a step that had to be shortened, a `careful` one: well centred and not corrected.
    """
    system = _Linearised.at(problem, point, model)
    products = point.inside * point.outside
    if careful:
        return system.step(0.5 * products.mean() - products)
    straight = system.step(-products)
    length = _longest(point, straight)
    left = point.moved(straight, length)
    mean = products.mean()
    centring = (float(left.inside @ left.outside) / products.sum()) ** 3
    return system.step(centring * mean - products - straight.inside * straight.outside)


@dataclass(frozen=True, eq=False)
class _Linearised:
    """The conditions of optimality, linearised: moves of weights, level and the multipliers.

    The rows' and groups' multipliers are not eliminated: active rows would swamp the curvature.
    `factor` is that of the symmetric system scaled by s.
    """

    problem: InnerProblem
    point: _Point
    model: _Model
    scale: Array
    factor: Any

    @classmethod
    def at(cls, problem: InnerProblem, point: _Point, model: _Model) -> "_Linearised":
        n, m = problem.rows.shape[1], len(problem.rows)
        size = n + 1 + m + len(model.slopes)
        system = np.zeros((size, size))
        system[:n, :n] = model.hessian
        system[np.arange(n), np.arange(n)] += point.outside[:n] / point.inside[:n]
        system[n + 1 : n + 1 + m, :n] = problem.rows
        system[n + 1 + m :, :n] = -model.slopes
        system[n + 1 + m :, n] = 1.0
        system[:n, n + 1 :] = system[n + 1 :, :n].T
        system[n, n + 1 + m :] = 1.0
        tail = np.arange(n + 1, size)
        system[tail, tail] = -point.inside[n:] / point.outside[n:]
        # Unit diagonal: the weights that vanish have huge entries.
        s = np.ones(size)
        s[:n] = 1.0 / np.sqrt(np.diagonal(system)[:n])
        factor = lu_factor(s[:, None] * system * s, check_finite=False)
        return cls(problem, point, model, s, factor)

    def step(self, products: Array) -> _Point:
        """Return the step that changes the products of the pairs by `products`."""
        point, model, rows = self.point, self.model, self.problem.rows
        n, m = rows.shape[1], len(rows)
        right = np.empty(len(self.scale))
        right[:n] = products[:n] / point.inside[:n] - model.dual
        right[n] = model.balance
        right[n + 1 :] = -products[n:] / point.outside[n:]
        right[n + 1 : n + 1 + m] -= model.rows
        right[n + 1 + m :] += model.groups
        x = self.scale * lu_solve(self.factor, self.scale * right, check_finite=False)
        w, level = x[:n], float(x[n])
        slack = [w, -model.rows - rows @ w, model.slopes @ w - level + model.groups]
        z = (products[:n] - point.outside[:n] * w) / point.inside[:n]
        return _Point(np.concatenate(slack), np.concatenate([z, x[n + 1 :]]), level)


def _longest(point: _Point, step: _Point) -> float:
    """Return the longest step up to 1 that keeps everything positive."""
    values = np.concatenate([point.inside, point.outside])
    moves = np.concatenate([step.inside, step.outside])
    shrinking = moves < 0
    return float(np.min(-values[shrinking] / moves[shrinking], initial=1.0))


def _advance(
    problem: InnerProblem, point: _Point, step: _Point, model: _Model
) -> tuple[_Point, _Model, bool]:
    """Return the next point; a step that makes the residuals worse is shortened, it says then."""
    length = min(1.0, _TO_BOUNDARY * _longest(point, step))
    allowed = 2.0 * max(model.error, float((point.inside * point.outside).mean()))
    for halvings in range(20):
        there = point.moved(step, length)
        try:
            found = _model(problem, there)
        except np.linalg.LinAlgError:
            found = None
        if found is not None and found.error <= allowed:
            return there, found, halvings > 0
        length *= 0.5
    raise np.linalg.LinAlgError("no step makes progress")
