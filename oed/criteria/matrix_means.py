"""How well an information matrix determines some linear combinations of the parameters.

With C = B' M^-1 B, (m, m), the covariance of B' theta, three functions of the information M are
concave, grow with M and are proportional to it (Pukelsheim 1993, chapters 3 and 6):

    D  det(C)^(-1/m)      A  1 / tr C      E  1 / (largest eigenvalue of C)

Efficiencies are their ratios, their logarithms are what is computed. The polar function of each,
the least tr(W M) where it is one, is a mean of B' W B and turns any W into an upper bound.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.linalg import solve_triangular

from robotmodels.common.arrays import Array
from robotmodels.common.symmetric_matrices import ROUNDING, unit_diagonal_scaling

Kind = Literal["D", "A", "E"]

# Below this a pivot or an eigenvalue of a matrix of unit diagonal is rounding.
_PIVOT = 1e-7
OPEN = 1e-9
"""Largest undetermined part of a unit combination that a singular matrix counts as determining."""


@dataclass(frozen=True, eq=False)
class MatrixMean:
    """One of the three functions for one set of combinations.

    Attributes
    ----------
    kind : Kind
        "D", "A" or "E".
    combinations : ndarray or None, (p, m)
        B; None for every parameter by itself, the identity.
    offset : float
        Added to the logarithm; it keeps D's values when coordinates change.
    """

    kind: Kind
    combinations: Array | None = None
    offset: float = 0.0

    def log_value(self, information: Array) -> float:
        """Return the logarithm for M, (p, p); -inf where M leaves a combination open."""
        half = self._half(information)
        return -np.inf if half is None else self._of_root(half[1])

    def log_value_of_factor(self, factor: Array) -> float:
        """Return the logarithm for M = F F', F (p, k), in units that make M of order one.

        Small weights leave the singular values of F their precision, not the eigenvalues of M.
        """
        U, sizes, _ = np.linalg.svd(factor, full_matrices=False)
        used = sizes > OPEN * sizes[0]
        U, sizes = U[:, used], sizes[used]
        B = np.eye(len(factor)) if self.combinations is None else self.combinations
        inside = U.T @ B
        open_part = np.linalg.norm(B - U @ inside, axis=0)
        if (open_part > OPEN * np.linalg.norm(B, axis=0)).any():
            return -np.inf
        return self._of_root(inside / sizes[:, None])

    def _of_root(self, root: Array) -> float:
        """Return the logarithm for C = root' root."""
        if self.kind == "D":
            return float(-2 * _log_abs_det(root) / root.shape[1]) + self.offset
        size = np.linalg.norm(root) if self.kind == "A" else np.linalg.norm(root, 2)
        return float(-2 * np.log(size)) + self.offset

    def log_gradient(self, information: Array) -> Array:
        """Return W, (p, p), the derivative of the logarithm: tr(W M) = 1, W positive semidefinite.

        Infinite where M leaves a combination open. For E at a multiple eigenvalue it is one of
        many, and of little use as a certificate.
        """
        half = self._half(information)
        if half is None:
            return np.full(information.shape, np.inf)
        inverse_root, root = half
        Y = inverse_root.T @ root
        if self.kind == "D":
            Z = np.linalg.solve(_triangle(root).T, Y.T).T / np.sqrt(root.shape[1])
        elif self.kind == "A":
            Z = Y / np.linalg.norm(root)
        else:
            _, sizes, right = np.linalg.svd(root, full_matrices=False)
            Z = (Y @ right[0] / sizes[0])[:, None]
        return np.asarray(Z @ Z.T)

    def log_polar(self, weight: Array) -> float:
        """Return the logarithm of the least tr(W M) over all M of value one, W (p, p).

        D: m det(B'WB)^(1/m); A: (tr (B'WB)^(1/2))^2; E: tr B'WB. W must be positive
        semidefinite, for else the bound it gives is none.
        """
        inner = weight
        if self.combinations is not None:
            inner = self.combinations.T @ weight @ self.combinations
        m = len(inner)
        if self.kind == "D":
            s = unit_diagonal_scaling(inner)
            if not s.all():
                return -np.inf
            sign, log_det = np.linalg.slogdet(s[:, None] * inner * s)
            value = np.log(m) + (log_det - 2 * np.log(s).sum()) / m if sign > 0 else -np.inf
        elif self.kind == "A":
            roots = np.sqrt(np.maximum(np.linalg.eigvalsh(inner), 0.0))
            value = 2 * np.log(roots.sum()) if roots.any() else -np.inf
        else:
            trace = np.trace(inner)
            value = np.log(trace) if trace > 0 else -np.inf
        return float(value) - self.offset

    def transformed(self, transform: Array) -> "MatrixMean":
        """Return the same function of T M T' for a T, (r, p), that loses nothing of M.

        Its combinations are of order one, whatever the units: an orthonormal basis for D, of norm
        one together for A and E, and never more than r.
        """
        r, p = transform.shape
        B = transform if self.combinations is None else transform @ self.combinations
        if self.kind == "D" and self.combinations is None and r == p:
            shift = 2 * np.linalg.slogdet(transform).logabsdet / p
            return MatrixMean("D", None, self.offset - float(shift))
        if self.kind == "D":
            basis, R = np.linalg.qr(B)
            shift = 2 * np.log(np.abs(np.diagonal(R))).sum() / B.shape[1]
            square = B.shape[1] == r
            return MatrixMean("D", None if square else basis, self.offset - float(shift))
        if B.shape[1] > r:  # tr and the largest eigenvalue of B'M^-1 B depend on B B' only
            B = _triangle(B.T).T
        size = float(np.linalg.norm(B))
        return MatrixMean(self.kind, B / size, self.offset - 2 * np.log(size))

    def second_order(self, information: Array, matrices: Array) -> tuple[float, Array, Array]:
        """Return the logarithm at M, and its first (n,) and second (n, n) derivatives.

        They are taken along `matrices` H_i, (n, p, p), for well scaled M; D and A only. With
        M^-1 = T'T, Y = M^-1 B, C = R'R and Z = Y R^-1 the second ones are

            D: [tr(Z'H_i Z Z'H_j Z) - 2 tr(Z'H_i M^-1 H_j Z)] / m
            A: g_i g_j - 2 tr(Y'H_i M^-1 H_j Y) / tr C

        Raises
        ------
        numpy.linalg.LinAlgError
            If M is not positive definite.
        """
        n, p = matrices.shape[:2]
        L = np.linalg.cholesky(information)
        T = solve_triangular(L, np.eye(p), lower=True, check_finite=False)
        if self.kind == "D" and self.combinations is None:
            white = between(T, matrices, T.T)
            flat = white.reshape(n, -1)
            log_det = 2 * float(np.log(np.diagonal(L)).sum())
            slopes = np.trace(white, axis1=1, axis2=2) / p
            return log_det / p + self.offset, slopes, flat @ flat.T / -p
        root = T if self.combinations is None else T @ self.combinations
        m = root.shape[1]
        if self.kind == "D":
            R = _triangle(root)
            right = np.linalg.solve(R.T, root.T).T
            half = between(T, matrices, T.T @ right)
            flat = half.reshape(n, -1)
            inner = (right.T @ half).reshape(n, -1)
            slopes = inner[:, :: m + 1].sum(axis=1) / m
            value = -2 * _log_abs_det(root) / m + self.offset
            return value, slopes, (inner @ inner.T - 2 * flat @ flat.T) / m
        size = float(np.vdot(root, root))
        flat = between(T, matrices, T.T @ root).reshape(n, -1)
        slopes = flat @ root.ravel() / size
        curvature = np.outer(slopes, slopes) - 2 * flat @ flat.T / size
        return -float(np.log(size)) + self.offset, slopes, curvature

    def _half(self, information: Array) -> tuple[Array, Array] | None:
        """Return S, (r, p), with S'S a generalised inverse of M, and S B; None where B is open."""
        s = unit_diagonal_scaling(information)
        scaled = s[:, None] * information * s
        S = _inverse_root(scaled) if s.all() else None
        if S is None and (self.combinations is None or not s.any()):
            return None
        B = np.eye(len(s)) if self.combinations is None else self.combinations
        if S is None:
            eigenvalues, vectors = np.linalg.eigh(scaled)
            regular = eigenvalues > ROUNDING * eigenvalues[-1]
            # Where a whole diagonal entry is missing only the other parameters can be combined.
            away = np.abs(B[s == 0]).max(initial=0.0) > 0
            units = np.where(s > 0, s, 0.0)[:, None] * B
            open_part = np.linalg.norm(vectors[:, ~regular].T @ units, axis=0)
            if away or (open_part > OPEN * np.linalg.norm(units, axis=0)).any():
                return None
            S = (vectors[:, regular] / np.sqrt(eigenvalues[regular])).T
        S = S * s
        return S, S @ B


def _inverse_root(scaled: Array) -> Array | None:
    """Return L^-1 with L L' the matrix, or None where that is singular."""
    try:
        L = np.linalg.cholesky(scaled)
    except np.linalg.LinAlgError:
        return None
    # A pivot of rounding size is a singular matrix that happened to pass.
    if np.diagonal(L).min() <= _PIVOT:
        return None
    return np.asarray(solve_triangular(L, np.eye(len(L)), lower=True, check_finite=False))


def between(left: Array, matrices: Array, right: Array) -> Array:
    """Return left @ H_i @ right, (n, a, b), as two large products."""
    n, p = matrices.shape[:2]
    products = (matrices.reshape(n * p, p) @ right).reshape(n, p, -1)
    return np.asarray(left @ products)


def _triangle(root: Array) -> Array:
    """Return R with root = Q R."""
    return np.asarray(np.linalg.qr(root, mode="r"))


def _log_abs_det(root: Array) -> float:
    """Return half the log determinant of root' root."""
    with np.errstate(divide="ignore"):
        return float(np.log(np.abs(np.diagonal(_triangle(root)))).sum())
