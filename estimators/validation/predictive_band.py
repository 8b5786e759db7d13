"""Posterior predictive bands: where magnitudes of another measurement would lie."""

from functools import cache

import numpy as np
from scipy.special import chndtrix

from estimators.validation.bands import thinned
from robotmodels import kernel
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.linear.response import Elastic

_STRONG = 12.0  # responses over noise from which magnitudes are normal, to a thousandth


def predictive_band(
    model: Elastic, positions: Array, omega: Array, draws: Array, std: Array, level: float = 0.95
) -> tuple[Array, Array]:
    """Return the ends of the band of measured magnitudes |G|, (Q, F, m, n) each.

    The law of a measurement is complex normal: mean and variance are those of the FRFs of the
    draws, the variance with that of the noise. Its magnitude has Rice's law.

    Parameters
    ----------
    model : Elastic
        The model.
    positions : ndarray, (Q, n), rad
        Measured in or not.
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    draws : ndarray, (N, p)
        Draws of ln theta from its posterior; of more than 400 every so many.
    std : ndarray, (Q, F, m, n)
        Standard deviations of the noise, E|e|^2 = std^2.
    level : float
        Share of measurements in the band.
    """
    some = thinned(draws)
    total, square = np.zeros(std.shape, dtype=complex), np.zeros(std.shape)
    first = _response(model, positions, omega, some[0])
    for draw in some:  # about the first, so that rounding does not make the variance
        off = _response(model, positions, omega, draw) - first
        total += off
        square += np.abs(off) ** 2
    mean = total / len(some)
    variance = (square - len(some) * np.abs(mean) ** 2) / max(len(some) - 1, 1)
    spread = np.maximum(np.sqrt(np.maximum(variance, 0.0) + std**2), np.finfo(float).tiny)
    ratio = np.abs(first + mean) / spread
    ratios, ends = _rice(level)
    beyond = np.maximum(ratio - _STRONG, 0.0)
    lower, upper = (spread * (np.interp(ratio, ratios, end) + beyond) for end in ends)
    return lower, upper


@cache
def _rice(level: float) -> tuple[Array, tuple[Array, Array]]:
    """Return means over standard deviations, and the ends of the bands of magnitudes there.

    2 |y|^2 of a complex normal y of variance 1 is noncentral chi squared with two degrees.
    """
    ratios = np.linspace(0.0, _STRONG, 241)
    ends = [
        np.sqrt(chndtrix(share, 2.0, 2 * ratios**2) / 2)
        for share in ((1 - level) / 2, (1 + level) / 2)
    ]
    return ratios, (ends[0], ends[1])


def _response(model: Elastic, positions: Array, omega: Array, draw: Array) -> ComplexArray:
    return kernel.frequency_response(model.network(positions, np.exp(draw)), omega)
