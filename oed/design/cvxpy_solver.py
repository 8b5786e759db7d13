"""Designs over a few candidates as convex problems stated in cvxpy.

Two statements of the same problem. The primal has the weights as variables. The dual (for D that
of Wernholt and Loefberg 2007) has one matrix W_j for each term of the objective,

    maximise  log polar(W) - sum_j tr(W_j M_0) - b'y + 1
    subject to  sum_j tr(W_j H_ij) <= (R'y)_i,  y >= 0,

and the weights are the multipliers of its constraints. It takes objectives of one group.

Where a single mean is maximised, it stands itself for its logarithm, which the solvers like less.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from oed.criteria.matrix_means import MatrixMean
from oed.criteria.objective import Objective, Term
from oed.design.problem import ScaledProblem, SolverAnswer
from robotmodels.common.arrays import Array
from robotmodels.common.errors import SolverFailed, check_word

# Larger determinants are split into smaller ones: cvxpy states one of p rows by a cone of 2p. SCS
# takes more iterations with more cones.
_LARGEST_DETERMINANT = {"scs": 48, "clarabel": 8}
# Columns of the combinations in one cone: more make it large, fewer make too many.
_COLUMNS = 9


@dataclass(frozen=True, eq=False)
class ConicMean:
    """The logarithm of a mean, or of its polar, is power * log(size) + shift.

    Attributes
    ----------
    constraints : sequence of Any
        Constraints that make `size` what it is.
    size : Any
        Concave expression, for D the logarithm itself.
    power, shift : float
        Numbers; power is 0 where `size` is the logarithm already.
    slopes : sequence of Any
        Constraints of which the duals' leading (p, p) blocks sum to the derivative.
    """

    constraints: Sequence[Any]
    size: Any
    power: float
    shift: float
    slopes: Sequence[Any] = ()

    def log(self, cp: Any) -> Any:
        """Return the logarithm, a concave expression."""
        return self.shift + (self.power * cp.log(self.size) if self.power else self.size)


def conic_mean(
    cp: Any, mean: MatrixMean, information: Any, guess: float, largest: int
) -> ConicMean:
    """Return a mean of an affine (p, p) expression.

    det(C)^(-1/m): det(S)^(1/m) of the largest S with M >= B S B'; 1/tr C: the largest s with
    [[M, s B_k], [s B_k', V_k]] >= 0 for all columns B_k of B, sum_k tr V_k <= s; E: the largest s
    with M >= s B B'.

    Parameters
    ----------
    guess : float
        Guess of the mean's logarithm.
    largest : int
        As in `log_det`.
    """
    B = mean.combinations
    p = information.shape[0]
    unit = float(np.exp(guess - mean.offset))
    if mean.kind == "D":
        if B is None:
            more, log = log_det(cp, information, largest)
            return ConicMean(more, log / p, 0.0, mean.offset)
        m = B.shape[1]
        S = cp.Variable((m, m), PSD=True)
        above = information - (unit * B) @ S @ B.T >> 0
        more, log = log_det(cp, S, largest)
        return ConicMean([above, *more], log / m, 0.0, guess, [above])
    B = np.eye(p) if B is None else B
    s = cp.Variable()
    if mean.kind == "E":
        above = information - (unit * s) * (B @ B.T) >> 0
        return ConicMean([above], s, 1.0, guess, [above])
    blocks, total = [], 0.0
    for columns in np.array_split(np.sqrt(unit) * B, -(-B.shape[1] // _COLUMNS), axis=1):
        V = cp.Variable((columns.shape[1],) * 2, symmetric=True)
        blocks.append(cp.bmat([[information, s * columns], [s * columns.T, V]]) >> 0)
        total = total + cp.trace(V)
    return ConicMean([*blocks, total <= s], s, 1.0, guess, blocks)


def conic_polar(cp: Any, mean: MatrixMean, weight: Any, guess: float, largest: int) -> ConicMean:
    """Return a mean's polar, see `MatrixMean.log_polar`.

    Parameters
    ----------
    weight : Any, (p, p)
        Expression, W times the exponential of `guess`.
    guess : float
        Guess of the mean's logarithm.
    largest : int
        As in `log_det`.
    """
    B = mean.combinations
    unit = float(np.exp(0.5 * mean.offset))
    inner = weight if B is None else B.T @ weight @ B
    m = inner.shape[0]
    if mean.kind == "D":
        more, log = log_det(cp, inner, largest)
        return ConicMean(more, log / m, 0.0, float(np.log(m)) - mean.offset - guess)
    if mean.kind == "E":
        return ConicMean([], cp.trace(inner) / unit**2, 1.0, -guess)
    # tr X^(1/2) is the largest trace of Y with [[X, Y], [Y', I]] >= 0.
    Y = cp.Variable((m, m))
    block = cp.bmat([[inner / unit**2, Y], [Y.T, np.eye(m)]])
    return ConicMean([block >> 0], cp.trace(Y), 2.0, -guess)


def log_det(cp: Any, matrix: Any, largest: int) -> tuple[list[Any], Any]:
    """Return constraints and the log determinant of a symmetric (p, p) expression.

    One of more than `largest` rows is split:
    det X = det A det S with A the leading block and S its Schur complement, the largest matrix that
    may be taken from the other diagonal block: one cone of (p, p) and two smaller determinants.
    """
    p = matrix.shape[0]
    if p <= largest:
        return [], cp.log_det(matrix)
    half = p // 2
    S = cp.Variable((p - half, p - half), symmetric=True)
    E = np.eye(p)[:, half:]
    first, log_a = log_det(cp, matrix[:half, :half], largest)
    second, log_s = log_det(cp, S, largest)
    return [matrix - E @ S @ E.T >> 0, *first, *second], log_a + log_s


# In the order in which they are asked. With looser tolerances Clarabel stops at gaps of 1e-5.
_OPTIONS: dict[str, dict[str, Any]] = {
    "scs": {"max_iters": 5_000},
    "clarabel": {"tol_gap_abs": 1e-11, "tol_gap_rel": 1e-11, "tol_feas": 1e-11, "max_iter": 200},
}
# Tolerance of SCS: of the goal, and the least.
_EPS = 1e-2, 1e-9
_FORMS = ("primal", "dual")


@dataclass(frozen=True)
class Cvxpy:
    """A design solver that states the problem in cvxpy.

    Attributes
    ----------
    form : {"primal", "dual"}
        What is stated; maximin criteria are always stated as primal problems.
    solver : {"clarabel", "scs"}, optional
        Conic solver; by default SCS, and Clarabel where its answer is not certified.
    first_goal : float
        Accuracy asked for while candidates are still added, which SCS makes use of; 0 for the final
        one at once.

    Raises
    ------
    InvalidInput
        If the form or the solver is unknown.
    """

    form: str = "primal"
    solver: str | None = None
    first_goal: float = 0.0

    def __post_init__(self) -> None:
        check_word("form", self.form, _FORMS)
        if self.solver is not None:
            check_word("solver", self.solver, _OPTIONS)

    def check(self, objective: Objective) -> None:
        """Take every objective."""

    def each(self) -> "tuple[Cvxpy, ...]":
        """Return the same with one conic solver each, in the order in which they are asked."""
        names = _OPTIONS if self.solver is None else (self.solver,)
        return tuple(replace(self, solver=name) for name in names)

    def solve(
        self, problem: ScaledProblem, goal: float, near: SolverAnswer | None = None
    ) -> SolverAnswer:
        """Return the optimum, by SCS to well below the goal, by Clarabel as precisely as it can.

        Raises
        ------
        SolverFailed
            With the reason of each solver, if none gives an answer.
        """
        import cvxpy

        cp: Any = cvxpy  # what it exports by star imports has no types
        state = _primal if self.form == "primal" or len(problem.objective.groups) > 1 else _dual
        capped = np.flatnonzero(np.isfinite(problem.caps))
        rows = np.concatenate([problem.rows, np.eye(len(problem.caps))[capped]])
        bounds = np.concatenate([problem.bounds, problem.caps[capped]])
        whole = replace(problem, rows=rows, bounds=bounds)
        statement, read = state(cp, whole, _LARGEST_DETERMINANT[self.solver or "scs"])
        reasons = []
        for name in _OPTIONS if self.solver is None else (self.solver,):
            options = _OPTIONS[name] | (
                {"eps": max(_EPS[0] * goal, _EPS[1])} if name == "scs" else {}
            )
            reason = _solved(cp, statement, name.upper(), options)
            if reason is None:
                weights, multipliers, witness = read()
                return SolverAnswer(
                    weights, multipliers[: len(problem.rows)], witness, f"cvxpy, {name}"
                )
            reasons.append(f"{name.upper()}: {reason}")
        raise SolverFailed("; ".join(reasons))


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


def _primal(cp: Any, problem: ScaledProblem, largest: int) -> tuple[Any, Any]:
    w = cp.Variable(problem.rows.shape[1], nonneg=True)
    limits = problem.rows @ w <= problem.bounds
    information = [_sum(cp, M, H, w) for M, H in zip(problem.base, problem.matrices, strict=True)]
    guesses = _guesses(problem)
    groups = [
        [conic_mean(cp, t.mean, information[t.sample], guesses.pop(0), largest) for t in group]
        for group in problem.objective.groups
    ]
    parts = [part for group in groups for part in group]
    goal, order = parts[0].size, []
    if not _single(parts):
        values = [_shared(cp, *pair) for pair in zip(problem.objective.groups, groups, strict=True)]
        goal = values[0]
        if len(groups) > 1:
            goal, references = cp.Variable(), problem.objective.log_references
            order = [v - r >= goal for v, r in zip(values, references, strict=True)]
    constraints = [limits, *(more for part in parts for more in part.constraints), *order]
    statement = cp.Problem(cp.Maximize(goal), constraints)

    def read() -> tuple[Array, Array, tuple[Array, ...]]:
        factor = _factor(parts)
        shares = np.array([max(float(c.dual_value), 0.0) for c in order]) if order else np.ones(1)
        smooth = problem.objective.witness(
            problem.information(np.maximum(w.value, 1e-12)), shares / shares.sum()
        )
        witness = tuple(
            _slope(part, W.shape[0], factor) if part.slopes else W
            for W, part in zip(smooth, parts, strict=True)
        )
        return w.value, factor * limits.dual_value, witness

    return statement, read


def _dual(cp: Any, problem: ScaledProblem, largest: int) -> tuple[Any, Any]:
    group = problem.objective.groups[0]
    y = cp.Variable(len(problem.bounds), nonneg=True)
    parts, matrices, use, derivatives = [], [], problem.bounds @ y, 0.0
    for term, guess in zip(group, _guesses(problem), strict=True):
        base, H = problem.base[term.sample], problem.matrices[term.sample]
        scaled = cp.Variable(base.shape, PSD=True)
        parts.append(conic_polar(cp, term.mean, scaled, guess, largest))
        W = np.exp(-guess) * scaled
        matrices.append(W)
        use = use + cp.trace(W @ base)
        derivatives = derivatives + (np.exp(-guess) * H.reshape(len(H), -1)) @ cp.vec(
            scaled, order="C"
        )
    limits = derivatives <= problem.rows.T @ y
    constraints = [limits, *(more for part in parts for more in part.constraints)]
    if _single(parts):
        statement = cp.Problem(cp.Maximize(parts[0].size), [use <= 1.0, *constraints])
    else:
        shares = sum(term.share * np.log(term.share) for term in group)
        goal = 1.0 - shares + _shared(cp, group, parts) - use
        statement = cp.Problem(cp.Maximize(goal), constraints)

    def read() -> tuple[Array, Array, tuple[Array, ...]]:
        witness = tuple(W.value for W in matrices)
        return _factor(parts) * limits.dual_value, y.value, witness

    return statement, read


def _guesses(problem: ScaledProblem) -> list[float]:
    """Return each term's logarithm at equal weights; zero where that leaves something open."""
    n = problem.rows.shape[1]
    information = problem.information(np.full(n, 1.0 / n))
    logs = [t.mean.log_value(information[t.sample]) for t in problem.objective.terms]
    return [log if np.isfinite(log) else 0.0 for log in logs]


def _single(parts: Sequence[ConicMean]) -> bool:
    """Return whether one mean is all there is, and is no logarithm itself."""
    return len(parts) == 1 and bool(parts[0].power)


def _factor(parts: Sequence[ConicMean]) -> float:
    """Return what makes multipliers of the goal those of the log value."""
    return float(parts[0].power / parts[0].size.value) if _single(parts) else 1.0


def _shared(cp: Any, group: Sequence[Term], parts: Sequence[ConicMean]) -> Any:
    return sum(t.share * part.log(cp) for t, part in zip(group, parts, strict=True))


def _slope(part: ConicMean, p: int, factor: float) -> Array:
    return np.asarray(factor * sum(c.dual_value[:p, :p] for c in part.slopes))


def _sum(cp: Any, base: Array, matrices: Array, weights: Any) -> Any:
    n, p = matrices.shape[:2]
    total = cp.reshape(matrices.reshape(n, -1).T @ weights, (p, p), order="C")
    return base + total
