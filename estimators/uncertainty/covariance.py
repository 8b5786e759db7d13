"""How far to trust a fit: the sandwich covariance of [WM] Theorem 1, and its variants."""

from dataclasses import dataclass
from statistics import NormalDist
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from estimators.fisher_information import information
from estimators.fitting.residuals import find_residual
from estimators.fitting.weights import used_elements
from estimators.frf.estimate import is_full, vec
from estimators.levels import check_level
from robotmodels.arrays import Array, read_only
from robotmodels.errors import InvalidInput, NotIdentifiable, SolverFailed, nearest
from robotmodels.notebook import Printed
from robotmodels.response import sensitivity

if TYPE_CHECKING:
    from estimators.fitting.least_squares import Fit

# Relative eigenvalues of the scaled information below this are rounding errors of the FRFs:
# a standard deviation a million times that of a parameter alone.
SINGULAR = 1e-12
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


def covariance(fit: "Fit", method: str = "theorem1", lags: int | None = None) -> Uncertainty:
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

    Raises
    ------
    NotIdentifiable : if the information is singular, with the parameters in its null space.
    InvalidInput : for an unknown method.
    SolverFailed : if the search could not begin.
    """
    from estimators.uncertainty import model_error

    names, prior = fit.parameters.names, fit.prior
    known = np.zeros((len(names),) * 2) if prior is None else prior.information(names)
    if method == "empirical":
        bread, meat = model_error.empirical_parts(fit, lags)
    elif method in METHODS:
        bread, meat = sandwich_parts(fit)
        slope, square = model_error.loss_factors(fit.loss)
        bread, meat = slope * bread, square * meat
    else:
        raise InvalidInput(
            f"covariance: method {method!r} is none of {', '.join(METHODS)}"
            f"{nearest(method, METHODS)}"
        )
    if method == "scaled":
        meat = model_error.reduced_cost(fit) * meat
    note = "" if fit.converged else " (the fit has not converged)"
    return Uncertainty(
        names=names,
        covariance=sandwich(bread + known, meat + known, names),
        method=f"{METHODS[method]}, {fit.residual}{note}",
    )


def sandwich_parts(fit: "Fit") -> tuple[Array, Array]:
    """Return bread and meat of (5), (p, p): Hessian of the cost, covariance of its gradient.

    With Psi the residual's Jacobian, W its weights and R its noise covariance, bread is
    2 sum Re(conj(Psi) W Psi^T) and meat 2 sum Re(conj(Psi) W R W Psi^T). For log residuals
    Psi = G_d^-1 Psi_G and R = G_d^-1 Lambda_0 G_d^-H, which is [WM]'s Xi and Sigma regrouped.
    Neither the prior nor a robust loss is in them.

    Raises
    ------
    SolverFailed : if the search could not begin.
    """
    if not np.isfinite(fit.cost):
        raise SolverFailed(f"no covariance without a fit: {fit.message}")
    estimate, kind = fit.estimate, find_residual(fit.residual)
    used = used_elements(fit.weights, estimate.response.shape)
    G, J = sensitivity(
        fit.model, estimate.positions, estimate.omega, fit.parameters.values, sag=True
    )
    psi = kind.jacobian(G, J, used)
    noise = kind.noise(estimate.covariance, G, used)
    bread = information(psi, fit.weights).sum(axis=0)
    meat = information(psi, weighted_noise(fit.weights, noise, G.shape)).sum(axis=0)
    return bread, meat


def weighted_noise(
    weights: NDArray[Any], noise: NDArray[Any], shape: tuple[int, ...]
) -> NDArray[Any]:
    """Return W R W: element-wise if both are, (Q, F, m n, m n) otherwise."""
    full_weights, full_noise = is_full(weights, shape), is_full(noise, shape)
    if not full_weights and not full_noise:
        return np.asarray(weights**2 * noise)
    if not full_weights:
        w = vec(weights)
        return np.asarray(w[..., :, None] * noise * w[..., None, :])
    middle = noise @ weights if full_noise else vec(noise)[..., :, None] * weights
    return np.asarray(weights @ middle)


def sandwich(bread: Array, meat: Array, names: tuple[str, ...]) -> Array:
    """Return bread^-1 meat bread^-1, scaled to unit diagonals before inverting.

    Raises
    ------
    NotIdentifiable : if the bread is singular.
    """
    remedy = "add positions or frequencies, free fewer parameters, or fix one of them"
    size = np.sqrt(np.diag(bread))
    # Sensitivities that are zero but for rounding stay zero.
    blind = ~(size > 16 * np.finfo(float).eps * size.max())
    if blind.any():
        raise NotIdentifiable(tuple(n for n, b in zip(names, blind, strict=True) if b), remedy)
    values, vectors = np.linalg.eigh(bread / np.outer(size, size))
    null = vectors[:, values < SINGULAR * values[-1]]
    if null.size:
        share = np.abs(null).max(axis=1)
        guilty = share > 0.1 * share.max()
        raise NotIdentifiable(tuple(n for n, g in zip(names, guilty, strict=True) if g), remedy)
    inverse = (vectors / values) @ vectors.T
    scaled = inverse @ (meat / np.outer(size, size)) @ inverse
    result = scaled / np.outer(size, size)
    return np.asarray((result + result.T) / 2)
