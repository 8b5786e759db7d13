"""What a fit leaves unexplained: is it noise, and if not, where is it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimators.fitting.fitted_model import FittedModel
from estimators.frf.repeated_visits import visits_of
from estimators.trust.line_correlation import (
    LineCorrelation,
    correlation_of_residuals,
    lagged_products,
)
from estimators.trust.linearised_fit import LinearisedFit, Lines
from robotmodels.common.arrays import IMPROBABLE, Array, IntArray
from robotmodels.common.errors import InvalidInput
from robotmodels.common.printing import ReprHtml

LAGS = 5
# Probability that a position is called outlying though all is noise.
FALSE_ALARM = 0.01


@dataclass(frozen=True, eq=False)
class ResidualAnalysis(ReprHtml):
    """Squared residuals over what the noise lets expect after the fit, and tests of them.

    Attributes
    ----------
    ratio : float
        Ratio of all residuals, weighted by the noise; one if model and covariance are right.
    dof : tuple of float
        Degrees of freedom of its F law; the second is infinite where the noise is declared.
    p_value : float
        Probability of a ratio as large or larger, allowing for correlation along the lines.
    by_position : ndarray, (Q,)
        The same ratio by position, of all visits to it.
    by_element : ndarray, (m, n) or (m, E)
        The same by element of the FRF, or by output and run; not a number where none was used.
    autocorrelation : ndarray, (L,)
        Autocorrelation of the standardised residuals over 1 to L neighbouring frequencies.
    position_autocorrelation : ndarray, (Q,)
        Over one.
    whiteness_p_value : float
        Probability of such autocorrelations if the errors behind the residuals are white.
    outlying : ndarray of int, (k,)
        Positions whose ratio exceeds the positions' median by more than noise and the spread of the
        other positions explain.
    """

    ratio: float
    dof: tuple[float, float]
    p_value: float
    by_position: Array
    by_element: Array
    autocorrelation: Array
    position_autocorrelation: Array
    whiteness_p_value: float
    outlying: IntArray

    @property
    def explained(self) -> bool:
        """Whether noise as stated may well leave so much."""
        return self.p_value >= IMPROBABLE

    def __str__(self) -> str:
        lines = [
            f"squared residuals are {self.ratio:.4g} times what noise explains, "
            f"F({self.dof[0]:.0f}, {self.dof[1]:.0f}), p = {self.p_value:.3g}",
            f"autocorrelation over neighbouring frequencies {self.autocorrelation[0]:.3f}, "
            f"p = {self.whiteness_p_value:.3g}",
            "the ratio by position: " + ", ".join(f"{value:.3g}" for value in self.by_position),
        ]
        named = ", ".join(str(q) for q in self.outlying)
        lines.append(f"outlying positions (counted from 0): {named or 'none'}")
        return "\n".join(lines)


def residual_analysis(fit: FittedModel, lags: int = LAGS) -> ResidualAnalysis:
    """Return what a fit leaves unexplained, in units of the noise.

    Whatever the fit's weights, its residuals are judged by the noise of the estimate, with the
    degrees of freedom of its covariance; elements without weight do not count.

    Parameters
    ----------
    lags : int
        Neighbouring frequencies over which the autocorrelation is reported.

    Raises
    ------
    InvalidInput
        If there are fewer frequencies than lags, or fewer data than parameters.
    SolverFailed
        If the search could not begin.
    """
    fit.check_begun("residuals")
    problem = fit.problem
    frequencies = len(problem.omega)
    if not 1 <= lags < max(frequencies, 2):  # a single line has no neighbour
        raise InvalidInput(f"lags: {lags} for {frequencies} frequencies; 1 to F - 1 are possible")
    linear = fit.linearise()
    if linear.data <= len(linear.names):
        raise InvalidInput(
            f"residuals: {linear.data} data for {len(linear.names)} parameters leave none"
        )
    size, correlation = fit.misfit.size, fit.misfit.correlation
    square = linear.noise_weights * np.abs(linear.residuals) ** 2
    each = linear.noise_weights * linear.element_variances * (size.expected / _stated(linear))
    visits = visits_of(problem.positions)
    squares = _sums(square, visits)
    with np.errstate(invalid="ignore", divide="ignore"):
        by_position = squares / _sums(each, visits)
        by_element = problem.by_output(square.sum(axis=(0, 1)) / each.sum(axis=(0, 1)))
    products = lagged_products((np.sqrt(linear.noise_weights) * linear.residuals)[:, None], lags)
    return ResidualAnalysis(
        ratio=size.ratio,
        dof=(size.numerator, size.denominator),
        p_value=size.probability,
        by_position=by_position,
        by_element=by_element,
        autocorrelation=np.array([p.sum() for p in products]) / square.sum(),
        position_autocorrelation=_sums(products[0], visits) / np.maximum(squares, 1e-300),
        whiteness_p_value=_whiteness(linear, correlation),
        outlying=_outlying(by_position, linear, visits),
    )


def _whiteness(fit: LinearisedFit, errors: LineCorrelation) -> float:
    """Return the probability that residuals are white, beside what `find_correlation` returned."""
    by_residuals = fit.deviations is None and not len(fit.line_correlation)
    return (errors if by_residuals else correlation_of_residuals(fit)).probability


def _sums(values: Lines, visits: Sequence[IntArray]) -> Array:
    """Return the sums of values (V, F, k) over all visits to each position, (Q,)."""
    return np.array([values[rows].sum() for rows in visits])


def _stated(fit: LinearisedFit) -> float:
    return float((fit.noise_weights * fit.element_variances).sum())


def _outlying(ratio: Array, fit: LinearisedFit, visits: Sequence[IntArray]) -> IntArray:
    """Return which positions' ratio is too large beside the others'.

    Too large is what noise alone exceeds in one position of a hundred analyses (F law), and also
    four standard deviations of the spread between positions, which model errors widen.
    """
    from scipy.special import fdtri

    data = fit.parts * _sums(fit.used, visits)
    seen = data > 0
    middle = float(np.nanmedian(ratio))
    spread = 1.4826 * float(np.nanmedian(np.abs(ratio - middle)))
    freedom = fit.degrees_of_freedom[:, None, None]
    noise = np.minimum(fit.parts * _sums(np.where(fit.used, freedom, 0.0), visits), 1e9)
    chance = fdtri(np.where(seen, data, 1), np.maximum(noise, 1), 1 - FALSE_ALARM / len(ratio))
    limit = np.maximum(middle * chance, middle + 4 * spread)
    return np.flatnonzero(seen & (ratio > limit))
