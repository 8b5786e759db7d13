"""The relaxed design: which share of the experiments goes to each candidate position.

Maximising log det sum_i w_i H_i over shares w is convex. Few candidates carry weight, so the
problem is solved on an active set; the equivalence theorem prices all other candidates and says
when none of them could help.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import nnls

from oed.certificate import efficiency_bound, optimality_gap
from oed.criteria import criterion as named_criterion
from oed.criteria import sensitivities
from oed.information_set import InformationSet, unit_diagonal_scaling
from robotmodels.arrays import Array, IntArray, read_only
from robotmodels.errors import InvalidInput, NotIdentifiable, SolverFailed, nearest

# Whitened matrices are of order one; equal ones differ by rounding only.
_DUPLICATE = 1e-9


@dataclass(frozen=True, eq=False)
class Design:
    """Shares of the experiments, with their certificate.

    Attributes
    ----------
    weights : (Q,) shares that sum to one; equal candidates share the first one's place.
    value : criterion of the information per experiment (for D: log det).
    gap : certified over all candidates, see `certificate.optimality_gap`.
    support : indices of the candidates with a positive weight.
    information : (p, p) per experiment, sum_i w_i H_i.
    criterion, names : what was optimised, and for which parameters.
    rounds : active sets solved.
    solver : of the active sets; Newton steps polish its answers.
    """

    weights: Array
    value: float
    gap: float
    support: IntArray
    information: Array
    criterion: str
    names: tuple[str, ...]
    rounds: int
    solver: str

    @property
    def efficiency(self) -> float:
        """Certified lower bound on the efficiency against the true optimum."""
        return efficiency_bound(self.gap)


def optimal_design(
    info: InformationSet,
    criterion: str = "D",
    tolerance: float = 1e-6,
    max_rounds: int = 50,
    solver: str = "clarabel",
) -> Design:
    """Return the shares that maximise the criterion, certified over all candidates.

    Parameters
    ----------
    info : information of each candidate.
    criterion : name of the criterion.
    tolerance : largest certified gap accepted.
    max_rounds : largest number of active sets.
    solver : of the active sets, "clarabel" (by cvxpy) or "newton" (about a hundred times
        faster). Newton steps polish Clarabel's answers.

    Raises
    ------
    NotIdentifiable : naming the parameters, if all candidates together leave a direction open.
    SolverFailed : if the solver gives no answer, or the gap stays above `tolerance`.
    InvalidInput : if criterion or solver are unknown, or the tolerance is not positive.
    """
    chosen = named_criterion(criterion)
    if solver not in _SOLVERS:
        raise InvalidInput(
            f"solver {solver!r} is not known{nearest(solver, _SOLVERS)}; "
            f"there are {', '.join(_SOLVERS)}"
        )
    if not tolerance > 0:
        raise InvalidInput(f"tolerance: {tolerance!r} is not a number > 0")
    open_names = info.unidentifiable()
    if open_names:
        raise NotIdentifiable(
            open_names, "add positions or frequencies, or fix or tie some of these parameters"
        )
    whitened = whiten(info.matrices, info.total / len(info))
    kept = distinct(whitened)
    shares, rounds = _active_set(whitened[kept], tolerance, max_rounds, solver)
    weights = np.zeros(len(info))
    weights[kept] = shares
    # Certified on the given matrices, not on the whitened ones that were searched.
    gap = optimality_gap(weights, info.matrices, criterion)
    if gap > tolerance:
        raise SolverFailed(
            f"optimal design: the certified gap is {gap:.2g} after {rounds} rounds, above the "
            f"tolerance {tolerance:.2g}; allow more rounds or a larger tolerance"
        )
    information = np.tensordot(weights, info.matrices, axes=1)
    return Design(
        weights=read_only(weights),
        value=chosen.value(information),
        gap=gap,
        support=read_only(np.flatnonzero(weights)),
        information=read_only(information),
        criterion=criterion,
        names=info.names,
        rounds=rounds,
        solver=solver,
    )


def whiten(matrices: Array, reference: Array) -> Array:
    """Return T H_i T', (Q, p, p), with T such that T reference T' is the identity.

    D-optimal designs do not change; solvers fail without it (condition numbers of 1e5).
    """
    s = unit_diagonal_scaling(reference)
    L = np.linalg.cholesky(s[:, None] * reference * s)
    T = np.linalg.solve(L, np.diag(s))
    white = T @ matrices @ T.T
    return np.asarray(0.5 * (white + np.swapaxes(white, 1, 2)))


def distinct(matrices: Array) -> IntArray:
    """Return the first index of each group of equal matrices; duplicates only spread weight."""
    flat = matrices.reshape(len(matrices), -1)
    # Equal matrices have equal projections: only neighbours in this order need comparing.
    direction = np.random.default_rng(0).standard_normal(flat.shape[1])
    keys = flat @ (direction / np.linalg.norm(direction))
    order = np.argsort(keys, kind="stable")
    breaks = np.flatnonzero(np.diff(keys[order]) > _DUPLICATE * np.sqrt(flat.shape[1])) + 1
    kept: list[int] = []
    for group in np.split(order, breaks):
        remaining = np.sort(group)
        while len(remaining):
            kept.append(int(remaining[0]))
            away = np.abs(flat[remaining] - flat[remaining[0]]).max(axis=1) > _DUPLICATE
            remaining = remaining[away]
    return np.sort(np.array(kept))


def _active_set(
    matrices: Array, tolerance: float, max_rounds: int, solver: str
) -> tuple[Array, int]:
    """Return shares over whitened candidates (Q, p, p), and the number of rounds."""
    p = matrices.shape[-1]
    active = _first_active(matrices)
    weights = np.zeros(len(matrices))
    for done in range(1, max_rounds + 1):
        start = _SOLVERS[solver](matrices[active], weights[active])
        shares = _newton(matrices[active], start, 1e-2 * tolerance)
        shares[shares < 0.1 * min(tolerance, 1e-6)] = 0.0
        weights = np.zeros(len(matrices))
        weights[active] = shares / shares.sum()
        gradient = named_criterion("D").gradient(np.tensordot(weights, matrices, axes=1))
        excess = sensitivities(gradient, matrices) / p - 1
        # Half the tolerance leaves room for rounding in the certificate on the given matrices.
        violators = np.setdiff1d(np.flatnonzero(excess > 0.5 * tolerance), active)
        if not len(violators):
            return weights, done
        worst = violators[np.argsort(-excess[violators], kind="stable")[: 2 * p]]
        active = np.concatenate([np.flatnonzero(weights), worst])
    return weights, max_rounds


def _first_active(matrices: Array) -> IntArray:
    """Return about 2p whitened candidates of largest trace that identify every parameter."""
    p = matrices.shape[-1]
    traces = np.trace(matrices, axis1=1, axis2=2)
    active = np.argsort(-traces, kind="stable")[: 2 * p]
    while len(active) < len(matrices):
        mean = matrices[active].mean(axis=0)
        if np.linalg.eigvalsh(mean)[0] > 1e-6:
            break
        # What the chosen ones leave open is priced highest.
        price = sensitivities(np.asarray(np.linalg.inv(mean + 1e-6 * np.eye(p))), matrices)
        price[active] = -np.inf
        new = np.argsort(-price, kind="stable")[: min(p, len(matrices) - len(active))]
        active = np.concatenate([active, new])
    return np.asarray(active)


def _clarabel(matrices: Array, _: Array) -> Array:
    """Return shares by cvxpy and Clarabel, which cannot make use of a start.

    Its answers stop at gaps of 1e-6 to 1e-5, and with tolerances of 1e-10 still at 1e-7 to 1e-6,
    so that Newton steps follow in any case. The primal problem takes half the dual's time.
    """
    import cvxpy

    cp: Any = cvxpy  # what it exports by star imports has no types
    n, p = matrices.shape[:2]
    w = cp.Variable(n, nonneg=True)
    information = cp.reshape(matrices.reshape(n, -1).T @ w, (p, p), order="C")
    problem = cp.Problem(cp.Maximize(cp.log_det(information)), [cp.sum(w) == 1])
    try:
        with warnings.catch_warnings():
            # An inaccurate answer is a fine start for the Newton steps and is certified anyway.
            warnings.simplefilter("ignore", UserWarning)
            problem.solve(solver=cp.CLARABEL)
    except cp.SolverError as error:
        raise SolverFailed(f'optimal design: Clarabel failed ({error}); try "newton"') from error
    if w.value is None:
        raise SolverFailed(f'optimal design: Clarabel ended {problem.status}; try "newton"')
    # The Newton steps need a start that identifies every parameter, however inaccurate.
    shares = np.maximum(w.value, 0.0) + 1e-4 / n
    return np.asarray(shares / shares.sum())


def _newton(matrices: Array, weights: Array, tolerance: float, max_steps: int = 100) -> Array:
    """Return shares (n,) of gap <= `tolerance` among `matrices` (n, p, p), if steps suffice.

    Shares that maximise log det M(w) are also the minimum over w >= 0, without the constraint on
    their sum, of -log det M(w) + p/2 (sum w)^2. With H_i whitened by M(w), B = [vec H_1, ...] and
    B w = vec I, the second-order model of that about w is, up to a constant,
    1/2 |B v - 2 vec I|^2 + p/2 (sum v)^2, a nonnegative least-squares problem in v. The function
    is self-concordant, so steps damped by 1/(1 + length) converge from everywhere.
    """
    n, p = matrices.shape[:2]
    rows, columns = np.triu_indices(p)
    twice = np.where(rows == columns, 1.0, np.sqrt(2.0))  # keeps the norm of the half vector
    target = np.append(2.0 * (rows == columns), 0.0)
    for _ in range(max_steps):
        T = np.linalg.inv(np.linalg.cholesky(np.tensordot(weights, matrices, axes=1)))
        white = T @ matrices @ T.T
        if np.trace(white, axis1=1, axis2=2).max() / p - 1 <= tolerance:
            break
        A = np.vstack([(white[:, rows, columns] * twice).T, np.full(n, np.sqrt(p))])
        try:
            better, _ = nnls(A, target, maxiter=50 * n)
        except RuntimeError:  # its iterations ran out; the caller's certificate tells
            break
        length = float(np.linalg.norm(A @ (better - weights)))
        weights = weights + (better - weights) / (1.0 if length < 0.25 else 1.0 + length)
        weights = weights / weights.sum()
    return weights


def _warm_start(matrices: Array, weights: Array) -> Array:
    """Return the last round's shares, equal ones in the first: the Newton steps do the work."""
    return weights if weights.any() else np.full(len(matrices), 1 / len(matrices))


_SOLVERS: dict[str, Callable[[Array, Array], Array]] = {
    "clarabel": _clarabel,
    "newton": _warm_start,
}
