"""A fit's cost with its gradient and Gauss-Newton matrix, by plain numpy."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from robotmodels.arrays import Array, ComplexArray
from robotmodels.spring_network import SpringNetwork

Residual = Literal["nls", "lls", "lls_magnitude"]


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """A sum of squares V = sum w |epsilon|^2 about some parameters; there is no factor 1/2.

    A Gauss-Newton step in ln theta is ``-solve(hessian, gradient)``.

    Attributes
    ----------
    cost : V.
    gradient : (p,) dV/d ln theta, exact for fixed equilibria.
    hessian : (p, p) 2 sum w Re(conj(d epsilon) d epsilon^T), with d epsilon = d epsilon/d ln theta:
        the second derivative of V where residuals are zero or linear.
    """

    cost: float
    gradient: Array
    hessian: Array


def error(
    measured: ComplexArray, modelled: ComplexArray, residual: Residual
) -> Array | ComplexArray:
    """Return epsilon: measured - G, or log(measured / G), or its real part, log|measured / G|."""
    if residual == "nls":
        return np.asarray(measured - modelled)
    apart = np.log(measured / modelled)
    return np.asarray(apart if residual == "lls" else apart.real)


def normal_equations(
    network: SpringNetwork,
    omega: Array,
    measured: ComplexArray,
    weights: Array,
    parameters: Array,
    residual: Residual,
) -> NormalEquations:
    """Return V = sum w |epsilon|^2 and its derivatives; arguments as of `CostKernel`.

    Elements of weight zero are left out, whatever has been measured there.
    """
    used = weights > 0
    G, J = network.sensitivity(omega, parameters)
    G, J, measured = G[used], J[used], measured[used]
    w, apart = weights[used], error(measured, G, residual)
    slope: Array | ComplexArray = -J if residual == "nls" else -J / G[:, None]
    if residual == "lls_magnitude":
        slope = slope.real
    weighted = w[:, None] * slope.conj()
    return NormalEquations(
        cost=float(w @ np.abs(apart) ** 2),
        gradient=2 * (weighted.T @ apart).real,
        hessian=2 * (weighted.T @ slope).real,
    )
