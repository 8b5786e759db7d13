"""How far to trust a fit: the sandwich covariance of [WM] Theorem 1, and its variants."""

from dataclasses import dataclass
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np

from estimators.levels import check_level
from estimators.uncertainty.estimated_noise import meat_factor
from estimators.uncertainty.misfit import misfit
from estimators.uncertainty.model_error import empirical_parts, loss_factors, reduced_cost
from estimators.uncertainty.sandwich import sandwich
from estimators.uncertainty.theorem_1 import sandwich_parts
from robotmodels.arrays import Array, read_only
from robotmodels.errors import InvalidInput, nearest
from robotmodels.notebook import Printed

if TYPE_CHECKING:
    from estimators.fitting.least_squares import Fit

METHODS = {
    "theorem1": "Theorem 1",
    "empirical": "sandwich of empirical residuals",
    "scaled": "Theorem 1 scaled by the reduced cost",
}


@dataclass(frozen=True, eq=False)
class Uncertainty(Printed):
    """Covariance of ln theta, so that standard deviations are relative ones.

    Attributes
    ----------
    names : p parameters.
    covariance : (p, p) of ln theta [-].
    method : where it comes from.
    """

    names: tuple[str, ...]
    covariance: Array
    method: str

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
        object.__setattr__(self, "covariance", read_only(covariance))

    @property
    def std(self) -> Array:
        """Standard deviations of ln theta, (p,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def correlation(self) -> Array:
        """Correlations of ln theta, (p, p)."""
        std = self.std
        return np.asarray(self.covariance / np.outer(std, std))

    def interval(self, values: Array, level: float = 0.95) -> Array:
        """Return lower and upper ends, (p, 2), of the intervals about `values` (p,), SI units."""
        check_level(level, "interval")
        ends = log_normal_ends(np.asarray(values, dtype=float), self.std, level)
        return np.stack(ends, axis=-1)

    def __str__(self) -> str:
        width = max(len(name) for name in self.names)
        lines = [f"relative standard deviations, {self.method}"]
        lines += [
            f"  {name:<{width}}  {std:.4g}" for name, std in zip(self.names, self.std, strict=True)
        ]
        return "\n".join(lines)


def log_normal_ends(values: Array, std: Array, level: float) -> tuple[Array, Array]:
    """Return both ends of the intervals about medians `values` with std of their logarithms."""
    spread = np.exp(NormalDist().inv_cdf((1 + level) / 2) * std)
    return values / spread, values * spread


def covariance(
    fit: "Fit", method: str = "theorem1", lags: int | None = None, *, blocks: int | None = None
) -> Uncertainty:
    """Return the covariance of ln theta by the sandwich of [WM] Theorem 1, (5).

    Any residual and weights; a prior counts as the k more data it is. With a robust loss bread and
    meat have the factors of normal noise.

    Parameters
    ----------
    method : where the meat, the covariance of the cost's gradient, comes from. "theorem1": the
        estimate's covariance, at the fitted model; for log residuals the noise is eta/G to first
        order ([WM] below (7)). "scaled": that times the reduced cost, as if the noise had been
        stated too small by one factor. "empirical": the fit's own residuals, correlated over
        neighbouring frequencies as those of a model that is slightly wrong are; it asks nothing of
        the estimate's covariance, but needs many more lines than parameters, and is up to a third
        too small where few lines at a resonance carry the information.
    lags : frequencies over which empirical residuals are correlated; 4 (F/100)^(2/9), rounded
        down, where None (Newey and West 1994).
    blocks : independent FRFs that the estimate's covariance was made from; None if it is known
        exactly. Theorem 1 takes it to be. Where the weights are its inverse, standard deviations
        are larger by (blocks - 1)/sqrt((blocks - 1 - d)^2 - 1), d elements weighed together: by
        1.7 for single elements of 4 blocks, see `estimators.uncertainty.estimated_noise`. Combined
        weights, which follow it in part, are taken not to.

    Raises
    ------
    NotIdentifiable : if the information is singular, with the parameters in its null space.
    InvalidInput : for an unknown method, lags or blocks that it does not use, or too few blocks.
    SolverFailed : if the search could not begin.
    """
    _check_method(method, lags, blocks)
    names, prior = fit.parameters.names, fit.prior
    known = np.zeros((len(names),) * 2) if prior is None else prior.information(names)
    if method == "empirical":
        bread, meat = empirical_parts(fit, lags)
    else:
        bread, meat = sandwich_parts(fit)
        slope, square = loss_factors(fit.loss)
        bread, meat = slope * bread, square * meat
        if blocks is not None:
            meat = meat_factor(fit, blocks) * meat
    if method == "scaled":
        meat = (reduced_cost(fit) if blocks is None else misfit(fit, blocks).ratio) * meat
    note = "" if blocks is None else f", covariance of {blocks} blocks"
    note += _doubts(fit)
    return Uncertainty(
        names=names,
        covariance=sandwich(bread + known, meat + known, names),
        method=f"{METHODS[method]}, {fit.residual}{note}",
    )


def _doubts(fit: "Fit") -> str:
    """Return why a fit's covariance may not hold, in brackets; nothing if there is no reason."""
    said = [] if fit.converged else ["the fit has not converged"]
    if fit.at_bounds:
        said.append(f"at a bound, as if free: {', '.join(fit.at_bounds)}")
    return f" ({'; '.join(said)})" if said else ""


def _check_method(method: str, lags: int | None, blocks: int | None) -> None:
    if method not in METHODS:
        raise InvalidInput(
            f"covariance: method {method!r} is none of {', '.join(METHODS)}"
            f"{nearest(method, METHODS)}"
        )
    if lags is not None and method != "empirical":
        raise InvalidInput(f"covariance: lags = {lags} are used by 'empirical', not {method!r}")
    if blocks is not None and method == "empirical":
        raise InvalidInput(
            f"covariance: blocks = {blocks} given; 'empirical' asks nothing of the estimate's "
            "covariance"
        )
