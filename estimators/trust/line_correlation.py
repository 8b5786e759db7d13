"""Whether errors are correlated along the lines, and by how much: deviations, or residuals."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.trust.linearised_fit import LinearisedFit, Lines
from robotmodels.common.arrays import Array

LAGS = 5
"""Lags of the test of whiteness."""

FALSE_ALARM = 0.002
"""Probability with which white errors are called correlated; the sums are only about normal."""

_HIGHEST_ORDER = 6
_ORDER_LIMIT = 3.0  # a partial autocorrelation counts from so many standard deviations on


@dataclass(frozen=True, eq=False)
class LineCorrelation:
    """Correlation of whitened errors along the lines.

    Attributes
    ----------
    probability : float
        Probability of lagged products as large if the errors are white.
    coefficients : ndarray, (F,)
        Correlation at lags 0 to F - 1, of an autoregressive process; 1, 0, 0, ... where white.
    variance : float
        Variance of a whitened error, by the residuals; one where deviations were looked at.
    data : float
        Real numbers that this was estimated from.
    """

    probability: float
    coefficients: Array
    variance: float
    data: float

    @property
    def white(self) -> bool:
        """Whether the errors may well be white."""
        return self.probability >= FALSE_ALARM

    @property
    def inflation(self) -> float:
        """One plus twice the sum of squared correlations: by this degrees of freedom shrink."""
        return float(1 + 2 * np.sum(self.coefficients[1:] ** 2))


def declared_correlation(fit: LinearisedFit) -> LineCorrelation:
    """Return the correlation that the estimator of the FRF made."""
    lines = fit.residuals.shape[1]
    return LineCorrelation(0.0, _padded(fit.line_correlation, lines), 1.0, np.inf)


def white_errors(lines: int) -> LineCorrelation:
    """Return the correlation of white errors."""
    return LineCorrelation(1.0, _padded(np.empty(0), lines), 1.0, np.inf)


def correlation_of_deviations(fit: LinearisedFit) -> LineCorrelation:
    """Return the correlation along lines of what differs between blocks.

    Blind to errors of the model, which every block has alike. Each pair of lines has a sample
    correlation, whatever their variances, and the mean over pairs is corrected for its bias.
    """
    assert fit.deviations is not None
    with np.errstate(divide="ignore"):
        root = np.where(fit.used, 1 / np.sqrt(fit.element_variances), 0.0)
    white = root[:, None] * fit.deviations
    lines = white.shape[2]
    lags = min(lines - 1, max(LAGS, _HIGHEST_ORDER))
    products = lagged_products(white, lags)
    probability = _portmanteau(products[:LAGS])
    counts = fit.used.sum(axis=(1, 2))
    draws = fit.parts * fit.degrees_of_freedom
    data = float((draws * counts).sum()) / element_correlation(fit)
    if probability >= FALSE_ALARM:
        return LineCorrelation(probability, _padded(np.empty(0), lines), 1.0, data)
    pairs = np.array([(fit.used[:, lag:] & fit.used[:, :-lag]).sum() for lag in range(1, lags + 1)])
    means = np.array([p.sum() for p in products]) / np.maximum(pairs, 1)
    # Positions may have different degrees of freedom; the mean correlation is that of their mean.
    correlations = _unbiased(means, float((draws * counts).sum() / counts.sum()))
    return LineCorrelation(probability, autoregressive(correlations, data, lines), 1.0, data)


def _unbiased(correlations: Array, draws: float) -> Array:
    """Return correlations whose sample correlations over so many real draws have these means.

    E r = rho (2/n) (Gamma((n + 1)/2)/Gamma(n/2))^2 2F1(1/2, 1/2; n/2 + 1; rho^2), the mean of the
    sample correlation of normal variables (without subtraction of means).
    """
    from scipy.special import gammaln, hyp2f1

    rho = np.linspace(-0.999, 0.999, 400)
    factor = 2 / draws * np.exp(2 * (gammaln((draws + 1) / 2) - gammaln(draws / 2)))
    return np.interp(correlations, rho * factor * hyp2f1(0.5, 0.5, draws / 2 + 1, rho**2), rho)


def correlation_of_residuals(fit: LinearisedFit) -> LineCorrelation:
    """Return the correlation along lines of the errors behind the residuals.

    The fit makes residuals less correlated than errors are: autocovariances c of r = (I - P) e have
    the expectation B gamma, with gamma those of e, which is solved for gamma.
    """
    root, J = np.sqrt(fit.noise_weights), fit.jacobian
    white = (root * fit.residuals)[:, None]
    lines, p = white.shape[2], J.shape[-1]
    lags = min(lines // 3, max(LAGS, _HIGHEST_ORDER))
    products = lagged_products(white, lags)
    c = np.array([float((np.abs(white) ** 2).sum()), *(2 * q.sum() for q in products)])
    B = _corrections(fit, root[..., None] * J, fit.rows, root, lags)
    gamma = 2 * np.linalg.lstsq(B, c, rcond=None)[0]  # half of the power in each real number
    data = float(fit.data)
    # What the fit takes away makes lagged products negative on average.
    mean = B[1:, 0] * gamma[0] / 4
    probability = _portmanteau(products[:LAGS], mean[:LAGS])
    if probability >= FALSE_ALARM or not gamma[0] > 0:
        coefficients = _padded(np.empty(0), lines)
        return LineCorrelation(probability, coefficients, float(gamma[0]), data - p)
    coefficients = autoregressive(gamma[1:] / gamma[0], data, lines)
    effective = data / float(1 + 2 * np.sum(coefficients[1:] ** 2)) - p
    return LineCorrelation(probability, coefficients, float(gamma[0]), effective)


def lagged_products(white: Lines, lags: int) -> list[Array]:
    """Return Re(conj(x_f) x_(f+l)), summed over elements, (Q, R, F - l), for lags 1 to `lags`."""
    return [
        np.asarray((np.conj(white[:, :, :-lag]) * white[:, :, lag:]).real.sum(axis=-1))
        for lag in range(1, lags + 1)
    ]


def _portmanteau(products: list[Array], means: Array | None = None) -> float:
    """Return the probability of sums of lagged products, each over the root of its squares."""
    from scipy.special import chdtrc

    statistic = 0.0
    for lag, product in enumerate(products):
        square = float((product**2).sum())
        shift = 0.0 if means is None else float(means[lag])
        statistic += (float(product.sum()) - shift) ** 2 / square if square > 0 else 0.0
    return float(chdtrc(len(products), statistic))


def element_correlation(fit: LinearisedFit) -> float:
    """Return the factor by which correlated elements lessen the number of independent data.

    sum |d_f^H d_(f+h)|^2 over the sum of the products of variances, of draws d of lines h apart,
    whose errors are independent even where neighbours are not; or the same of stated covariances.
    """
    root = np.sqrt(fit.noise_weights)
    if fit.deviations is None:
        if fit.covariance.ndim == 3:
            return 1.0
        white = root[..., :, None] * fit.covariance * root[..., None, :]
        squares = float((np.abs(white) ** 2).sum())
        diagonal = np.diagonal(white, axis1=-2, axis2=-1).real
        return _at_least_one(squares, float((diagonal**2).sum()))
    draws = (root[:, None] * fit.deviations).transpose(0, 2, 1, 3)  # (Q, F, R, k)
    lag = min(5, draws.shape[1] - 1)
    if lag < 1:
        return 1.0
    # All pairs of draws, so that few blocks suffice.
    inner = np.conj(draws[:, :-lag]) @ np.swapaxes(draws[:, lag:], -1, -2)
    power = (np.abs(draws) ** 2).sum(axis=2)
    total = float((power[:, :-lag] * power[:, lag:]).sum())
    return _at_least_one(float((np.abs(inner) ** 2).sum()), total)


def _at_least_one(squares: float, total: float) -> float:
    return max(1.0, squares / total) if total > 0 else 1.0


def _corrections(fit: LinearisedFit, columns: Lines, rows: Lines, root: Array, lags: int) -> Array:
    """Return B, (L + 1, L + 1): B_ij = tr(S_i (I - P) S_j (I - P)^T) with P = J A, whitened.

    S_0 is the identity, S_l has ones where lines are l apart.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        white_rows = np.where(root > 0, rows / np.where(root > 0, root, 1.0), 0.0)
    used = (root > 0)[:, :, None, :, None]
    single, inner, outer = np.zeros((lags + 1, lags + 1)), np.zeros(()), np.zeros(())
    for q in range(len(columns)):  # of all positions the shifted arrays would leave the cache
        at = slice(q, q + 1)
        J, A = _real(columns[at]), _real(np.conj(np.moveaxis(white_rows[:, at], 0, -1)))
        shifted = np.stack([_shift(J, lag) * used[at] for lag in range(lags + 1)])
        shifted_rows = np.stack([_shift(A, lag) * used[at] for lag in range(lags + 1)])
        single += shifted.reshape(lags + 1, -1) @ shifted_rows.reshape(lags + 1, -1).T
        inner, outer = inner + _products(J, shifted), outer + _products(shifted_rows, A)
    # tr(J^T S_i J A S_j A^T) of (p, p) matrices; single ones are tr(A S_j S_i J).
    double = inner.reshape(lags + 1, -1) @ outer.reshape(lags + 1, -1).T
    pairs = [_pairs(root > 0, lag) * fit.parts for lag in range(lags + 1)]
    return np.asarray(np.diag(pairs) - 2 * single + double)


def _real(values: Lines) -> Array:
    """Return real and imaginary parts (Q, F, 2, k, p) of values (Q, F, k, p)."""
    return np.stack([values.real, values.imag], axis=2)


def _products(left: Array, right: Array) -> Array:
    """Return left^T right, (L + 1, p, p), one of them without the axis of lags."""
    p = left.shape[-1]
    first = left.reshape(*left.shape[:-5], -1, p)
    return np.asarray(np.swapaxes(first, -1, -2) @ right.reshape(*right.shape[:-5], -1, p))


def _pairs(used: NDArray[np.bool_], lag: int) -> float:
    """Return tr(S_l S_l): ordered pairs of used elements l lines apart."""
    if lag == 0:
        return float(used.sum())
    return 2.0 * float((used[:, lag:] & used[:, :-lag]).sum())


def _shift(values: Lines, lag: int) -> Lines:
    """Return S_l values along the axis of lines."""
    if lag == 0:
        return values
    result = np.zeros_like(values)
    result[:, lag:] += values[:, :-lag]
    result[:, :-lag] += values[:, lag:]
    return result


def autoregressive(correlations: Array, data: float, lines: int) -> Array:
    """Return the correlations 0 to `lines` - 1 of the autoregressive process of significant order.

    The order is the highest whose partial autocorrelation exceeds three standard deviations of
    white data (Levinson and Durbin).
    """
    limit = _ORDER_LIMIT / np.sqrt(data)
    order, model, best = 0, np.empty(0), np.empty(0)
    error = 1.0
    for k in range(1, min(len(correlations), _HIGHEST_ORDER) + 1):
        reflection = (correlations[k - 1] - model @ correlations[: k - 1][::-1]) / error
        reflection = float(np.clip(reflection, -0.999, 0.999))
        model = np.append(model - reflection * model[::-1], reflection)
        error *= 1 - reflection**2
        if abs(reflection) > limit:
            order, best = k, model
    result = np.zeros(lines)
    result[0] = 1.0
    copied = min(order, lines - 1)
    result[1 : copied + 1] = correlations[:copied]
    for lag in range(copied + 1, lines):
        result[lag] = best @ result[lag - order : lag][::-1] if order else 0.0
    return result


def _padded(correlations: Array, lines: int) -> Array:
    result = np.zeros(lines)
    result[0] = 1.0
    result[1 : len(correlations) + 1] = correlations[: lines - 1]
    return result
