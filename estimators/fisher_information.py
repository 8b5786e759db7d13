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
    jacobian : (Q, F, m, n, p) derivative of an FRF, or of a residual, with respect to ln theta.
    weights : Lambda^-1, (Q, F, m, n) real for independent elements or (Q, F, m n, m n) Hermitian.

    Raises
    ------
    InvalidInput : if the weights fit neither way.
    """
    shape = jacobian.shape[:4]
    psi = np.moveaxis(vec(np.moveaxis(jacobian, -1, 2)), 2, -1)  # (Q, F, m n, p)
    weighted = weights @ psi if is_full(weights, shape) else vec(weights)[..., None] * psi
    lines = psi.shape[0], psi.shape[1] * psi.shape[2], psi.shape[3]
    left, right = psi.reshape(lines), weighted.reshape(lines)
    total = np.swapaxes(left.real, -1, -2) @ right.real
    if np.iscomplexobj(left):
        total = total + np.swapaxes(left.imag, -1, -2) @ right.imag
    return np.asarray(total + np.swapaxes(total, -1, -2))
