"""The gradient of a fit's cost through the robot's static equilibria."""

import numpy as np

from estimators.cost import Problem
from robotmodels.arrays import Array, ComplexArray
from robotmodels.linear_model import LinearModel
from robotmodels.response import BeyondSprings
from robotmodels.spring_network import SpringNetwork


def sag_gradient(problem: Problem, network: SpringNetwork) -> Array:
    """Return the part of dV/d ln theta, (p,), that frozen equilibria leave out.

    With Y = dV/d conj(G) per element and dG = -Z^T (dK + j omega dD - omega^2 dM) X, it is
    minus 2 Re sum conj(Y) dG: one product of matrices per line, whatever the number of parameters,
    and then the real inner products of sum Re(T), sum omega^2 Re(T), and sum Re(j omega T) with
    dK, dM and dD, where T = Z conj(Y) X^T.

    Parameters
    ----------
    problem : whose cost.
    network : at the parameters in question, equilibria found there; motor accelerations are
        measured.
    """
    p = len(network.parameters)
    if not isinstance(problem.model, BeyondSprings):
        return np.zeros(p)
    estimate = problem.estimate
    tangents = problem.model.tangents(estimate.positions, network.parameters.values, sag=True)
    if tangents is None:
        return np.zeros(p)
    model, total = network.linear_model(), np.zeros(p)
    for q in range(len(estimate.positions)):
        on_stiffness, on_mass, on_damping = _weights_of_change(problem, model, q)
        total += np.einsum("pij,ij->p", tangents.stiffness[q], on_stiffness)
        total += np.einsum("pij,ij->p", tangents.mass[q], on_mass)
        total += np.einsum("pij,ij->p", tangents.damping[q], on_damping)
    return 2 * total


def _weights_of_change(problem: Problem, model: LinearModel, q: int) -> tuple[Array, Array, Array]:
    """Return the sums over frequency, (d, d), that multiply dK, dM and dD in one position."""
    w = problem.estimate.omega[:, None, None]
    S = model.selector + 0j
    A = model.stiffness[q] - w**2 * model.mass[q] + 1j * w * model.damping[q]
    X = np.linalg.solve(A, np.broadcast_to(S, (*A.shape[:-1], S.shape[1])))
    Z = -(w**2) * X
    right = np.conj(_cotangent(problem, q, np.asarray(S.T @ Z))) @ np.swapaxes(X, -1, -2)
    # Z right summed over frequency is one product of long matrices.
    long = np.swapaxes(Z, 0, 1).reshape(len(S), -1)
    sums = [long @ (scale * right).reshape(-1, len(S)) for scale in (1.0, -(w**2), 1j * w)]
    return sums[0].real, sums[1].real, sums[2].real


def _cotangent(problem: Problem, q: int, modelled: ComplexArray) -> ComplexArray:
    """Return Y, (F, m, n), with dV = -2 Re sum conj(Y) dG, for real weights per element."""
    used, weights = problem.used[q], problem.weights[q]
    error = problem.kind.error(problem.estimate.response[q], modelled, used)
    if not problem.kind.relative:
        return np.asarray(weights * error)
    return np.asarray(weights * error / np.conj(np.where(used, modelled, 1.0)))
