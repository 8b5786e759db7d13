"""A fit's cost with its gradient and Gauss-Newton matrix, by plain numpy."""

from dataclasses import dataclass

import numpy as np

from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.linear.residuals import ResidualForm, residual_error
from robotmodels.linear.spring_network import SpringNetwork


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """A sum of squares V = sum w |epsilon|^2 about some parameters; there is no factor 1/2.

    A Gauss-Newton step in ln theta is ``-solve(hessian, gradient)``.

    Attributes
    ----------
    cost : float
        V.
    gradient : ndarray, (p,)
        dV/d ln theta, exact for fixed equilibria.
    hessian : ndarray, (p, p)
        2 sum w Re(conj(d epsilon) d epsilon^T), with d epsilon = d epsilon/d ln theta: the second
        derivative of V where residuals are zero or linear.
    """

    cost: float
    gradient: Array
    hessian: Array


def normal_equations(
    network: SpringNetwork,
    omega: Array,
    measured: ComplexArray,
    weights: Array,
    parameters: Array,
    residual: ResidualForm,
) -> NormalEquations:
    """Return V = sum w |epsilon|^2 and its derivatives; arguments as of `CostKernel`.

    Elements of weight zero are left out, whatever has been measured there.
    """
    used = weights > 0
    G, J = network.sensitivity(omega, parameters)
    G, J, measured = G[used], J[used], measured[used]
    w, error = weights[used], residual_error(residual, measured, G)
    slope: Array | ComplexArray = -residual.slope(G)[:, None] * J
    if residual.real:
        slope = slope.real
    weighted = w[:, None] * slope.conj()
    return NormalEquations(
        cost=float(w @ np.abs(error) ** 2),
        gradient=2 * (weighted.T @ error).real,
        hessian=2 * (weighted.T @ slope).real,
    )


def model_slopes(
    network: SpringNetwork,
    omega: Array,
    measured: ComplexArray,
    weights: Array,
    residual: ResidualForm,
) -> tuple[Array, Array]:
    """Return dV/dK and dV/dM, (Q, d, d) each; see `CostKernel.model_slopes`.

    dG = -Z^T dA X, so with Y = dV/d conj(G) of each element dV = 2 Re sum conj(Y) dG is the inner
    product of dA and -2 Re(Z conj(Y) X^T).
    """
    model = network.linear_model()
    X, Z = model.receptances(omega)
    G = model.frequency_response(omega)
    used = weights > 0
    G, compared = np.where(used, G, 1.0), np.where(used, measured, 1.0)
    Y = -weights * residual_error(residual, compared, G) * np.conj(residual.slope(G))
    T = Z @ np.conj(Y) @ np.swapaxes(X, -1, -2)
    by_stiffness = -2 * T.real.sum(axis=1)
    by_mass = 2 * np.einsum("f,qfij->qij", np.square(omega), T.real)
    return _symmetric(by_stiffness), _symmetric(by_mass)


def _symmetric(matrices: Array) -> Array:
    return np.asarray((matrices + np.swapaxes(matrices, -1, -2)) / 2)
