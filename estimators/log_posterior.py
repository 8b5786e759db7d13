"""The function that is sampled: a fit's cost, fast where only springs and dampers are free."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from estimators.frf_estimate import is_full
from estimators.least_squares import Fit
from estimators.residuals import Residual, find_residual
from estimators.weights import square_root, used_elements, weighted_squares
from robotmodels.arrays import Array, ComplexArray, read_only
from robotmodels.errors import IdentificationError, SolverFailed
from robotmodels.linear_model import LinearModel
from robotmodels.response import Elastic
from robotmodels.spring_network import SpringNetwork

if TYPE_CHECKING:
    from robotmodels.kernel import CostKernel

# Matrix entries solved in one call when small systems are evaluated for many walkers.
BATCH = 2**20


@dataclass(frozen=True, eq=False)
class LogPosterior:
    """Logarithm of the posterior of ln theta: -scale V inside the bounds, flat prior in ln theta.

    Where every parameter is a spring or a damper, equilibria are held fixed at the fit. That
    leaves out the change of gravity sag within the posterior, which is of the order of the sag
    angle times the relative width. Masses, locations and what else a parameter may be change the
    skeleton: then the robot is linearised anew for every walker, a hundred times slower.

    Attributes
    ----------
    model, positions : of the fit.
    network : at the fitted parameters.
    omega, measured, weights, kind : as in the fit.
    scale : factor of the cost.
    bounds : (2, p) of ln theta.
    """

    model: Elastic
    positions: Array
    network: SpringNetwork
    omega: Array
    measured: ComplexArray
    weights: Array | ComplexArray
    kind: Residual
    scale: float
    bounds: Array
    root: Array | ComplexArray = field(init=False)
    used: NDArray[np.bool_] = field(init=False)

    def __post_init__(self) -> None:
        # The same layout, hence the same rounding, as in a process that got it pickled.
        object.__setattr__(self, "measured", np.ascontiguousarray(self.measured))
        shape = self.measured.shape
        object.__setattr__(self, "root", square_root(self.weights, shape))
        object.__setattr__(self, "used", used_elements(self.weights, shape))

    def __call__(self, ln_theta: Array) -> Array:
        """Return log p (W,), up to a constant, at `ln_theta` (W, p)."""
        ln_theta = np.atleast_2d(ln_theta)
        inside = ((ln_theta >= self.bounds[0]) & (ln_theta <= self.bounds[1])).all(axis=1)
        result = np.full(len(ln_theta), -np.inf)
        if inside.any():
            cost = self.costs(np.exp(ln_theta[inside]))
            result[inside] = np.where(np.isfinite(cost), -self.scale * cost, -np.inf)
        return result

    def costs(self, parameters: Array) -> Array:
        """Return the fit's cost V (W,) at `parameters` (W, p) [SI]."""
        if self.kernel is not None:
            return self.kernel(parameters)
        if not self.network.only_springs:
            return np.array([self._cost_anew(theta) for theta in parameters])
        result = np.empty(len(parameters))
        q, d = self.network.mass.shape[:2]
        together = max(1, BATCH // (q * len(self.omega) * d**2))
        for first in range(0, len(parameters), together):
            models = [self.network.linear_model(t) for t in parameters[first : first + together]]
            batch = LinearModel(
                mass=self.network.mass,
                damping=np.stack([model.damping for model in models]),
                stiffness=np.stack([model.stiffness for model in models]),
                selector=self.network.selector,
                measurement=self.network.measurement,
            )
            G = batch.frequency_response(self.omega)
            error = self.kind.error(self.measured, G, self.used)
            result[first : first + len(models)] = weighted_squares(self.root, error)
        return result

    def _cost_anew(self, theta: Array) -> float:
        """Return V with the equilibria and the skeleton of theta; infinite where there are none."""
        from robotmodels import kernel

        try:
            network = self.model.network(self.positions, theta)
        except IdentificationError:
            return np.inf
        G = kernel.frequency_response(network, self.omega)
        return float(weighted_squares(self.root, self.kind.error(self.measured, G, self.used)))

    @cached_property
    def kernel(self) -> "CostKernel | None":
        """The compiled cost; None for full weights, magnitudes, and more than springs."""
        if self.kind.real or is_full(self.weights, self.measured.shape):
            return None
        if not self.network.only_springs:
            return None
        from robotmodels.kernel import CostKernel

        residual: Literal["nls", "lls"] = "lls" if self.kind.relative else "nls"
        weights = np.asarray(self.weights, dtype=float)
        return CostKernel(self.network, self.omega, self.measured, weights, residual)

    def __getstate__(self) -> dict[str, Any]:
        # Compiled code works on addresses: another process makes its own.
        return {name: value for name, value in self.__dict__.items() if name != "kernel"}


def log_posterior(fit: Fit, scale: float) -> LogPosterior:
    """Return the function that is sampled.

    Raises
    ------
    SolverFailed : if the cost is not the fit's own at the fit.
    """
    theta = fit.parameters.values
    kind = find_residual(fit.residual)
    target = LogPosterior(
        model=fit.model,
        positions=fit.estimate.positions,
        network=fit.model.network(fit.estimate.positions, theta),
        omega=fit.estimate.omega,
        measured=fit.estimate.response,
        weights=fit.weights,
        kind=kind,
        scale=scale,
        bounds=read_only(np.log(fit.bounds)),
    )
    cost = target.costs(theta[None])[0]
    if not np.isclose(cost, fit.cost, rtol=1e-6):
        raise SolverFailed(f"posterior: the cost at the fit is {cost:g}, the fit's {fit.cost:g}")
    return target
