"""Bands of what is computed from parameters: by the delta method, or by draws of a posterior."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from estimators.trust.line_scatter import Scatter
from estimators.uncertainty.covariance import Uncertainty
from robotmodels.common.arrays import Array, BoolArray, ComplexArray, check_level
from robotmodels.common.errors import InvalidInput
from robotmodels.linear.response import by_ln_theta

DRAWS = 400
"""Draws that are evaluated at most: quantiles of a 95 % interval to about a tenth of its width."""

_ROUNDING = 1e-13
"""Of responses, beside the largest one."""

Spread = Uncertainty | Array
"""A covariance of ln theta, for the delta method, or draws (N, p) of it."""


@dataclass(frozen=True, eq=False)
class Band:
    """Values, the standard deviations of their logarithms and phases, and ends of intervals.

    Attributes
    ----------
    std : ndarray, (...), dimensionless
        Standard deviations of ln |value|; zero where the value is.
    phase_std : ndarray, (...), rad
        Of the phases; zero for real values.
    lower, upper : ndarray, (...)
        Ends of the intervals of |value|.
    """

    std: Array
    phase_std: Array
    lower: Array
    upper: Array


def propagate(
    function: Callable[[Array], Any], theta: Array, spread: Spread, level: float
) -> tuple[Any, Band]:
    """Return a function of the parameters (p,) at theta, and its band.

    Parameters
    ----------
    function : callable
        Of theta [SI], such that derivatives by ln theta exist.
    theta : ndarray, (p,), SI
        Where.
    spread : Spread
        Covariance of ln theta, or draws (N, p) of it; of more than 400 draws every so many.
    level : float
        Nominal coverage of each interval.
    """
    values = function(theta)
    if isinstance(spread, Uncertainty):
        slope = by_ln_theta(function, theta)
        return values, delta_band(values, slope, spread, level)
    return values, draw_band(
        values, np.stack([function(np.exp(x)) for x in thinned(spread)]), level
    )


def delta_band(
    values: Array | ComplexArray, slope: Array | ComplexArray, spread: Uncertainty, level: float
) -> Band:
    """Return the band of values (...) with derivatives `slope` (..., p) by ln theta.

    The logarithm is taken as linear in ln theta. Of several degrees of freedom the mean counts,
    parameters weighed by what they alone add to the variance.
    """
    relative = relative_slope(values, slope)
    std, phase = (
        np.sqrt(np.maximum(np.einsum("...p,pr,...r->...", g, spread.covariance, g), 0.0))
        for g in (relative.real, relative.imag)
    )
    alone = relative.real**2 * np.diag(spread.covariance)
    total = np.where(std > 0, alone.sum(axis=-1), 1.0)
    with np.errstate(divide="ignore"):
        freedom = 1 / ((alone / spread.degrees_of_freedom).sum(axis=-1) / total)
    ends = np.exp(Scatter(std**2, freedom).quantile(level) * std)
    return Band(std, phase, np.abs(values) / ends, np.abs(values) * ends)


def relative_slope(values: Array | ComplexArray, slope: Array | ComplexArray) -> Any:
    """Return derivatives (..., p) of ln(values); zero where values are no more than rounding."""
    zero = is_rounding(values)
    return np.where(zero[..., None], 0.0, slope) / np.where(zero, 1.0, values)[..., None]


def draw_band(values: Array | ComplexArray, drawn: Array | ComplexArray, level: float) -> Band:
    """Return the band of values (...) by those of draws (N, ...)."""
    zero = is_rounding(values)
    ratio = np.where(zero, 1.0, drawn / np.where(zero, 1.0, values))
    std, phase_std = (part.std(axis=0, ddof=1) for part in (np.log(np.abs(ratio)), np.angle(ratio)))
    ends = np.quantile(np.abs(drawn), [(1 - level) / 2, (1 + level) / 2], axis=0)
    return Band(std, phase_std, *ends)


def is_rounding(values: Array | ComplexArray) -> BoolArray:
    """Return a mask of values that are zero beside the largest one, by symmetry as a rule."""
    sizes = np.abs(values)
    return np.asarray(sizes <= _ROUNDING * np.nanmax(sizes, initial=0.0))


def checked_spread(names: tuple[str, ...], spread: Spread, level: float) -> Spread:
    """Return a spread of the parameters `names`.

    Raises
    ------
    InvalidInput
        For a level outside (0, 1), or a spread of other parameters.
    """
    check_level(level, "prediction")
    if isinstance(spread, Uncertainty):
        if spread.names != names:
            raise InvalidInput(
                f"prediction: an uncertainty of {', '.join(spread.names)} for the parameters "
                f"{', '.join(names)}"
            )
        return spread
    draws = np.asarray(spread, dtype=float)
    if draws.ndim != 2 or draws.shape[1] != len(names) or len(draws) < 2:
        raise InvalidInput(
            f"prediction: draws of shape {draws.shape}; (N, {len(names)}), at least two, are needed"
        )
    return draws


def thinned(draws: Array) -> Array:
    """Return at most DRAWS of the draws, evenly spaced."""
    return np.asarray(draws[:: -(-len(draws) // DRAWS)])
