"""Fisher information of FRFs: the one place where it is summed."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.frf.estimate import is_full, vec
from robotmodels.arrays import Array


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
