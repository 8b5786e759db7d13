"""Variance of what a fit estimates, from the scatter of the lines, with its degrees of freedom."""

from dataclasses import dataclass

import numpy as np

from estimators.trust.line_correlation import LineCorrelation
from estimators.trust.linearised_fit import LinearisedFit, Lines
from robotmodels.common.arrays import Array

_ENOUGH = 10.0
"""Degrees of freedom from which on the scatter of whole positions is looked at."""


@dataclass(frozen=True, eq=False)
class Scatter:
    """Variances of coefficients and their degrees of freedom.

    Attributes
    ----------
    variance : ndarray, (r,)
        Variance of the estimated coefficients.
    degrees_of_freedom : ndarray, (r,)
        Real ones, by Satterthwaite's approximation; infinite where the noise is declared.
    """

    variance: Array
    degrees_of_freedom: Array

    def scaled(self, factor: float | Array) -> "Scatter":
        """Return variances multiplied by a factor."""
        return Scatter(self.variance * factor, self.degrees_of_freedom)

    def quantile(self, level: float) -> Array:
        """Return the factor of the standard deviation of two-sided intervals, (r,)."""
        from scipy.special import ndtri, stdtrit

        at = (1 + level) / 2
        finite = np.isfinite(self.degrees_of_freedom)
        nu = np.where(finite, self.degrees_of_freedom, 1.0)
        return np.asarray(np.where(finite, stdtrit(nu, at), ndtri(at)))

    def probability(self, estimates: Array) -> Array:
        """Return the two-sided probability of estimates as large as these, (r,), of zero."""
        from scipy.special import ndtr, stdtr

        with np.errstate(divide="ignore", invalid="ignore"):
            z = np.abs(estimates) / np.sqrt(self.variance)
        z = np.where(self.variance > 0, z, 0.0)
        finite = np.isfinite(self.degrees_of_freedom)
        nu = np.where(finite, self.degrees_of_freedom, 1.0)
        return np.asarray(2 * np.where(finite, stdtr(nu, -z), ndtr(-z)))


def line_scatter(fit: LinearisedFit, rows: Lines, correlation: LineCorrelation) -> Scatter:
    """Return the variances of Re(A e) for rows A (r, Q, F, k) of estimators.

    What each line adds to the variance is A C A^H / 2 and has 2 nu real degrees of freedom. Where
    errors are correlated along the lines with R, the sum is multiplied by A R A^H / A A^H, with A
    in units of the errors; but the scatter of whole positions over the draws is taken where that is
    larger and has enough degrees of freedom.
    """
    return _line_scatter(fit, rows, fit.line_variances(rows), correlation)


def _line_scatter(
    fit: LinearisedFit, rows: Lines, by_line: Lines, correlation: LineCorrelation
) -> Scatter:
    """Return `line_scatter` of rows that add so much by line, (r, Q, F)."""
    nu = fit.parts * fit.degrees_of_freedom
    variance = by_line.sum(axis=(1, 2))
    with np.errstate(divide="ignore", invalid="ignore"):
        dof = variance**2 / (by_line**2 / nu[:, None]).sum(axis=(1, 2))
    dof = np.where(np.isnan(dof), np.inf, dof)
    if correlation.white:
        return Scatter(variance, dof)
    scale = correlation.variance * _correlated_power(fit, rows, correlation.coefficients)
    if not np.isfinite(nu).any():
        data = np.full(len(rows), max(correlation.data, 1.0))
        return Scatter(variance * scale, data)
    dof = np.maximum(dof / correlation.inflation, nu.min())
    whole = float(nu.sum())
    if fit.deviations is not None and whole >= _ENOUGH:
        together = fit.line_scores(rows).sum(axis=3)  # (r, Q, R)
        by_position = (np.abs(together) ** 2).sum(axis=2) / 2
        total = by_position.sum(axis=1)
        larger = total > variance * scale
        shared = total**2 / np.maximum((by_position**2 / nu).sum(axis=1), 1e-300)
        return Scatter(np.where(larger, total, variance * scale), np.where(larger, shared, dof))
    return Scatter(variance * scale, dof)


def cautious_scatter(fit: LinearisedFit, rows: Lines, correlation: LineCorrelation) -> Scatter:
    """Return `line_scatter`, but of each line no less than its neighbours' variances make it.

    A false alarm of many tests comes from the far tail of a t law, which Satterthwaite's
    approximation misses where few lines with few degrees of freedom decide: one whose scatter
    happens to be small looks certain, and other lines then count as many. The neighbours' variances
    know nothing of the line's own.
    """
    line_variance = fit.line_variances(rows)
    scatter = _line_scatter(fit, rows, line_variance, correlation)
    nu = fit.parts * fit.degrees_of_freedom[:, None]
    if not np.isfinite(nu).any():
        return scatter
    with np.errstate(divide="ignore"):
        variances = np.where(fit.used, 1 / fit.noise_weights, 0.0)
    larger = np.maximum(line_variance, (np.abs(rows) ** 2 * variances).sum(axis=-1) / 2)
    total = larger.sum(axis=(1, 2))
    with np.errstate(divide="ignore", invalid="ignore"):
        factor = total / line_variance.sum(axis=(1, 2))
        dof = total**2 / (larger**2 / nu).sum(axis=(1, 2)) / correlation.inflation
    return Scatter(
        scatter.variance * np.nan_to_num(factor, nan=1.0),
        np.fmin(scatter.degrees_of_freedom, np.maximum(dof, nu.min())),
    )


def _correlated_power(fit: LinearisedFit, rows: Lines, coefficients: Array) -> Array:
    """Return A R A^H / A A^H of rows of white errors, (r,)."""
    root = fit.error_root
    white = rows * root if root.ndim == 3 else (rows[..., None, :] @ root)[..., 0, :]
    lines = white.shape[2]
    power = (np.abs(white) ** 2).sum(axis=(1, 2, 3))
    lag = np.abs(np.arange(lines)[:, None] - np.arange(lines))
    R = coefficients[lag]
    through = R @ white
    total = (np.conj(white) * through).real.sum(axis=(1, 2, 3))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = total / power
    return np.asarray(np.where(power > 0, np.maximum(ratio, 1e-3), 1.0))
