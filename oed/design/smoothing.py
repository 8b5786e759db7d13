"""Objectives with second derivatives, exact or smoothed by a barrier's mu.

Two kinds are smoothed. The least of several groups' log values v_g is the largest
t + mu sum_g log (v_g - t). The logarithm of the smallest eigenvalue of (B'M^-1 B)^-1 is the largest
log s + mu log det (M - s B B'); mu times the inverse of that matrix is its derivative, and a dual
point.
"""

from collections.abc import Sequence
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
    parts = _terms(problem, information, mu)
    values = objective.shared(np.array([part.value for part in parts]))
    slopes = objective.shared(np.array([part.slopes for part in parts]).T).T
    value, rooms = _least(values - objective.log_references, mu)
    multipliers = mu / rooms if groups > 1 else np.ones(1)
    factors = multipliers[objective.owners] * objective.shares
    curvature, mixed, sizes = np.zeros((n, n)), [], []
    for indices in objective.by_sample.values():
        roots = [
            (np.sqrt(factors[i]) * parts[i].plus, np.sqrt(factors[i]) * parts[i].minus)
            for i in indices
        ]
        plus, minus = (np.concatenate(each, axis=1) for each in zip(*roots, strict=True))
        curvature += plus @ plus.T - minus @ minus.T
    for factor, part in zip(factors, parts, strict=True):
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
    if objective.smooth:
        values = objective.group_values(information)
    else:
        terms = objective.terms
        logs = [_value(t.mean, information[t.sample], mu / t.share) for t in terms]
        values = objective.shared(np.array(logs))
    return _least(values - objective.log_references, mu)[0]


@dataclass(frozen=True, eq=False)
class _Term:
    """A mean's logarithm and its slopes (n,), minus the second derivative P P' - N N'."""

    value: float
    slopes: Array
    plus: Array
    minus: Array
    mixed: Array | None = None
    size: float = 0.0


def _terms(problem: ScaledProblem, information: Sequence[Array], mu: float) -> list[_Term]:
    """Return all terms; the means of a sample that are not smoothed share its factorisation."""
    terms = problem.objective.terms
    parts: dict[int, _Term] = {}
    for k, indices in problem.objective.by_sample.items():
        M, H = information[k], problem.matrices[k]
        exact = [i for i in indices if terms[i].mean.kind != "E"]
        parts |= dict(zip(exact, _exact([terms[i].mean for i in exact], M, H), strict=True))
        for i in set(indices) - set(exact):
            parts[i] = _smallest_eigenvalue(terms[i].mean, M, H, mu / terms[i].share)
    return [parts[i] for i in range(len(terms))]


def _exact(means: Sequence[MatrixMean], information: Array, matrices: Array) -> list[_Term]:
    """Return means that have second derivatives, for well scaled M."""
    if not means:
        return []
    L = np.linalg.cholesky(information)
    T = solve_triangular(L, np.eye(len(L)), lower=True, check_finite=False)
    values, roots = zip(*(mean.gradient_root(T) for mean in means), strict=True)
    halves = between(T, matrices, T.T @ np.concatenate(roots, axis=1))
    ends = np.cumsum([Z.shape[1] for Z in roots])[:-1]
    parts = []
    for mean, value, Z, half in zip(
        means, values, roots, np.split(halves, ends, axis=2), strict=True
    ):
        slopes = half.reshape(len(half), -1) @ Z.ravel()
        parts.append(_Term(value, slopes, *mean.curvature_roots(half, Z)))
    return parts


def _smallest_eigenvalue(mean: MatrixMean, information: Array, matrices: Array, mu: float) -> _Term:
    """Return the logarithm of E's smallest eigenvalue, smoothed by mu."""
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
        np.sqrt(mu) * flat,
        np.zeros((len(flat), 0)),
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
