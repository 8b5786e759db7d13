"""From the problem of a fit to its linearisation about a solution."""

import numpy as np

from estimators.fitting.fit_problem import Problem
from estimators.fitting.weight_choice import line_shares
from estimators.frf.frf_estimate import is_full, vec
from estimators.trust.linearised_fit import LinearisedFit
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.linear.response import sensitivity


def linearise(
    problem: Problem, values: Array, at: tuple[ComplexArray, ComplexArray] | None = None
) -> LinearisedFit:
    """Return a fit about its solution.

    Parameters
    ----------
    problem : Problem
        Problem of the problem.
    values : ndarray, (p,), SI
        Parameters of the solution.
    at : tuple, optional
        FRF at the fit, (Q, F, m, n), and its derivatives with respect to ln theta, (Q, F, m, n, p);
        computed where None.
    """
    response, jacobian = sensitivities(problem, values) if at is None else at
    estimate, kind, used = problem.estimate, problem.kind, problem.used
    weights = problem.weights
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
        deviations = deviations * kind.form.slope(np.where(used, response, 1.0))[:, None]
        deviations = np.where(used[:, None], deviations, 0.0)
        deviations = vec(np.sqrt(2) * deviations.real if kind.real else deviations) * root[:, None]
    names = problem.model.parameters.names
    freedom = estimate.degrees_of_freedom
    nu = freedom[:, None, None]
    share = vec(line_shares(problem.weighting, estimate, kind, response))
    prior = np.zeros((len(names),) * 2)
    return LinearisedFit(
        names=names,
        residuals=vec(residuals),
        jacobian=np.moveaxis(vec(np.moveaxis(slopes, -1, 2)), 2, -1),
        weights=weights if is_full(weights, response.shape) else vec(weights),
        noise_weights=vec(np.where(used, 1.0 / np.where(used, pooled, 1.0), 0.0)),
        covariance=noise * root[..., :, None] * root[..., None, :]
        if is_full(noise, response.shape)
        else vec(noise * curved),
        deviations=deviations,
        degrees_of_freedom=np.where(np.isnan(freedom), np.inf, freedom),
        line_correlation=estimate.line_correlation,
        prior=prior if problem.prior is None else problem.prior.information(names),
        scatter_factor=1 / (1 - 2 * share / nu),
        real=kind.real,
        logarithmic=kind.relative,
    )


def sensitivities(problem: Problem, values: Array) -> tuple[ComplexArray, ComplexArray]:
    """Return the FRF at `values`, (Q, F, m, n), and its derivatives, (Q, F, m, n, p)."""
    estimate = problem.estimate
    return sensitivity(
        problem.model, estimate.positions, estimate.omega, values, equilibrium_shift=True
    )
