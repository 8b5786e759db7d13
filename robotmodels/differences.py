"""Numerical derivatives by the logarithms of parameters."""

from collections.abc import Callable

import numpy as np

from robotmodels.arrays import Array

# Of ln theta: for smooth functions rounding and curvature both stay below 1e-7.
STEP = 1e-4


def by_ln_theta(function: Callable[[Array], Array], theta: Array) -> Array:
    """Return the derivatives of `function` by ln theta, along a new last axis (p).

    Parameters
    ----------
    function : callable
        Function of the parameters (p,) [SI].
    theta : ndarray, (p,)
        Where [SI].
    """
    columns = []
    for i in range(len(theta)):
        step = np.ones(len(theta))
        step[i] = np.exp(STEP)
        columns.append((function(theta * step) - function(theta / step)) / (2 * STEP))
    return np.stack(columns, axis=-1)
