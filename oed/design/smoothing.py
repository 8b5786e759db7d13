"""Objectives with second derivatives, exact or smoothed by a barrier's mu.

Two kinds are smoothed. The least of several groups' log values v_g is the largest
t + mu sum_g log (v_g - t). The logarithm of the smallest eigenvalue of (B'M^-1 B)^-1 is the largest
log s + mu log det (M - s B B'); mu times the inverse of that matrix is its derivative, and a dual
point.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from oed.criteria.matrix_means import MatrixMean, between
from oed.design.problem import ScaledProblem
from robotmodels.common.arrays import Array


@dataclass(frozen=True, eq=False)
class Smoothed:
    """The smoothed log value at some weights, and what Newton's method needs of it.

    Attributes
    ----------
    value : float
        Value of the objective.
    slopes : ndarray, (G, n)
        Slopes of the groups' values, and their multipliers (G,), which sum to one.
    curvature : ndarray, (n, n)
        Minus the second derivative at these multipliers.
    rooms : ndarray, (G,)
        Rooms of the groups above t.
    sizes : ndarray, (n, k)
        Minus the mixed derivatives by w and by each smoothed eigenvalue's s, and (k,) minus the
        second ones by s.
    """

    value: float
    slopes: Array
    multipliers: Array
    curvature: Array
    rooms: Array
    mixed: Array
    sizes: Array

    @property
    def gradient(self) -> Array:
        """The value's derivative by the weights, (n,)."""
        return np.asarray(self.multipliers @ self.slopes)


def smoothed(problem: ScaledProblem, weights: Array, mu: float) -> Smoothed:
    """Return the log value at positive weights (n,), and its derivatives.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the information is not positive definite.
    """
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
    curvature, mixed, sizes = np.zeros((n, n)), [], []
    for g, share, part in parts:
        factor = multipliers[g] * share
        curvature += factor * part.curvature
        if part.mixed is not None:
            mixed.append(factor * part.mixed)
            sizes.append(factor * part.size)
    return Smoothed(
        value,
        slopes,
        multipliers,
        curvature,
        rooms,
        np.array(mixed).reshape(-1, n).T,
        np.array(sizes),
    )


def smoothed_value(problem: ScaledProblem, weights: Array, mu: float) -> float:
    """Return the value of `smoothed` alone."""
    objective, information = problem.objective, problem.information(weights)
    values = [
        sum(t.share * _value(t.mean, information[t.sample], mu / t.share) for t in group)
        for group in objective.groups
    ]
    return _least(np.array(values) - objective.log_references, mu)[0]


@dataclass(frozen=True, eq=False)
class _Term:
    value: float
    slopes: Array
    curvature: Array
    mixed: Array | None = None
    size: float = 0.0


def _term(mean: MatrixMean, information: Array, matrices: Array, mu: float) -> _Term:
    """Return one mean's logarithm, smoothed by mu if it is that of the smallest eigenvalue."""
    if mean.kind != "E":
        value, slopes, curvature = mean.second_order(information, matrices)
        return _Term(value, slopes, -curvature)
    T, U, ratios, largest, log_det = _spectrum(mean, information)
    s, remainders = _largest_size(ratios, mu)
    G = _dual_root(T, U, remainders)
    white = between(G.T, matrices, G)
    flat = white.reshape(len(white), -1)
    inner = s * ratios / remainders  # of G's columns along B, times s
    k = len(ratios)
    diagonal = np.einsum("ijj->ij", white)
    value = np.log(s) - np.log(largest) + mu * (log_det + float(np.log(remainders).sum()))
    return _Term(
        float(value),
        mu * diagonal.sum(axis=1),
        mu * flat @ flat.T,
        -mu * diagonal[:, :k] @ inner,
        float(1.0 + mu * (inner**2).sum()),
    )


def smoothed_witness(
    problem: ScaledProblem, weights: Array, mu: float, multipliers: Array
) -> tuple[Array, ...]:
    """Return the derivative of each term by the information, at the groups' multipliers (G,)."""
    information, witness = problem.information(weights), []
    for group, factor in zip(problem.objective.groups, multipliers, strict=True):
        for term in group:
            M = information[term.sample]
            if term.mean.kind != "E":
                witness.append(factor * term.share * term.mean.log_gradient(M))
                continue
            T, U, ratios, _, _ = _spectrum(term.mean, M)
            G = _dual_root(T, U, _largest_size(ratios, mu / term.share)[1])
            witness.append(factor * mu * G @ G.T)
    return tuple(witness)


def _dual_root(inverse_root: Array, basis: Array, remainders: Array) -> Array:
    """Return G with G G' the inverse of M - s B B', of `_spectrum` and 1 - s l."""
    columns = [basis / np.sqrt(remainders), _complement(basis)]
    return np.asarray(inverse_root.T @ np.concatenate(columns, axis=1))


def _value(mean: MatrixMean, information: Array, mu: float) -> float:
    """Return the value of `_term` alone."""
    if mean.kind != "E":
        return mean.log_value(information)
    _, _, ratios, largest, log_det = _spectrum(mean, information)
    s, remainders = _largest_size(ratios, mu)
    return float(np.log(s) - np.log(largest) + mu * (log_det + float(np.log(remainders).sum())))


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
        remainders = (1.0 - ratios) + d * ratios
        s = 1.0 - d
        excess = mu * float((s * ratios / remainders).sum()) - 1.0
        if excess > 0:
            low = d
        else:
            high = d
        slope = -mu * float((ratios / remainders + s * ratios**2 / remainders**2).sum())
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
