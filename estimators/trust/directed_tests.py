"""Score tests along single directions in which a model may be wrong."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.trust.line_correlation import LineCorrelation
from estimators.trust.line_scatter import line_scatter
from estimators.trust.linearised_fit import LinearisedFit, Lines
from robotmodels.arrays import Array

DETECTION = 5.3
"""Standard deviations that an error needs to be seen with 95 %: at a level of 1 % over 38 tests."""

_VISIBLE = 1e-6
"""Share of a direction off the parameters below which it is theirs but for rounding."""


@dataclass(frozen=True, eq=False)
class Directions:
    """Ways in which the model may be wrong.

    Attributes
    ----------
    names : tuple of str
        r names, such as "delay".
    units : tuple of str
        Of the coefficients.
    columns : (Q, F, k, r)
        Change of the modelled values with a coefficient of one.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    columns: Lines


@dataclass(frozen=True, eq=False)
class DirectedTests:
    """Estimates along directions, each as one more parameter.

    Attributes
    ----------
    names, units : tuple of str
        As in `Directions`, but for those that the parameters imitate.
    estimates, std : (r,)
        Coefficients by one step, and their standard deviations.
    probabilities : (r,)
        Two-sided, of estimates as large if the model is right; not corrected for their number.
    undetected_shift : (r, p)
        By how many standard deviations an error at the limit of detection moves each parameter.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    estimates: Array
    std: Array
    probabilities: Array
    undetected_shift: Array

    def significant(self, level: float = 0.01) -> NDArray[np.intp]:
        """Return the directions whose test fires at `level` over all (Bonferroni), strongest first.
        """
        if not len(self.names):
            return np.empty(0, dtype=np.intp)
        order = np.argsort(self.probabilities, kind="stable")
        return order[self.probabilities[order] < level / len(self.names)]


def directed_tests(
    fit: LinearisedFit,
    directions: Directions,
    correlation: LineCorrelation,
    std: Array,
    expected: float | None = None,
) -> DirectedTests:
    """Return one-degree score tests along `directions`.

    Each direction is projected off the parameters and treated as one more of them, by the same
    scatter and t law.

    Parameters
    ----------
    std : (p,)
        Standard deviations of ln theta.
    expected : float, optional
        Of the sum of squared residuals, where they are larger: variances are then scaled by what
        remains of the sum beside a direction, as those of the parameters are.
    """
    off = fit.off_parameters(directions.columns)
    weighted = fit.weighted(off)
    r = off.shape[-1]
    flat, whole = off.reshape(-1, r), directions.columns.reshape(-1, r)
    size = np.einsum("ir,ir->r", np.conj(flat), weighted.reshape(-1, r)).real
    before = fit.weighted(directions.columns).reshape(-1, r)
    full = np.einsum("ir,ir->r", np.conj(whole), before).real
    seen = size > _VISIBLE**2 * np.where(full > 0, full, 1.0)
    seen &= full > 0
    rows = np.moveaxis(np.conj(weighted[..., seen]) / size[seen], -1, 0)
    estimates = fit.estimates(rows, fit.residuals)
    scatter = line_scatter(fit, rows, correlation)
    if expected is not None:
        remaining = fit.squares - estimates**2 * fit.off_power(flat[:, seen])
        scatter = scatter.scaled(np.maximum(remaining / expected, 1.0))
    deviation = np.sqrt(scatter.variance)
    shift = fit.shifts(directions.columns[..., seen]).T * (DETECTION * deviation)[:, None] / std
    keep = np.flatnonzero(seen)
    return DirectedTests(
        tuple(directions.names[i] for i in keep),
        tuple(directions.units[i] for i in keep),
        estimates,
        deviation,
        scatter.probability(estimates),
        shift,
    )
