"""Whether the residuals are as large as the noise makes them."""

from dataclasses import dataclass

import numpy as np

from estimators.trust.line_correlation import LineCorrelation, element_correlation
from estimators.trust.linearised_fit import LinearisedFit
from robotmodels.common.arrays import Array

SIZE_LEVEL = 0.005
"""Probability of a false alarm of the test of the residuals' size."""


@dataclass(frozen=True)
class ResidualSize:
    """Squared residuals over what the noise lets expect of them.

    Attributes
    ----------
    ratio : float
        Sum of the squared residuals, weighted by the noise, over its expectation after the fit.
    expected : float
        This expectation.
    numerator, denominator : float
        Degrees of freedom of the F law of this ratio; the second is infinite for declared noise.
    probability : float
        Probability of residuals as large or larger if there is only noise.
    probability_below : float
        Probability of residuals as small or smaller.
    """

    ratio: float
    expected: float
    numerator: float
    denominator: float
    probability: float
    probability_below: float

    @property
    def too_large(self) -> bool:
        """Whether residuals are larger than noise makes them; not a number counts as too large."""
        return not self.probability >= SIZE_LEVEL


def residual_size(fit: LinearisedFit, correlation: LineCorrelation) -> ResidualSize:
    """Return the ratio of totals, corrected for what the fit takes away, and its probability.

    sum w |r|^2 over sum w s^2 - 2 Re tr(w J A C) + tr(Re(J^H w J) V), with w the noise's weights
    and V the covariance of ln theta; for w of the fit's own this is sum w s^2 - tr(H V)/2. With
    a = w s^2 the numerator has 2 (sum a)^2 / sum a^2 nu/(nu + 1) degrees of freedom, as E s^4 =
    sigma^4 (nu + 1)/nu, and the denominator nu times as many; what errors of ln theta add to the
    sum lessens the numerator's.

    Declared noise makes the ratio chi square. With estimated noise few lines may carry most of the
    totals, whose F law is then wrong: there it is Fisher's combination -2 sum log p of the single
    residuals' probabilities that is chi square, for any nu and whatever the weights. Where elements
    or neighbouring lines are correlated, or lines share their noise, so many fewer of them count.
    """
    from scipy.special import gammainc, gammaincc

    fit = fit.noise_fit
    w, nu = fit.noise_weights, fit.degrees_of_freedom[:, None, None]
    a = w * fit.element_variances
    square = a**2 / (1 + 1 / nu)
    dependence = element_correlation(fit) * correlation.inflation * fit.sharing
    taken, spread = _taken_by_fit(fit)
    expected = fit.parts / 2 * float(a.sum()) - taken
    ratio = fit.squares / expected if expected > 0 else np.nan
    size = fit.parts * float(a.sum()) ** 2 / dependence
    numerator, scatter = size / float(square.sum()), float((square / nu).sum())
    numerator = 1 / (1 / numerator + spread / expected**2)
    if scatter == 0:
        denominator, half, statistic = np.inf, numerator / 2, ratio * numerator / 2
    else:
        denominator, half = size / scatter, int(fit.used.sum()) / dependence
        with np.errstate(divide="ignore"):
            statistic = -float(np.log(line_probabilities(fit)).sum()) / dependence
    above, below = float(gammaincc(half, statistic)), float(gammainc(half, statistic))
    return ResidualSize(ratio, expected, numerator, denominator, above, below)


def _taken_by_fit(fit: LinearisedFit) -> tuple[float, float]:
    """Return by how much the fit lowers the expectation of sum w |r|^2, and tr((N V)^2).

    The second is half of the variance of d^T N d, which errors d of ln theta add to the sum: little
    for the noise's own weights, much for others.
    """
    w, J, rows = fit.noise_weights, fit.jacobian, fit.rows
    if fit.deviations is not None:
        scores = fit.line_scores(rows)
        back = fit.line_scores(np.moveaxis(np.conj(J) * w[..., None], -1, 0))
        cross = float((np.conj(scores) * back).real.sum())
        V = np.einsum("aqrf,bqrf->ab", scores, np.conj(scores), optimize=True).real / 2
    else:
        diagonal = fit.covariance.ndim == 3
        through = (
            rows * fit.covariance
            if diagonal
            else np.einsum("aqfi,qfij->aqfj", rows, fit.covariance)
        )
        cross = float((np.moveaxis(through, 0, -1) * J * w[..., None]).real.sum())
        V = np.einsum("aqfi,bqfi->ab", through, np.conj(rows), optimize=True).real / 2
    flat = J.reshape(-1, J.shape[-1])
    normal = (np.conj(flat).T @ (w.reshape(-1, 1) * flat)).real
    through = normal @ V
    return cross - float(np.trace(through)), float(np.sum(through * through.T))


def typical_size(fit: LinearisedFit) -> float:
    """Return the squared residuals over the noise as their median tells, which outliers spare."""
    nu = np.minimum(fit.degrees_of_freedom, 1e9)
    medians = nu * np.expm1(np.log(2) / nu)
    if fit.real:
        from scipy.special import fdtri

        medians = fdtri(1, nu, 0.5) / 2
    used = fit.used
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.abs(fit.errors) ** 2 / (fit.element_variances * medians[:, None, None])
    return float(np.median(ratio[used])) if used.any() else np.nan


def line_probabilities(fit: LinearisedFit, factor: Array | float = 1.0) -> Array:
    """Return the probability (Q, F, k) of residuals as large as each, exact for any nu.

    Of |r|^2 over s^2 with nu complex degrees of freedom 2 nu log(1 + |r|^2/(nu s^2)) is chi square
    with two. The fit's share of each residual is left out; s^2 is multiplied by `factor`.
    """
    s2 = fit.element_variances
    nu = fit.degrees_of_freedom[:, None, None]
    ratio = np.abs(fit.errors) ** 2 / (s2 * factor)
    if fit.real:
        ratio = 2 * ratio
        from scipy.special import fdtrc

        return np.where(fit.used, fdtrc(1, np.minimum(nu, 1e9), ratio), 1.0)
    with np.errstate(invalid="ignore", over="ignore"):
        estimated = (1 + ratio / nu) ** -nu
    return np.where(fit.used, np.where(np.isfinite(nu), estimated, np.exp(-ratio)), 1.0)
