"""The parts of Theorem 1, [WM] (5), and Fisher information."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from estimators.frf.frf_estimate import is_full, vec
from robotmodels.common.arrays import Array

if TYPE_CHECKING:
    from estimators.fitting.frf_problem import FrfProblem


def frf_sandwich(problem: "FrfProblem", values: Array) -> tuple[Array, Array]:
    """Return bread and meat of (5), (p, p): Hessian of the cost, covariance of its gradient.

    With Psi the residual's Jacobian, W its weights and R its noise covariance, bread is
    2 sum Re(conj(Psi) W Psi^T) and meat 2 sum Re(conj(Psi) W R W Psi^T). For log residuals
    Psi = G_d^-1 Psi_G and R = G_d^-1 Lambda_0 G_d^-H, which is [WM]'s Xi and Sigma regrouped.
    """
    kind, weights, used = problem.kind, problem.weights, problem.used
    G, J = problem.derived(values)
    psi = kind.jacobian(G, J, used)
    noise = kind.noise(problem.data.covariance, G, used)
    bread = information(psi, weights).sum(axis=0)
    meat = information(psi, weighted_noise(weights, noise, G.shape)).sum(axis=0)
    return bread, meat


def weighted_noise(
    weights: NDArray[Any], noise: NDArray[Any], shape: tuple[int, ...]
) -> NDArray[Any]:
    """Return W R W: element-wise if both are, (Q, F, m n, m n) otherwise."""
    full_weights, full_noise = is_full(weights, shape), is_full(noise, shape)
    if not full_weights and not full_noise:
        return np.asarray(weights**2 * noise)
    if not full_weights:
        w = vec(weights)
        return np.asarray(w[..., :, None] * noise * w[..., None, :])
    middle = noise @ weights if full_noise else vec(noise)[..., :, None] * weights
    return np.asarray(weights @ middle)


def information(jacobian: NDArray[Any], weights: NDArray[Any]) -> Array:
    """Return 2 sum_F Re(conj(Psi) Lambda^-1 Psi^T), (Q, p, p), of each position.

    The inverse of the sum over positions is [WM] (5) with (6), divided by N_f.

    Parameters
    ----------
    jacobian : ndarray, (Q, F, m, n, p)
        Derivative of an FRF, or of a residual, with respect to ln theta.
    weights : ndarray
        Lambda^-1, (Q, F, m, n) real for independent elements or (Q, F, m n, m n) Hermitian.

    Raises
    ------
    InvalidInput
        If the weights fit neither way.
    """
    shape = jacobian.shape[:4]
    if is_full(weights, shape):
        left = vec(np.moveaxis(jacobian, -1, 2)).swapaxes(-1, -2)  # (Q, F, m n, p)
        right = weights @ left
    else:
        left, right = jacobian, weights[..., None] * jacobian
    pairs = [(left.real, right.real)]
    if np.iscomplexobj(left):
        pairs.append((left.imag, right.imag))
    lines = shape[0], -1, jacobian.shape[-1]
    total = sum(a.reshape(lines).swapaxes(-1, -2) @ b.reshape(lines) for a, b in pairs)
    return np.asarray(total + np.swapaxes(total, -1, -2))
