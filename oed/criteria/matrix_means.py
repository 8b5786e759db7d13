"""How well an information matrix determines some linear combinations of the parameters.

With C = B' M^-1 B, (m, m), the covariance of B' theta, three functions of the information M are
concave, grow with M and are proportional to it (Pukelsheim 1993, chapters 3 and 6):

    D  det(C)^(-1/m)      A  1 / tr C      E  1 / (largest eigenvalue of C)

Efficiencies are their ratios, their logarithms are what is computed. The polar function of each,
the least tr(W M) where it is one, is a mean of B' W B and turns any W into an upper bound.
"""

from collections.abc import Sequence
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

    With $C = B^T M^-1 B$, (m, m): D is $det(C)^(-1/m)$, A is $1 / tr C$, E is $1 / lambda_max(C)$.

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
        return -np.inf if half is None else float(self.log_value_of_root(half[1]))

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
        return float(self.log_value_of_root(inside / sizes[:, None]))

    def log_value_of_root(self, root: Array) -> Array:
        """Return the logarithms for C = root' root, (...), roots (..., r, m)."""
        if self.kind == "D":
            return np.asarray(-2 * _log_abs_det(root) / root.shape[-1] + self.offset)
        size = np.linalg.norm(root, None if self.kind == "A" else 2, axis=(-2, -1))
        return np.asarray(-2 * np.log(size) + self.offset)

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

    def gradient_root(self, inverse_root: Array) -> tuple[float, Array]:
        """Return the logarithm at M, M^-1 = T'T, and Z, (p, m): the derivative is (T'Z)(T'Z)'.

        `inverse_root` is T, (p, p); of D and A only.
        """
        root = inverse_root if self.combinations is None else inverse_root @ self.combinations
        value = float(self.log_value_of_root(root))
        if self.kind == "A":
            return value, root / np.linalg.norm(root)
        m = root.shape[1]
        if self.combinations is None:
            return value, np.eye(m) / np.sqrt(m)
        return value, np.linalg.solve(_triangle(root).T, root.T).T / np.sqrt(m)

    def curvature_roots(self, half: Array, gradient_root: Array) -> tuple[Array, Array]:
        """Return P and N, minus the second derivative along H_i being P P' - N N'.

        With F_i = T H_i T' Z, (n, p, m), the `half`, it is for D and A

            D: 2 tr F_i'F_j - m tr(Z'F_i Z'F_j)      A: 2 tr F_i'F_j - tr Z'F_i tr Z'F_j
        """
        n, m = len(half), gradient_root.shape[1]
        flat = half.reshape(n, -1)
        if self.kind == "D" and self.combinations is None:
            return flat, np.zeros((n, 0))
        if self.kind == "D":
            inner = (gradient_root.T @ half).reshape(n, -1) * np.sqrt(m)
        else:
            inner = (flat @ gradient_root.ravel())[:, None]
        return np.sqrt(2.0) * flat, inner

    def _half(self, information: Array) -> tuple[Array, Array] | None:
        """Return S, (r, p), with S'S a generalised inverse of M, and S B; None where B is open."""
        S = inverse_root(information)
        if S is not None:
            return S, S if self.combinations is None else S @ self.combinations
        s, B = unit_diagonal_scaling(information), self.combinations
        if B is None or not s.any():
            return None
        scaled = s[:, None] * information * s
        eigenvalues, vectors = np.linalg.eigh(scaled)
        regular = eigenvalues > ROUNDING * eigenvalues[-1]
        # Where a whole diagonal entry is missing only the other parameters can be combined.
        away = np.abs(B[s == 0]).max(initial=0.0) > 0
        units = np.where(s > 0, s, 0.0)[:, None] * B
        open_part = np.linalg.norm(vectors[:, ~regular].T @ units, axis=0)
        if away or (open_part > OPEN * np.linalg.norm(units, axis=0)).any():
            return None
        S = (vectors[:, regular] / np.sqrt(eigenvalues[regular])).T * s
        return S, S @ B


def inverse_root(information: Array) -> Array | None:
    """Return T, lower triangular, with T'T the inverse of M, or None where M is singular."""
    s = unit_diagonal_scaling(information)
    if not s.all():
        return None
    try:
        L = np.linalg.cholesky(s[:, None] * information * s)
    except np.linalg.LinAlgError:
        return None
    # A pivot of rounding size is a singular matrix that happened to pass.
    if np.diagonal(L).min() <= _PIVOT:
        return None
    return np.asarray(solve_triangular(L, np.eye(len(L)), lower=True, check_finite=False) * s)


def log_values(means: Sequence[MatrixMean], inverse_root: Array) -> Array:
    """Return the logarithms of several means for the same M, (..., k), M^-1 = T'T, T (..., p, p).

    Variances of single combinations, of which there may be many, are computed together.
    """
    logs = np.empty((*inverse_root.shape[:-2], len(means)))
    single = []
    for i, mean in enumerate(means):
        B = mean.combinations
        if mean.kind == "A" and B is not None and B.shape[1] == 1:
            single.append(i)
        else:
            logs[..., i] = mean.log_value_of_root(inverse_root if B is None else inverse_root @ B)
    if single:
        B = np.concatenate([means[i].combinations for i in single], axis=1)
        variances = ((inverse_root @ B) ** 2).sum(axis=-2)
        logs[..., single] = [means[i].offset for i in single] - np.log(variances)
    return logs


def between(left: Array, matrices: Array, right: Array) -> Array:
    """Return left @ H_i @ right, (n, a, b), as two large products."""
    n, p = matrices.shape[:2]
    products = (matrices.reshape(n * p, p) @ right).reshape(n, p, -1)
    return np.asarray(left @ products)


def _triangle(root: Array) -> Array:
    """Return R with root = Q R."""
    return np.asarray(np.linalg.qr(root, mode="r"))


def _log_abs_det(root: Array) -> Array:
    """Return half the log determinants of root' root, (...), roots (..., r, m)."""
    with np.errstate(divide="ignore"):
        pivots = np.diagonal(_triangle(root), axis1=-2, axis2=-1)
        return np.asarray(np.log(np.abs(pivots)).sum(axis=-1))
