"""Designs over a few candidates as convex problems stated in cvxpy.

Two statements of the same problem. The primal has the weights as variables. The dual (for D that
of Wernholt and Loefberg 2007) has one matrix W_j for each term of the objective,

    maximise  log polar(W) - sum_j tr(W_j M_0) - b'y + 1
    subject to  sum_j tr(W_j H_ij) <= (R'y)_i,  y >= 0,

and the weights are the multipliers of its constraints. It takes objectives of one group.
"""

import warnings
from typing import Any

import numpy as np

from oed.design.inner_problem import InnerAnswer, InnerProblem
from oed.design.matrix_means import MatrixMean
from robotmodels.arrays import Array
from robotmodels.errors import SolverFailed

# With looser tolerances Clarabel stops at gaps of 1e-5.
_CLARABEL = {"tol_gap_abs": 1e-11, "tol_gap_rel": 1e-11, "tol_feas": 1e-11, "max_iter": 200}
_SCS = {"eps": 1e-9, "max_iters": 50_000}


def conic(problem: InnerProblem, form: str = "dual") -> InnerAnswer:
    """Return the design by Clarabel, or by SCS where Clarabel gives no answer.

    Parameters
    ----------
    problem : its objective needs a single group for the dual form.
    form : "primal" or "dual".

    Raises
    ------
    SolverFailed : with both reasons, if neither solver gives an answer.
    """
    import cvxpy

    cp: Any = cvxpy  # what it exports by star imports has no types
    state = _primal if form == "primal" or len(problem.objective.groups) > 1 else _dual
    statement, read = state(cp, problem)
    reasons = []
    for name, options in (("CLARABEL", _CLARABEL), ("SCS", _SCS)):
        reason = _solved(cp, statement, name, options)
        if reason is None:
            weights, rows, witness = read()
            return InnerAnswer(
                np.maximum(weights, 0.0), np.maximum(rows, 0.0), witness, f"cvxpy, {name.lower()}"
            )
        reasons.append(f"{name}: {reason}")
    raise SolverFailed(f'optimal design: {"; ".join(reasons)}; try solver="newton"')


def _solved(cp: Any, statement: Any, name: str, options: dict[str, Any]) -> str | None:
    """Solve; return why there is no answer, or None."""
    try:
        with warnings.catch_warnings():
            # Inaccurate answers are certified like any other.
            warnings.simplefilter("ignore", UserWarning)
            statement.solve(solver=name, **options)
    except cp.SolverError as error:
        return str(error).splitlines()[0]
    return None if statement.status in ("optimal", "optimal_inaccurate") else str(statement.status)


def _primal(cp: Any, problem: InnerProblem) -> tuple[Any, Any]:
    n = problem.rows.shape[1]
    w = cp.Variable(n, nonneg=True)
    limits = problem.rows @ w <= problem.bounds
    information = [_sum(cp, M, H, w) for M, H in zip(problem.base, problem.matrices, strict=True)]
    constraints, duals, groups = [limits], [], []
    for group in problem.objective.groups:
        value = 0.0
        for term in group:
            more, log, dual = _log_mean(cp, term.mean, information[term.sample])
            constraints += more
            duals.append(dual)
            value = value + term.share * log
        groups.append(value)
    if len(groups) == 1:
        goal, order = groups[0], []
    else:
        goal = cp.Variable()
        references = problem.objective.log_references
        order = [v - r >= goal for v, r in zip(groups, references, strict=True)]
    statement = cp.Problem(cp.Maximize(goal), constraints + order)

    def read() -> tuple[Array, Array, tuple[Array, ...]]:
        weights = np.maximum(w.value, 1e-12)
        shares = np.array([float(c.dual_value) for c in order]) if order else np.ones(1)
        shares = np.maximum(shares, 0.0) / np.maximum(shares, 0.0).sum()
        smooth = problem.objective.witness(problem.information(weights), shares)
        witness = tuple(
            W if dual is None else _symmetric(dual.dual_value)
            for W, dual in zip(smooth, duals, strict=True)
        )
        return w.value, limits.dual_value, witness

    return statement, read


def _log_mean(cp: Any, mean: MatrixMean, information: Any) -> tuple[list[Any], Any, Any]:
    """Return constraints, the logarithm of a mean, and the constraint whose dual is its slope.

    det(C)^(-1): det of the largest S with M >= B S B'; 1/tr C: the largest s with
    [[M, s B], [s B', V]] >= 0, tr V <= s; E: the largest s with M >= s B B'.
    """
    B = mean.combinations
    p, m = information.shape[0], information.shape[0] if B is None else B.shape[1]
    if mean.kind == "D":
        if B is None:
            return [], cp.log_det(information) / p + mean.offset, None
        S = cp.Variable((m, m), PSD=True)
        return [information - B @ S @ B.T >> 0], cp.log_det(S) / m + mean.offset, None
    B = np.eye(p) if B is None else B
    s = cp.Variable()
    if mean.kind == "E":
        above = information - s * (B @ B.T) >> 0
        return [above], cp.log(s) + mean.offset, above
    V = cp.Variable((m, m), symmetric=True)
    block = cp.bmat([[information, s * B], [s * B.T, V]])
    return [block >> 0, cp.trace(V) <= s], cp.log(s) + mean.offset, None


def _dual(cp: Any, problem: InnerProblem) -> tuple[Any, Any]:
    group = problem.objective.groups[0]
    y = cp.Variable(len(problem.bounds), nonneg=True)
    goal = 1.0 - problem.bounds @ y
    constraints, matrices, prices = [], [], 0.0
    for term in group:
        W = cp.Variable(problem.base[term.sample].shape, PSD=True)
        more, log = _log_polar(cp, term.mean, W)
        constraints += more
        matrices.append(W)
        goal = goal + term.share * (log - np.log(term.share))
        goal = goal - cp.trace(W @ problem.base[term.sample])
        H = problem.matrices[term.sample]
        prices = prices + H.reshape(len(H), -1) @ cp.vec(W, order="C")
    limits = prices <= problem.rows.T @ y
    statement = cp.Problem(cp.Maximize(goal), [limits, *constraints])

    def read() -> tuple[Array, Array, tuple[Array, ...]]:
        return limits.dual_value, y.value, tuple(_symmetric(W.value) for W in matrices)

    return statement, read


def _log_polar(cp: Any, mean: MatrixMean, weight: Any) -> tuple[list[Any], Any]:
    """Return constraints and the log of the mean's polar, see `MatrixMean.log_polar`."""
    B = mean.combinations
    inner = weight if B is None else B.T @ weight @ B
    m = inner.shape[0]
    if mean.kind == "D":
        return [], np.log(m) + cp.log_det(inner) / m - mean.offset
    if mean.kind == "E":
        return [], cp.log(cp.trace(inner)) - mean.offset
    # tr X^(1/2) is the largest trace of Y with [[X, Y], [Y', I]] >= 0.
    Y = cp.Variable((m, m))
    block = cp.bmat([[inner, Y], [Y.T, np.eye(m)]])
    return [block >> 0], 2 * cp.log(cp.trace(Y)) - mean.offset


def _sum(cp: Any, base: Array, matrices: Array, weights: Any) -> Any:
    n, p = matrices.shape[:2]
    total = cp.reshape(matrices.reshape(n, -1).T @ weights, (p, p), order="C")
    return base + total


def _symmetric(matrix: Array) -> Array:
    """Return the nearest positive semidefinite matrix."""
    eigenvalues, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return np.asarray((vectors * np.maximum(eigenvalues, 0.0)) @ vectors.T)
