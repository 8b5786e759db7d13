"""The best spectral matrices of one position for given prices, and bounds on all of them.

Largest sum_k tr(P_k X_k) over Hermitian X_k >= 0 of lines k, in units of the motors' torques: of
every motor i sum_k (X_k)_ii <= 1, of every limited motion j sum_k s_jk X_k s_jk^H <= 1, and of
every line tr X_k <= cap. For any multipliers y >= 0 of the rows it is at most

    sum_r y_r + cap sum_k max(0, largest eigenvalue of P_k - sum_r y_r A_rk),

or diagonal entry, where motors have independent phases. That dual has few variables and no
constraint, so it is cheap to bound; a linear program over vectors u, X_k = sum x u u^H, attains it.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import OptimizeResult, linprog
from scipy.sparse import csr_array, vstack

from robotmodels.common.arrays import Array, ComplexArray, IntArray
from robotmodels.common.errors import SolverFailed

_MOST_PROGRAMS = 60
_CLOSED = 1e-9  # of the value
_SWEEPS = 3
_ATTEMPTS = (("highs", 1e-10), ("highs-ds", 1e-9), ("highs-ipm", 1e-9), ("highs-ipm", 1e-7))


@dataclass(frozen=True)
class SpectralOracle:
    """Limits that all positions share.

    Attributes
    ----------
    cap : float
        Largest trace of a line.
    full : bool
        Whether motors' phases may be chosen, so that matrices are not diagonal.
    accuracy : float
        Largest relative distance of the value from its bound.
    """

    cap: float
    full: bool
    accuracy: float = _CLOSED

    def quick_bounds(self, prices: ComplexArray) -> Array:
        """Return bounds (Q,) for prices (Q, F, n, n), by torques and lines alone.

        Multipliers are lowered one by one to where one more line would pay for itself.
        """
        gains = np.einsum("qfii->qfi", prices).real
        q, f, n = gains.shape
        y, fits = np.zeros((q, n)), min(int(1.0 / self.cap), f - 1)
        for _ in range(_SWEEPS):
            for i in range(n):
                others = np.delete(gains - y[:, None], i, axis=2)
                excess = gains[:, :, i] - np.maximum(others.max(axis=2, initial=0.0), 0.0)
                y[:, i] = np.maximum(np.partition(-excess, fits, axis=1)[:, fits] * -1.0, 0.0)
        reduced = prices - y[:, None, :, None] * np.eye(n)
        return np.asarray(y.sum(axis=1) + self.cap * self._largest(reduced).sum(axis=1))

    def solve(self, prices: ComplexArray, motions: ComplexArray) -> tuple[float, ComplexArray]:
        """Return a bound and the best X, (F, n, n), for prices (F, n, n) and motions (R, F, n).

        Raises
        ------
        SolverFailed
            If HiGHS gives no answer, or the bound is not reached.
        """
        f, n = prices.shape[:2]
        lines, vectors = np.repeat(np.arange(f), n), np.tile(np.eye(n, dtype=complex), (f, 1))
        bound, best = np.inf, np.zeros(n + len(motions))
        for _ in range(_MOST_PROGRAMS):
            try:
                x, y = self._program(prices, motions, lines, vectors)
            except SolverFailed:
                if np.isfinite(bound):
                    break  # HiGHS stalls over many vectors that are nearly equal
                raise
            X = _spectrum(prices.shape, x, lines, vectors)
            # Half way to the best multipliers too: the last ones alone swing from side to side.
            for multipliers in (y, 0.5 * (y + best)) if np.isfinite(bound) else (y,):
                earned, directions = self._earned(prices, motions, multipliers)
                bound, best = min((bound, best), (earned, multipliers), key=_bound)
                lines = np.concatenate([lines, np.arange(len(directions))])
                vectors = np.concatenate([vectors, directions])
            value = float(np.einsum("fij,fji->", prices, X).real)
            if bound <= value * (1 + self.accuracy) or not self.full:
                break
        return bound, X

    def _earned(
        self, prices: ComplexArray, motions: ComplexArray, multipliers: Array
    ) -> tuple[float, ComplexArray]:
        """Return the bound by multipliers, and of full matrices each line's best vector."""
        reduced = prices - _row_matrices(multipliers, motions)
        bound = float(multipliers.sum() + self.cap * self._largest(reduced).sum())
        n = prices.shape[1]
        directions = np.linalg.eigh(reduced)[1][:, :, -1] if self.full else np.zeros((0, n))
        return bound, np.asarray(directions, dtype=complex)

    def _program(
        self, prices: ComplexArray, motions: ComplexArray, lines: IntArray, vectors: ComplexArray
    ) -> tuple[Array, Array]:
        """Return the powers of vectors, and the rows' multipliers."""
        gains = _forms(prices[lines], vectors)
        scale = float(np.abs(gains).max()) or 1.0
        moved = np.abs(np.einsum("rai,ai->ra", motions[:, lines], vectors)) ** 2
        rows = np.concatenate([np.abs(vectors.T) ** 2, moved])
        of_lines = csr_array(
            (np.ones(len(lines)), (lines, np.arange(len(lines)))), (len(prices), len(lines))
        )
        bounds = np.concatenate([np.ones(len(rows)), np.full(len(prices), self.cap)])
        solution = _solved(-gains / scale, vstack([csr_array(rows), of_lines]), bounds)
        multipliers = np.maximum(-scale * solution.ineqlin.marginals, 0.0)
        x = np.maximum(solution.x, 0.0)
        # What HiGHS exceeds within its tolerance is taken back.
        x /= max(1.0, float((rows @ x).max()), float((of_lines @ x).max()) / self.cap)
        return x, multipliers[: len(rows)]

    def _largest(self, matrices: ComplexArray) -> Array:
        """Return what a unit of power earns at most, not negative, (..., F)."""
        if self.full:
            return np.asarray(np.maximum(np.linalg.eigvalsh(matrices)[..., -1], 0.0))
        diagonals = np.einsum("...ii->...i", matrices).real
        return np.asarray(np.maximum(diagonals.max(axis=-1), 0.0))


def _solved(costs: Array, rows: csr_array, bounds: Array) -> OptimizeResult:
    """Return the answer of HiGHS, which at times has none to its tightest tolerances.

    Looser ones are rigorous too: bounds are of multipliers, and powers are scaled to the limits.
    """
    for method, tolerance in _ATTEMPTS:
        options = dict.fromkeys(
            ("primal_feasibility_tolerance", "dual_feasibility_tolerance"), tolerance
        )
        solution = linprog(costs, A_ub=rows, b_ub=bounds, method=method, options=options)
        if solution.x is not None:
            return solution
    raise SolverFailed(f"optimal spectra: HiGHS: {solution.message}")


def _forms(matrices: ComplexArray, vectors: ComplexArray) -> Array:
    """Return u^H P u, (a,), of matrices (a, n, n) and vectors (a, n)."""
    moved = np.einsum("aij,aj->ai", matrices, vectors)
    return np.asarray(np.sum(vectors.conj() * moved, axis=1).real)


def _spectrum(
    shape: tuple[int, ...], powers: Array, lines: IntArray, vectors: ComplexArray
) -> ComplexArray:
    """Return X_k, the sum of x u u^H over the vectors of each line."""
    X = np.zeros(shape, dtype=complex)
    np.add.at(X, lines, powers[:, None, None] * vectors[:, :, None] * vectors[:, None, :].conj())
    return X


def _row_matrices(multipliers: Array, motions: ComplexArray) -> ComplexArray:
    """Return sum_r y_r A_rk, (F, n, n), of torques and motions (R, F, n)."""
    n = motions.shape[2]
    moved = np.einsum("r,rfi,rfj->fij", multipliers[n:], motions.conj(), motions, optimize=True)
    return np.asarray(moved + np.diag(multipliers[:n]))


def _bound(pair: tuple[float, Array]) -> float:
    return pair[0]
