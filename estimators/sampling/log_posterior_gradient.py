"""Gradient and Gauss-Newton Hessian of a log posterior, for optimisers."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.sampling.log_posterior import LogPosterior
from robotmodels.common.arrays import Array


@dataclass(frozen=True, eq=False)
class Slope:
    """Minus log p at one point, with its derivatives by ln theta.

    Attributes
    ----------
    value : float
        -log p, up to the constant that `LogPosterior` leaves out.
    gradient : ndarray, (p,)
        Gradient.
    hessian : ndarray, (p, p)
        Gauss-Newton Hessian, positive semidefinite.
    """

    value: float
    gradient: Array
    hessian: Array


def slope(target: LogPosterior, ln_theta: Array) -> Slope:
    """Return -log p and its derivatives at `ln_theta` (p,), inside the bounds or not.

    Raises
    ------
    IdentificationError
        If the model has no FRF there.
    """
    theta = np.exp(ln_theta)
    likelihood = (_written_out if target.kernel is None else _compiled)(target, theta)
    if target.prior is None:
        return likelihood
    names, prior = target.names, target.prior
    return Slope(
        likelihood.value + float(prior.cost(names, theta)),
        likelihood.gradient + prior.slope(names).T @ prior.standardised(names, theta),
        likelihood.hessian + prior.information(names),
    )


def _compiled(target: LogPosterior, theta: Array) -> Slope:
    assert target.kernel is not None
    normal = target.kernel.normal_equations(theta)
    value = float(target.noise.of_cost(np.array([normal.cost]), target.data)[0])
    factor = target.noise.curvature(normal.cost, target.data)
    return Slope(-value, factor * normal.gradient, factor * normal.hessian)


def _written_out(target: LogPosterior, theta: Array) -> Slope:
    """Return the likelihood's part by plain numpy, about exact equilibria."""
    white, slopes = target.problem.residuals(theta)
    cost = float((np.abs(white) ** 2).sum())
    value = -float(target.noise.of_cost(np.array([cost]), target.data)[0])
    return Slope(value, *_normal(white, slopes, target.noise.curvature(cost, target.data)))


def _normal(
    white: NDArray[np.generic], slopes: NDArray[np.generic], factor: float
) -> tuple[Array, Array]:
    """Return 2 f sum Re(conj(J) e) and 2 f sum Re(conj(J) J^T)."""
    lines = slopes.reshape(-1, slopes.shape[-1])
    weighted = factor * np.conj(lines)
    gradient = 2 * (weighted.T @ white.reshape(-1)).real
    return np.asarray(gradient), np.asarray(2 * (weighted.T @ lines).real)
