"""How far to trust a fit: the sandwich covariance of [WM] Theorem 1, and its variants."""

from dataclasses import dataclass

import numpy as np

from estimators.fitting.fitted_model import FittedModel
from estimators.fitting.residuals import loss_factors
from estimators.trust.line_correlation import white_errors
from estimators.trust.line_scatter import line_scatter
from estimators.trust.linearised_fit import sandwich
from estimators.trust.residual_size import residual_size
from robotmodels.common.arrays import Array, check_kind, check_level, read_only
from robotmodels.common.errors import InvalidInput, SolverFailed, check_word
from robotmodels.common.printing import ReprHtml
from robotmodels.common.symmetric_matrices import scaled_eigh, unit_diagonal_scaling

_NEGATIVE = 1e-6
"""An eigenvalue of the correlation that is lower is no rounding error."""

METHODS = {
    "theorem1": "Theorem 1",
    "empirical": "sandwich of empirical residuals",
    "scaled": "Theorem 1 scaled by the size of the residuals",
}


@dataclass(frozen=True, eq=False)
class Uncertainty(ReprHtml):
    """Covariance of ln theta, so that standard deviations are relative ones.

    Attributes
    ----------
    names : tuple of str
        p parameters.
    covariance : ndarray, (p, p), dimensionless
        Covariance of ln theta.
    method : str
        Where it comes from.
    degrees_of_freedom : ndarray, (p,)
        Real degrees of freedom of the variances; infinite where the noise is declared.
    """

    names: tuple[str, ...]
    covariance: Array
    method: str
    # One number stands for all; an array from __post_init__ on.
    degrees_of_freedom: Array = np.inf  # type: ignore[assignment]

    def __post_init__(self) -> None:
        covariance = np.array(self.covariance, dtype=float)
        p = len(self.names)
        if covariance.shape != (p, p):
            raise InvalidInput(
                f"uncertainty: a covariance of shape {covariance.shape} for {p} parameters"
            )
        wrong = ~(np.isfinite(np.diag(covariance)) & (np.diag(covariance) >= 0))
        if wrong.any():
            i = int(np.argmax(wrong))
            raise InvalidInput(
                f"uncertainty: the variance of {self.names[i]} is {covariance[i, i]:g}"
            )
        _, eigenvalues, _ = scaled_eigh(covariance)
        if eigenvalues[0] < -_NEGATIVE:
            raise InvalidInput("uncertainty: the covariance has negative eigenvalues")
        object.__setattr__(self, "covariance", read_only(covariance))
        freedom = np.broadcast_to(np.asarray(self.degrees_of_freedom, dtype=float), (p,)).copy()
        object.__setattr__(self, "degrees_of_freedom", read_only(freedom))

    @property
    def std(self) -> Array:
        """Standard deviations of ln theta, (p,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def correlation(self) -> Array:
        """Correlations of ln theta, (p, p); zero where nothing varies."""
        s = unit_diagonal_scaling(self.covariance)
        return np.asarray(s[:, None] * self.covariance * s)

    def interval(self, values: Array, level: float = 0.95) -> Array:
        """Return lower and upper ends, (p, 2), of the intervals about `values` (p,), SI units."""
        check_level(level, "interval")
        values = np.asarray(values, dtype=float)
        spread = np.exp(self.quantile(level) * self.std)
        return np.stack([values / spread, values * spread], axis=-1)

    def quantile(self, level: float) -> Array:
        """Return the standard deviations to either end of a two-sided interval, (p,), t law."""
        from scipy.special import stdtrit

        return np.asarray(stdtrit(self.degrees_of_freedom, (1 + level) / 2))

    def __str__(self) -> str:
        width = max(len(name) for name in self.names)
        lines = [f"relative standard deviations, {self.method}"]
        lines += [
            f"  {name:<{width}}  {std:.4g}" for name, std in zip(self.names, self.std, strict=True)
        ]
        return "\n".join(lines)


def covariance(fit: FittedModel, method: str = "theorem1", lags: int | None = None) -> Uncertainty:
    """Return the covariance of ln theta by the sandwich of [WM] Theorem 1, (5).

    $P = H^-1 J H^-1$, with the bread $H = 2 Re sum_k conj(Psi_k) W_k Psi_k^T$ and the meat
    $J = 2 Re sum_k conj(Psi_k) W_k Lambda_k W_k Psi_k^T$ over positions and lines k: $Psi_k$ is
    the derivative of vec G by ln theta, $W_k$ the weight, $Lambda_k$ the covariance of the errors.

    Any residual and weights; a prior counts as the k more data it is. With a robust loss bread and
    meat have the factors of normal noise. Variances have the degrees of freedom of the estimate's
    covariance, each line's weighed by what it adds (Satterthwaite 1946).

    Parameters
    ----------
    method : {"theorem1", "scaled", "empirical"}
        Where the meat, the covariance of the cost's gradient, comes from. "theorem1": the
        estimate's covariance, at the fitted model; for log residuals the noise is eta/G to first
        order ([WM] below (7)). "scaled": that times the size of the residuals beside the noise, as
        if the noise had been stated too small by one factor. "empirical": the residuals of the fit,
        correlated over neighbouring frequencies; it asks nothing of the estimate's covariance, but
        is far too small where few lines carry the information (4 times in the median of small
        studies, 13 times at worst; its intervals cover 74 to 87 % of the time), and no cure for
        model errors: see `Fit.intervals` for what to quote.
    lags : int, optional
        Frequencies over which empirical residuals are correlated; 4 (F/100)^(2/9), rounded down,
        where None (Newey and West 1994).

    Raises
    ------
    NotIdentifiable
        If the information is singular, with the parameters in its null space.
    InvalidInput
        For an unknown method, or lags that it does not use.
    SolverFailed
        If the search could not begin.
    """
    check_kind(fit, FittedModel, "covariance: fit")
    _check_method(method, lags)
    if method == "scaled" and fit.loss != "linear":
        raise InvalidInput(f"covariance: loss {fit.loss!r}; 'scaled' is defined for 'linear' only")
    names, prior = fit.parameters.names, fit.prior
    prior_information = np.zeros((len(names),) * 2) if prior is None else prior.information(names)
    freedom = np.full(len(names), np.inf)
    if method == "empirical":
        bread, meat = empirical_parts(fit, lags)
    else:
        bread, meat = fit.sandwich_parts()
        slope, square = loss_factors(fit.loss)
        bread, meat = slope * bread, square * meat
    whole = sandwich(bread + prior_information, meat + prior_information, names)
    if method != "empirical":
        linear, white = fit.linearise(), white_errors(len(fit.problem.omega))
        freedom = line_scatter(linear, linear.rows, white).degrees_of_freedom
        if method == "scaled":
            whole = sandwich(
                bread + prior_information,
                residual_size(linear, white).ratio * meat + prior_information,
                names,
            )
    return Uncertainty(names, whole, f"{METHODS[method]}, {fit.residual}{_doubts(fit)}", freedom)


def _doubts(fit: FittedModel) -> str:
    """Return why a fit's covariance may not hold, in brackets; nothing if there is no reason."""
    doubts = [] if fit.converged else ["the fit has not converged"]
    if fit.at_bounds:
        doubts.append(f"at a bound, as if free: {', '.join(fit.at_bounds)}")
    return f" ({'; '.join(doubts)})" if doubts else ""


def _check_method(method: str, lags: int | None) -> None:
    check_word("covariance: method", method, METHODS)
    if lags is not None and method != "empirical":
        raise InvalidInput(f"covariance: lags = {lags} are used by 'empirical', not {method!r}")


def empirical_parts(fit: FittedModel, lags: int | None = None) -> tuple[Array, Array]:
    """Return bread and meat, (p, p), from the residuals themselves, without the prior.

    With s_f the gradient of one frequency's part of the cost, in one position, the meat is
    sum_q sum_f sum_l (1 - |l|/(L + 1)) s_f s_(f+l)^T over lags |l| <= L (Newey and West 1987),
    with every residual divided by one minus its leverage, as the fit is nearest where it leans most
    (MacKinnon and White 1985).

    Raises
    ------
    InvalidInput
        If `lags` is negative, or there are no more lines than parameters.
    SolverFailed
        If the search could not begin.
    """
    if not np.isfinite(fit.cost):
        raise SolverFailed(f"no covariance without a fit: {fit.message}")
    problem = fit.problem
    positions, frequencies = len(problem.positions), len(problem.omega)
    p, lines = len(fit.parameters), positions * frequencies
    window = int(4 * (frequencies / 100) ** (2 / 9)) if lags is None else lags
    if window < 0 or lines <= p:
        raise InvalidInput(
            f"covariance: {window} lags, {lines} lines for {p} parameters; an empirical covariance "
            "needs lags >= 0 and more lines than parameters"
        )
    error, slope = problem.evaluate(fit.parameters.values)
    prior_rows = 0 if fit.prior is None else len(fit.prior.names)
    error, slope = error[: len(error) - prior_rows], slope[: len(error) - prior_rows]
    _, first, second = problem.robust(error**2)
    bread = 2 * (slope.T * (first + 2 * second * error**2)) @ slope
    parts = 1 if problem.real else 2
    leverage = np.einsum("rp,pq,rq->r", slope, 2 * np.linalg.pinv(bread, hermitian=True), slope)
    shrunk = error / (1 - np.clip(first * leverage, 0.0, 0.99))
    scores = 2 * slope * (first * shrunk)[:, None]
    by_line = scores.reshape(parts, positions, frequencies, -1, p).sum(axis=(0, 3))
    meat = np.einsum("qfi,qfj->ij", by_line, by_line)
    for lag in range(1, min(window, frequencies - 1) + 1):
        pairs = np.einsum("qfi,qfj->ij", by_line[:, :-lag], by_line[:, lag:])
        meat += (1 - lag / (window + 1)) * (pairs + pairs.T)
    return bread, meat
