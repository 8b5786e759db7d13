"""Robust losses: how much a residual far outside the noise counts."""

from collections.abc import Callable

import numpy as np

from robotmodels.arrays import Array
from robotmodels.errors import InvalidInput, nearest


def _linear(z: Array) -> tuple[Array, Array, Array]:
    return z, np.ones_like(z), np.zeros_like(z)


def _soft_l1(z: Array) -> tuple[Array, Array, Array]:
    t = 1 + z
    return 2 * (np.sqrt(t) - 1), t**-0.5, -0.5 * t**-1.5


def _huber(z: Array) -> tuple[Array, Array, Array]:
    inside = z <= 1
    root = np.sqrt(np.where(inside, 1.0, z))
    return (
        np.where(inside, z, 2 * root - 1),
        1 / root,
        np.where(inside, 0.0, -0.5 / root**3),
    )


def _cauchy(z: Array) -> tuple[Array, Array, Array]:
    t = 1 + z
    return np.log1p(z), 1 / t, -1 / t**2


LOSSES: dict[str, Callable[[Array], tuple[Array, Array, Array]]] = {
    "linear": _linear,
    "soft_l1": _soft_l1,
    "huber": _huber,
    "cauchy": _cauchy,
}


def check_loss(name: str) -> str:
    """Return `name` if there is a loss of that name.

    Raises
    ------
    InvalidInput
        If there is none.
    """
    if name not in LOSSES:
        raise InvalidInput(f"loss {name!r} is none of {', '.join(LOSSES)}{nearest(name, LOSSES)}")
    return name


def robust_loss(name: str, squares: Array, variance: Array) -> Array:
    """Return s^2 rho(z/s^2) and its first two derivatives by z, (3, r).

    The losses rho are those of `scipy.optimize.least_squares`; a residual counts in full up to
    about its own standard deviation s.

    Parameters
    ----------
    squares : ndarray, (r,)
        Squared residuals z.
    variance : ndarray, (r,)
        Their expected values s^2.
    """
    values = LOSSES[name](squares / variance)
    return np.stack([variance * values[0], values[1], values[2] / variance])


def loss_factors(loss: str) -> tuple[float, float]:
    """Return E[rho' + 2 z rho''] and E[z rho'^2] with z = u^2 of a normal u.

    By these a robust loss scales bread and meat where the noise is normal; one and one for
    "linear".
    """
    u = np.linspace(-10.0, 10.0, 20001)
    density = np.exp(-(u**2) / 2)
    density /= density.sum()
    _, first, second = LOSSES[loss](u**2)
    return float(density @ (first + 2 * u**2 * second)), float(density @ (u * first) ** 2)
