"""Local maximisation of the sensitivity function tr(W H(q)) over positions (L-BFGS-B)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from oed.information_sets.candidates import sensitivities
from robotmodels.common.arrays import Array, BoolArray

_STEP = 1e-5  # of finite differences, as a part of the range
_CLOSE = 1e-3  # as a part of the range: closer positions are one


@dataclass(frozen=True, eq=False)
class Region:
    """Ranges of continuous positions, and the information of an experiment in each.

    Attributes
    ----------
    limits : ndarray, (n, 2)
        Ranges of the positions.
    evaluate : callable
        Information (Q, p, p) of positions (Q, n).
    usable : callable
        Which positions (Q, n) can be taken, (Q,).
    """

    limits: Array
    evaluate: Callable[[Array], Array]
    usable: Callable[[Array], BoolArray]


def local_maxima(region: Region, starts: Array, gradient: Array, precision: float) -> Array:
    """Return the local maximum of tr(W H) from each start, at usable positions, (k, n).

    Parameters
    ----------
    starts : ndarray, (k, n)
        Usable positions.
    gradient : ndarray, (p, p)
        W, the derivative of the log value by the information.
    precision : float
        A step that gains no larger part of tr(W H) is the last.
    """
    from scipy.optimize import minimize

    low, high = region.limits.T
    span = np.where(high > low, high - low, 1.0)

    def falling(u: Any) -> tuple[float, Array]:
        # A step that would leave the range is made backwards.
        steps = np.where(u + _STEP > 1.0, -_STEP, _STEP) * (high > low)
        points = np.vstack([u, u + np.diag(steps)])
        derivatives = sensitivities(gradient, region.evaluate(low + points * span))
        change = derivatives[1:] - derivatives[0]
        slopes = np.divide(change, steps, out=np.zeros_like(steps), where=steps != 0)
        return -float(derivatives[0]), -slopes

    bounds = [(0.0, 1.0)] * len(low)
    options: Any = {"maxiter": 25, "ftol": precision, "gtol": 1e-6}
    ends = []
    for start in starts:
        begin: Any = np.clip((start - low) / span, 0.0, 1.0)
        end: Any = minimize(
            falling, begin, jac=True, method="L-BFGS-B", bounds=bounds, options=options
        )
        ends.append(_last_usable(region, start, low + end.x * span))
    return np.array(ends)


def _last_usable(region: Region, start: Array, end: Array) -> Array:
    """Return `end`, or the farthest usable point of nine towards it from the usable `start`."""
    shares = np.linspace(1.0, 0.0, 9)[:-1]
    path = start + shares[:, None] * (end - start)
    usable = region.usable(path)
    return np.asarray(path[np.argmax(usable)] if usable.any() else start)


def new_positions(positions: Array, existing: Array, region: Region) -> Array:
    """Return the positions that are not close to an existing or an earlier one."""
    span = np.maximum(region.limits[:, 1] - region.limits[:, 0], 1e-12)
    new: list[Array] = []
    for position in positions:
        others = np.concatenate([existing, np.reshape(new, (-1, existing.shape[1]))])
        if np.abs((others - position) / span).max(axis=1).min() > _CLOSE:
            new.append(position)
    return np.reshape(new, (-1, existing.shape[1]))
