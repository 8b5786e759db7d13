"""From a fit to its linearisation about the solution."""

import numpy as np

from estimators.fitting.least_squares import Fit, problem_of
from estimators.fitting.weight_choice import own_line_shares
from estimators.frf.frf_estimate import is_full, vec
from estimators.trust.linearised_fit import LinearisedFit
from robotmodels.common.arrays import ComplexArray
from robotmodels.linear.response import sensitivity


def linearise(fit: Fit, at: tuple[ComplexArray, ComplexArray] | None = None) -> LinearisedFit:
    """Return a fit about its solution.

    Parameters
    ----------
    at : tuple, optional
        FRF at the fit, (Q, F, m, n), and its derivatives with respect to ln theta, (Q, F, m, n, p);
        computed where None.
    """
    response, jacobian = sensitivities(fit) if at is None else at
    estimate, problem = fit.estimate, problem_of(fit)
    kind, used = problem.kind, problem.used
    slopes = -kind.jacobian(response, jacobian, used)
    residuals = np.where(used, kind.error(estimate.response, response, used), 0.0)
    noise = kind.noise(estimate.covariance, response, used)
    pooled = kind.noise(estimate.pooled_variance, response, used)
    # The logarithm of 1 + x has the variance r + r^2/2 + ..., with r = E|x|^2.
    curved = np.where(used, 1 + pooled / 2, 1.0) if kind.relative else np.ones(response.shape)
    pooled = pooled * curved
    root = vec(np.sqrt(curved))
    deviations = estimate.deviations
    if deviations is not None:
        size = np.where(used, response, 1.0)[:, None]
        deviations = deviations / size if kind.relative else deviations
        deviations = np.where(used[:, None], deviations, 0.0)
        deviations = vec(np.sqrt(2) * deviations.real if kind.real else deviations) * root[:, None]
    names = fit.parameters.names
    freedom = estimate.degrees_of_freedom
    nu = freedom[:, None, None]
    share = vec(own_line_shares(fit.weighting, estimate, kind, response))
    prior = np.zeros((len(names),) * 2)
    return LinearisedFit(
        names=names,
        residuals=vec(residuals),
        jacobian=np.moveaxis(vec(np.moveaxis(slopes, -1, 2)), 2, -1),
        weights=fit.weights if is_full(fit.weights, response.shape) else vec(fit.weights),
        noise_weights=vec(np.where(used, 1.0 / np.where(used, pooled, 1.0), 0.0)),
        covariance=noise * root[..., :, None] * root[..., None, :]
        if is_full(noise, response.shape)
        else vec(noise * curved),
        deviations=deviations,
        degrees_of_freedom=np.where(np.isnan(freedom), np.inf, freedom),
        line_correlation=estimate.line_correlation,
        prior=prior if fit.prior is None else fit.prior.information(names),
        scatter_factor=1 / (1 - 2 * share / nu),
        real=kind.real,
        logarithmic=kind.relative,
    )


def sensitivities(fit: Fit) -> tuple[ComplexArray, ComplexArray]:
    """Return the FRF at the fit, (Q, F, m, n), and its derivatives, (Q, F, m, n, p)."""
    estimate = fit.estimate
    return sensitivity(
        fit.model, estimate.positions, estimate.omega, fit.parameters.values, sag=True
    )
