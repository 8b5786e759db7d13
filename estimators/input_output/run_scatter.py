"""How the errors of runs scatter: sizes of whitened errors, their covariance, noise of inputs."""

from dataclasses import replace

import numpy as np

from estimators.input_output.likelihood import Errors, RunLikelihood
from robotmodels.common.arrays import Array, ComplexArray


def expected_square(freedom: Array, m: int) -> Array:
    """Return E|L^-1 e|^2 of one output, nu/(nu - m), for Sigma with nu degrees of freedom."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.where(np.isfinite(freedom), freedom / (freedom - m), 1.0))


def variance_factor(freedom: Array, m: int) -> Array:
    """Return nu^2/((nu + 1 - m)(nu - 1 - m)), by which sampled Sigma enlarge variances.

    By the moments of the complex Wishart law; for m = 1 it is nu/(nu - 2).
    """
    with np.errstate(invalid="ignore"):
        factor = freedom**2 / ((freedom + 1 - m) * (freedom - 1 - m))
    return np.asarray(np.where(np.isfinite(freedom), factor, 1.0))


def square_spread(freedom: Array, m: int, runs: int) -> Array:
    """Return nu (nu - m + E)/((nu - m)^2 - 1), by which sampled Sigma widen sums of |L^-1 e|^2.

    Variances over squared means of the sums over m outputs and E runs of a line, beside those with
    known Sigma: tr(A B^-1) of complex Wishart matrices A and B, by E[B^-1 x B^-1].
    """
    with np.errstate(invalid="ignore"):
        spread = freedom * (freedom - m + runs) / ((freedom - m) ** 2 - 1)
    return np.asarray(np.where(np.isfinite(freedom), spread, 1.0))


def run_correlation(errors: Errors, runs: int) -> ComplexArray:
    """Return the correlations of whitened outputs, (Q, F, m E, m E): runs are independent."""
    std = errors.root
    unit = errors.covariance / (std[..., :, None] * std[..., None, :])
    q, f, m = std.shape
    wide = np.einsum("qfij,ab->qfiajb", unit, np.eye(runs))
    return np.asarray(wide.reshape(q, f, m * runs, m * runs))


def input_scatter(
    likelihood: RunLikelihood, errors: Errors, jacobian: ComplexArray
) -> ComplexArray:
    """Return columns (Q, F, k, p) whose products, see `products`, add up to D.

        D = 2 Re sum tr(Sigma^-1 dG_j C_U0 dG_i^H),  C_U0 = C_UU - A Sigma^-1 A^H

    is what the errors of the estimated inputs add to the scatter of the gradient: the information
    of the estimated inputs has the expectation H + D.
    """
    m, runs = errors.whitened.shape[2:]
    noise = likelihood.data.covariance[..., m:, m:]
    gain = errors.gain
    if likelihood.row_wise:
        gain, noise = gain.swapaxes(-1, -2)[..., None], noise[:, :, None]  # (Q, F, m, n, 1)
    remaining = noise - gain @ np.conj(np.swapaxes(gain, -1, -2))
    values, vectors = np.linalg.eigh(remaining)
    root = vectors * np.sqrt(np.maximum(values, 0.0) * runs)[..., None, :]
    return by_line(likelihood.whitened_changes(replace(errors, inputs=root), jacobian))


def by_line(columns: ComplexArray) -> ComplexArray:
    """Return columns (Q, F, m, E, r) with outputs and runs in one axis, (Q, F, m E, r)."""
    return columns.reshape(*columns.shape[:2], -1, columns.shape[-1])


def products(left: ComplexArray, right: ComplexArray) -> Array:
    """Return 2 Re L^H R of columns (Q, F, k, p), summed over positions and lines, (p, p)."""
    a, b = (x.reshape(-1, x.shape[-1]) for x in (left, right))
    return np.asarray(2 * (np.conj(a).T @ b).real)
