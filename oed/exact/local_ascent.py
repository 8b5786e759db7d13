"""Positions moved continuously to where an experiment is worth most, by given prices."""

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
    """Where positions may be moved, and what an experiment there would tell.

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


def climbed(region: Region, starts: Array, slope: Array, precision: float) -> Array:
    """Return where the price is locally largest, from each start, in usable places, (k, n).

    Parameters
    ----------
    starts : ndarray, (k, n)
        Usable positions.
    slope : ndarray, (p, p)
        Slope of which the price tr(slope H) of a position is made.
    precision : float
        A step that gains no larger part of the price is the last.
    """
    from scipy.optimize import minimize

    low, high = region.limits.T
    span = np.where(high > low, high - low, 1.0)

    def falling(u: Any) -> tuple[float, Array]:
        # A step that would leave the range is made backwards.
        steps = np.where(u + _STEP > 1.0, -_STEP, _STEP) * (high > low)
        places = np.vstack([u, u + np.diag(steps)])
        prices = sensitivities(slope, region.evaluate(low + places * span))
        change = prices[1:] - prices[0]
        slopes = np.divide(change, steps, out=np.zeros_like(steps), where=steps != 0)
        return -float(prices[0]), -slopes

    bounds = [(0.0, 1.0)] * len(low)
    options: Any = {"maxiter": 25, "ftol": precision, "gtol": 1e-6}
    found = []
    for start in starts:
        begin: Any = np.clip((start - low) / span, 0.0, 1.0)
        end: Any = minimize(
            falling, begin, jac=True, method="L-BFGS-B", bounds=bounds, options=options
        )
        found.append(_last_usable(region, start, low + end.x * span))
    return np.array(found)


def _last_usable(region: Region, start: Array, end: Array) -> Array:
    """Return `end`, or the farthest usable point of nine towards it from the usable `start`."""
    shares = np.linspace(1.0, 0.0, 9)[:-1]
    way = start + shares[:, None] * (end - start)
    usable = region.usable(way)
    return np.asarray(way[np.argmax(usable)] if usable.any() else start)


def new_positions(found: Array, known: Array, region: Region) -> Array:
    """Return the positions found that are not close to a known or an earlier one."""
    span = np.maximum(region.limits[:, 1] - region.limits[:, 0], 1e-12)
    kept: list[Array] = []
    for position in found:
        others = np.concatenate([known, np.reshape(kept, (-1, known.shape[1]))])
        if np.abs((others - position) / span).max(axis=1).min() > _CLOSE:
            kept.append(position)
    return np.reshape(kept, (-1, known.shape[1]))
