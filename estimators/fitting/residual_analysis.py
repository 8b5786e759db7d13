"""What a fit leaves unexplained: is it noise, and if not, where is it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.fitting.least_squares import Fit, problem_of
from estimators.frf.estimate import is_full, unvec, vec
from estimators.levels import IMPROBABLE
from estimators.uncertainty.model_error import reduced_cost
from robotmodels.arrays import Array, IntArray
from robotmodels.errors import InvalidInput, SolverFailed
from robotmodels.notebook import Printed
from robotmodels.response import frequency_response

LAGS = 5
# Probability that a position is called outlying though all is noise.
FALSE_ALARM = 0.01


@dataclass(frozen=True, eq=False)
class ResidualAnalysis(Printed):
    """Residuals in standard deviations of the estimate's covariance, and tests of them.

    Attributes
    ----------
    chi2, dof : sum of the squared standardised residuals (real and imaginary parts), and what it
        is on average if model and covariance are right: real data minus parameters.
    p_value : probability of a chi^2 as large if they are. Exact for optimal weights; other weights
        make the fit, hence chi^2, a little worse.
    reduced_cost : the fit's own cost over its mean; not a number for a robust loss.
    position_chi2, position_dof : (Q,) the same by position.
    element_chi2, element_dof : (m, n) the same by element; not a number where none was used.
        Each element by itself, correlated or not.
    autocorrelation : (L,) of the standardised residuals over 1 to L neighbouring frequencies.
    position_autocorrelation : (Q,) over one.
    whiteness_p_value : probability of such autocorrelations if residuals are white (Box and Pierce
        1970).
    outlying : positions whose chi^2 per degree of freedom exceeds the positions' median by more
        than noise and the spread of the other positions explain.
    """

    chi2: float
    dof: float
    p_value: float
    reduced_cost: float
    position_chi2: Array
    position_dof: Array
    element_chi2: Array
    element_dof: Array
    autocorrelation: Array
    position_autocorrelation: Array
    whiteness_p_value: float
    outlying: IntArray

    @property
    def explained(self) -> bool:
        """Whether noise as stated may well leave so much."""
        return self.p_value >= IMPROBABLE

    def __str__(self) -> str:
        by_position = self.position_chi2 / self.position_dof
        lines = [
            f"chi^2 {self.chi2:.6g} for {self.dof:.0f} degrees of freedom, p = {self.p_value:.3g}; "
            f"reduced cost {self.reduced_cost:.4g}",
            f"autocorrelation over neighbouring frequencies {self.autocorrelation[0]:.3f}, "
            f"p = {self.whiteness_p_value:.3g}",
            "chi^2 per degree of freedom by position: "
            + ", ".join(f"{value:.3g}" for value in by_position),
        ]
        named = ", ".join(str(q) for q in self.outlying)
        lines.append(f"outlying positions (counted from 0): {named or 'none'}")
        return "\n".join(lines)


def residual_analysis(fit: Fit, lags: int = LAGS) -> ResidualAnalysis:
    """Return what a fit leaves unexplained, in standard deviations of the estimate's covariance.

    Whatever the fit's weights, its residuals are judged by the noise; elements without weight are
    left out. Correlations between elements are taken into account if the weights have them.

    Parameters
    ----------
    lags : neighbouring frequencies over which the autocorrelation is tested.

    Raises
    ------
    InvalidInput : if there are fewer frequencies than lags, or fewer data than parameters.
    SolverFailed : if the search could not begin.
    """
    from scipy.stats import chi2

    if not np.isfinite(fit.cost):
        raise SolverFailed(f"no residuals without a fit: {fit.message}")
    frequencies = len(fit.estimate.omega)
    if not 1 <= lags < frequencies:
        raise InvalidInput(f"lags: {lags} for {frequencies} frequencies; 1 to F - 1 are possible")
    z, alone, used = _standardised(fit)
    parts = 1 if problem_of(fit).kind.real else 2
    data, p = parts * int(used.sum()), len(fit.parameters)
    if data <= p:
        raise InvalidInput(f"residuals: {data} data for {p} parameters leave none")
    left = (data - p) / data  # of each datum, on average
    square = np.abs(z) ** 2
    total, by_position = float(square.sum()), square.sum(axis=(1, 2, 3))
    position_dof = left * parts * used.sum(axis=(1, 2, 3))
    element_count = used.sum(axis=(0, 1))
    element_dof = np.where(element_count > 0, left * parts * element_count, np.nan)
    correlation, whiteness = _whiteness(z, used, lags, parts)
    return ResidualAnalysis(
        chi2=total,
        dof=float(data - p),
        p_value=float(chi2.sf(total, data - p)),
        reduced_cost=reduced_cost(fit) if fit.loss == "linear" else np.nan,
        position_chi2=by_position,
        position_dof=position_dof,
        element_chi2=np.where(element_count > 0, (np.abs(alone) ** 2).sum(axis=(0, 1)), np.nan),
        element_dof=element_dof,
        autocorrelation=correlation.sum(axis=0) / total,
        position_autocorrelation=correlation[:, 0] / np.where(by_position > 0, by_position, 1.0),
        whiteness_p_value=whiteness,
        outlying=_outlying(by_position, position_dof),
    )


def _standardised(fit: Fit) -> tuple[NDArray[Any], NDArray[Any], NDArray[np.bool_]]:
    """Return residuals (Q, F, m, n) whose real and imaginary parts have variance one.

    Whitened as the weights couple elements, then each by itself, then which elements are used.
    Zero where not used.
    """
    problem, estimate = problem_of(fit), fit.estimate
    used, shape = problem.used, estimate.response.shape
    values = fit.parameters.values
    G = np.asarray(frequency_response(fit.model, estimate.positions, estimate.omega, values))
    error = np.sqrt(2) * problem.kind.error(estimate.response, G, used)
    noise = problem.kind.noise(estimate.covariance, G, used)
    if not is_full(noise, shape):
        alone = np.where(used, error / np.sqrt(noise), 0.0)
        return alone, alone, used
    variance = unvec(np.diagonal(noise, axis1=-2, axis2=-1).real, shape[-2])
    alone = np.where(used, error / np.sqrt(variance), 0.0)
    if not is_full(fit.weights, shape):
        return alone, alone, used
    kept = vec(used)
    pairs = kept[..., :, None] & kept[..., None, :]
    root = np.linalg.cholesky(np.where(pairs, noise, np.eye(kept.shape[-1])))
    vector = vec(np.where(used, error, 0.0))[..., None]
    return unvec(np.linalg.solve(root, vector)[..., 0], shape[-2]), alone, used


def _whiteness(
    z: NDArray[Any], used: NDArray[np.bool_], lags: int, parts: int
) -> tuple[Array, float]:
    """Return sums of lagged products (Q, L), and the probability of such sums of white residuals.

    A product of two independent residuals has the variance `parts`.
    """
    from scipy.stats import chi2

    sums, statistic = np.empty((len(z), lags)), 0.0
    for lag in range(1, lags + 1):
        both = used[:, lag:] & used[:, :-lag]
        products = np.where(both, (np.conj(z[:, :-lag]) * z[:, lag:]).real, 0.0)
        sums[:, lag - 1] = products.sum(axis=(1, 2, 3))
        statistic += products.sum() ** 2 / max(parts * int(both.sum()), 1)
    return sums, float(chi2.sf(statistic, lags))


def _outlying(squares: Array, dof: Array) -> IntArray:
    """Return which positions' chi^2 per degree of freedom is too large beside the others'.

    Too large is what noise alone exceeds in one position of a hundred analyses, and also four
    standard deviations of the positions' own spread, which model errors widen.
    """
    from scipy.stats import chi2

    seen = dof > 0
    ratio = np.where(seen, squares / np.where(seen, dof, 1.0), np.nan)
    middle = float(np.nanmedian(ratio))
    spread = 1.4826 * float(np.nanmedian(np.abs(ratio - middle)))
    chance = chi2.isf(FALSE_ALARM / len(dof), np.where(seen, dof, 1.0)) / np.where(seen, dof, 1.0)
    limit = np.maximum(middle * chance, middle + 4 * spread)
    return np.flatnonzero(seen & (ratio > limit))
