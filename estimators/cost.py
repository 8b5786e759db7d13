"""The cost of a fit: whitened residuals and their Jacobian."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.frf_estimate import FrfEstimate
from estimators.residuals import Residual, find_residual
from estimators.weights import chosen_weights, square_root, used_elements, whiten
from robotmodels.arrays import Array, ComplexArray, read_only
from robotmodels.errors import InvalidInput, SolverFailed
from robotmodels.response import Elastic, sensitivity


@dataclass(frozen=True, eq=False)
class Problem:
    """A cost to minimise over x = ln(theta/reference), checked and whitened once for all starts."""

    model: Elastic
    estimate: FrfEstimate
    kind: Residual
    weights: Array | ComplexArray
    bounds: Array
    root: Array | ComplexArray = field(init=False)
    used: NDArray[np.bool_] = field(init=False)

    def __post_init__(self) -> None:
        self.weights.flags.writeable = False
        shape = self.estimate.response.shape
        used = used_elements(self.weights, shape)
        object.__setattr__(self, "used", used)
        object.__setattr__(self, "root", square_root(self.weights, shape))
        parameters = self.model.parameters
        data = int(used.sum()) * (1 if self.kind.real else 2)
        if data < len(parameters):
            raise InvalidInput(
                f"fit: {len(parameters)} parameters but only {data} real data carry weight; "
                "add positions or frequencies, or free fewer parameters"
            )
        # A measured zero would spoil every start alike: better said before the first.
        self.kind.error(self.estimate.response, np.ones(shape, dtype=complex), used)

    def evaluate(self, values: Array) -> tuple[Array, Array]:
        """Return the whitened residuals (r,) and their Jacobian (r, p) at parameter `values`."""
        G, J = sensitivity(
            self.model, self.estimate.positions, self.estimate.omega, values, sag=True
        )
        error = whiten(self.root, self.kind.error(self.estimate.response, G, self.used))
        slope = whiten(self.root, self.kind.jacobian(G, J, self.used))
        p = slope.shape[-1]
        if not (np.isfinite(error).all() and np.isfinite(slope).all()):
            raise SolverFailed("the model's FRF or its sensitivity is not finite")
        if self.kind.real:
            return error.ravel(), slope.reshape(-1, p)
        stacked = np.concatenate([error.real.ravel(), error.imag.ravel()])
        return stacked, np.concatenate([slope.real.reshape(-1, p), slope.imag.reshape(-1, p)])

    def checked_start(self, start: Array | None) -> Array:
        """Return the start's values (p,), the model's own where None.

        Raises
        ------
        InvalidInput : if it has the wrong size or lies outside the bounds.
        """
        parameters = self.model.parameters
        values = np.array(parameters.check(start))
        low, high = self.bounds
        outside = (values < low) | (values > high)
        if outside.any():
            i = int(np.argmax(outside))
            raise InvalidInput(
                f"start: {parameters.names[i]} = {values[i]:g} lies outside its bounds "
                f"[{low[i]:g}, {high[i]:g}]; move it or widen the bounds"
            )
        return values


def stated(
    model: Elastic,
    estimate: FrfEstimate,
    residual: str,
    weights: str | NDArray[Any],
    bounds: tuple[float, float],
) -> Problem:
    """Return the problem of a fit; arguments as in `estimators.fit`.

    Raises
    ------
    InvalidInput : for unknown names, misfitting arrays or too few data.
    """
    kind = find_residual(residual)
    chosen: Array | ComplexArray = chosen_weights(weights, estimate, kind)
    low, high = bounds
    if not 0 < low < high < np.inf:
        raise InvalidInput(f"bounds: {bounds} are not factors 0 < low < high")
    return Problem(
        model=model,
        estimate=estimate,
        kind=kind,
        weights=chosen,
        bounds=read_only(np.outer([low, high], model.parameters.values)),
    )
