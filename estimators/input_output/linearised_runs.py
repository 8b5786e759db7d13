"""A fit to runs about its solution, and the covariance of what it estimates."""

from dataclasses import replace

import numpy as np

from estimators.input_output.likelihood import Errors, RunProblem
from estimators.trust.linearised_fit import LinearisedFit, Lines, sandwich
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


def linearise_runs(problem: RunProblem, errors: Errors, jacobian: ComplexArray) -> LinearisedFit:
    """Return the fit about its solution; its elements are the whitened outputs of all runs.

    Parameters
    ----------
    problem : RunProblem
        Problem of the fit.
    errors : Errors
        Of the fitted FRF.
    jacobian : ndarray of complex, (Q, F, m E, p)
        L^-1 dG U0 by ln theta.
    """
    names, freedom = problem.model.parameters.names, problem.data.degrees_of_freedom
    q, f, m, runs = errors.whitened.shape
    ones = np.ones((q, f, m * runs))
    rows = 1 if problem.row_wise else m
    size = expected_square(freedom, rows)
    covariance: Lines = ones * size[:, None, None]
    if problem.row_wise and m > 1:
        covariance = size[:, None, None, None] * _correlation(errors, runs)
    prior = np.zeros((len(names),) * 2)
    return LinearisedFit(
        names=names,
        residuals=errors.whitened.reshape(q, f, -1),
        jacobian=jacobian,
        weights=ones,
        noise_weights=ones,
        covariance=covariance,
        deviations=None,
        degrees_of_freedom=freedom,
        line_correlation=np.empty(0),
        prior=prior if problem.prior is None else problem.prior.information(names),
        scatter_factor=(variance_factor(freedom, rows) / size)[:, None, None],
    )


def _correlation(errors: Errors, runs: int) -> ComplexArray:
    """Return the correlations of whitened outputs, (Q, F, m E, m E): runs are independent."""
    std = errors.root
    unit = errors.covariance / (std[..., :, None] * std[..., None, :])
    q, f, m = std.shape
    wide = np.einsum("qfij,ab->qfiajb", unit, np.eye(runs))
    return np.asarray(wide.reshape(q, f, m * runs, m * runs))


def error_covariance(problem: RunProblem, values: Array) -> Array:
    """Return the covariance (p, p) of ln theta.

    H^-1 (H + D) H^-1 with H the information of the true inputs, and

        D = 2 Re sum tr(Sigma^-1 dG_j C_U0 dG_i^H),  C_U0 = C_UU - A Sigma^-1 A^H,

    what the errors of the estimated inputs add to the scatter of the gradient: the information of
    the estimated inputs has the expectation H + D. Row by row the correlations of the outputs
    enter the middle. Sampled covariances enlarge the middle by `variance_factor`.

    Raises
    ------
    NotIdentifiable
        If H is singular.
    """
    G, J = problem.sensitivities(values)
    errors = problem.errors(G)
    slopes = problem.whitened_changes(errors, J)  # (Q, F, m, E, p)
    fit = linearise_runs(problem, errors, _flat(slopes))
    scattered = _input_scatter(problem, errors, J)
    bread = _products(fit.jacobian, fit.jacobian) - scattered + fit.prior
    if fit.covariance.ndim == 4:
        through = fit.covariance @ fit.jacobian
    else:
        through = fit.covariance[..., None] * fit.jacobian
    enlarged = np.asarray(fit.scatter_factor)[..., None] * through
    meat = _products(fit.jacobian, enlarged) + fit.prior
    return sandwich(bread, meat, fit.names)


def _flat(slopes: ComplexArray) -> ComplexArray:
    return slopes.reshape(*slopes.shape[:2], -1, slopes.shape[-1])


def _products(left: ComplexArray, right: ComplexArray) -> Array:
    """Return 2 Re L^H R of columns (Q, F, k, p), summed over positions and lines, (p, p)."""
    a, b = (x.reshape(-1, x.shape[-1]) for x in (left, right))
    return np.asarray(2 * (np.conj(a).T @ b).real)


def _input_scatter(problem: RunProblem, errors: Errors, jacobian: ComplexArray) -> Array:
    """Return D (p, p), see `error_covariance`."""
    m, runs = errors.whitened.shape[2:]
    noise = problem.data.covariance[..., m:, m:]
    gain = errors.gain
    if problem.row_wise:
        columns = gain.swapaxes(-1, -2)[..., None]  # (Q, F, m, n, 1)
        gain, noise = columns, noise[:, :, None]
    remaining = noise - gain @ np.conj(np.swapaxes(gain, -1, -2))
    values, vectors = np.linalg.eigh(remaining)
    root = vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]
    slopes = _flat(problem.whitened_changes(replace(errors, inputs=root), jacobian))
    return np.asarray(runs * _products(slopes, slopes))
