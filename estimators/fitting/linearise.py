"""From the problem of a fit to FRFs to its linearisation about a solution."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from estimators.fitting.fit_problem import Derived
from estimators.fitting.residuals import Residual
from estimators.fitting.weight_choice import line_shares
from estimators.frf.frf_estimate import is_full, vec
from estimators.trust.linearised_fit import LinearisedFit, Lines
from robotmodels.common.arrays import ComplexArray

if TYPE_CHECKING:
    from estimators.fitting.frf_problem import FrfProblem


def linearise(problem: "FrfProblem", at: Derived) -> LinearisedFit:
    """Return a fit about its solution.

    Parameters
    ----------
    problem : FrfProblem
        Problem of the fit.
    at : tuple
        FRF at the solution, (Q, F, m, n), and its derivatives by ln theta, (Q, F, m, n, p).
    """
    response, jacobian = at
    estimate, kind, used = problem.data, problem.kind, problem.used
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


def residual_changes(
    kind: Residual, response: ComplexArray, used: NDArray[np.bool_]
) -> Callable[[ComplexArray], Lines]:
    """Return what turns changes (Q, F, m, n, r) of the FRF into those of the values of a fit.

    Parameters
    ----------
    kind : Residual
        Residual of the fit.
    response : ndarray of complex, (Q, F, m, n)
        FRF of the model.
    used : ndarray of bool, (Q, F, m, n)
        Which elements the fit uses.
    """

    def changes(changed: ComplexArray) -> Lines:
        slopes = -kind.jacobian(response, changed, used)
        return np.moveaxis(vec(np.moveaxis(slopes, -1, 2)), 2, -1)

    return changes
