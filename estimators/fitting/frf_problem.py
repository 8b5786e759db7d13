"""The cost of a fit to FRFs: whitened residuals and their Jacobian."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from estimators.fitting.fit_problem import (
    Derived,
    FitProblem,
    all_finite,
    check_positions,
    checked_bounds,
)
from estimators.fitting.linearise import linearise, residual_changes
from estimators.fitting.priors import Prior
from estimators.fitting.residuals import Residual, check_loss, find_residual, robust_loss
from estimators.fitting.sandwich import frf_sandwich
from estimators.fitting.weight_choice import evaluate_weights
from estimators.fitting.weights import square_root, used_elements, whiten
from estimators.frf.frf_estimate import FrfEstimate, is_full, unvec, vec
from estimators.trust.linearised_fit import LinearisedFit, Lines
from robotmodels.common.arrays import Array, ComplexArray, IntArray, read_only
from robotmodels.common.errors import InvalidInput
from robotmodels.linear.residuals import ResidualForm
from robotmodels.linear.response import Elastic
from robotmodels.linear.spring_network import SpringNetwork

if TYPE_CHECKING:
    from robotmodels.kernel import CostKernel

# A search far from the minimum looks at about so many lines, two vectors of the compiled code, but
# at least at every so-manieth; where that is not less than every fourth, at all of them.
ROUGH_LINES, THINNED, LEAST_THINNED = 16, 8, 4


@dataclass(frozen=True, eq=False, kw_only=True)
class FrfProblem(FitProblem):
    """The cost of FRFs, with what `FitProblem` holds.

    Attributes
    ----------
    data : FrfEstimate
        FRFs.
    kind : Residual
        As in `estimators.Fit`.
    weights : ndarray or ndarray of complex
        As in `estimators.Fit`.
    root : ndarray or ndarray of complex
        Square root of the weights, see `square_root`.
    used : ndarray
        Elements with a weight, see `used_elements`.
    """

    data: FrfEstimate
    kind: Residual
    weights: Array | ComplexArray
    root: Array | ComplexArray = field(init=False)
    used: NDArray[np.bool_] = field(init=False)

    def __post_init__(self) -> None:
        self.weights.flags.writeable = False
        shape = self.data.response.shape
        used = used_elements(self.weights, shape)
        object.__setattr__(self, "used", used)
        object.__setattr__(self, "root", square_root(self.weights, shape))
        if not (self.real or self.data.has_phase):
            raise InvalidInput(
                f"fit: the FRFs are magnitudes without phases, and {self.name} compares "
                "phases; use lls_magnitude, or give complex FRFs"
            )
        # A measured zero would spoil every start alike: better said before the first.
        self.kind.error(self.data.response, np.ones(shape, dtype=complex), used)

    @property
    def name(self) -> str:
        """Name of the residual."""
        return self.kind.name

    @property
    def used_data(self) -> int:
        """Number of real data that carry weight."""
        return int(self.used.sum()) * (1 if self.real else 2)

    @property
    def size(self) -> int:
        """Complex numbers in the data."""
        return self.data.response.size

    @property
    def identity(self) -> tuple[object, object]:
        """Data, and the weights that they led to, see `FitProblem`."""
        estimate = self.data
        scale = None if self.loss == "linear" else estimate.covariance
        measured = estimate.positions, estimate.omega, estimate.response, scale
        return (self.name, self.loss, *measured), self.weights

    @property
    def real(self) -> bool:
        """Whether residuals have no imaginary parts."""
        return self.kind.real

    @property
    def has_degrees_of_freedom(self) -> bool:
        """Whether the data tell the degrees of freedom of their noise."""
        return self.data.has_degrees_of_freedom

    def residuals(self, values: Array) -> tuple[Lines, Lines]:
        """Return whitened residuals and their derivatives by ln theta, see `FitProblem`."""
        G, J = self.derived(values)
        error = whiten(self.root, self.kind.error(self.data.response, G, self.used))
        slope = whiten(self.root, self.kind.jacobian(G, J, self.used))
        all_finite(error, slope)
        return error, slope

    def squares(self, response: ComplexArray, values: Array) -> Array:
        """Return the parts of the cost, by element or, of full weights, by line."""
        error = self.kind.error(self.data.response, response, self.used)
        return line_squares(self.root, error)

    def _linearised(self, values: Array) -> LinearisedFit:
        return linearise(self, self.derived(values))

    def by_output(self, values: Array) -> Array:
        """Return numbers of a line's elements (m n,) as the matrix (m, n)."""
        return unvec(values, self.data.response.shape[-2])

    def changes(self, values: Array, at: Derived) -> Callable[[ComplexArray], Lines]:
        """Return what turns changes (Q, F, m, n, r) of the FRF into those of modelled values."""
        return residual_changes(self.kind, at[0], self.used)

    def sandwich_parts(self, values: Array) -> tuple[Array, Array]:
        """Return bread and meat of [WM] (5), see `frf_sandwich`."""
        return frf_sandwich(self, values)

    def compiles(self, network: SpringNetwork) -> bool:
        """Tell whether weights are those of single elements, and only springs are free."""
        return network.only_springs and not is_full(self.weights, self.data.response.shape)

    def kernel(self, network: SpringNetwork) -> "CostKernel":
        """Return the compiled cost about a network's equilibria."""
        from robotmodels.kernel import CostKernel

        estimate, weights = self.data, np.asarray(self.weights, dtype=float)
        return CostKernel(network, estimate.omega, estimate.response, weights, self.kind.form)

    @cached_property
    def rough(self) -> "FrfProblem":
        """The problem of every fourth to eighth line, whose squares count as often, or this one."""
        step = min(-(-len(self.omega) // ROUGH_LINES), THINNED)
        if step < LEAST_THINNED:
            return self
        return replace(self, data=self.data.of_lines(step), weights=step * self.weights[:, ::step])

    def robust(self, squares: Array) -> Array:
        """Return the loss of squared residuals (r,) and its two derivatives, (3, r).

        A whitened residual is judged by the standard deviation the estimate's covariance gives it;
        the prior's residuals always count in full.
        """
        rows = len(self._scale)
        result = np.stack([squares, np.ones_like(squares), np.zeros_like(squares)])
        result[:, :rows] = robust_loss(self.loss, squares[:rows], self._scale)
        return result

    @cached_property
    def _scale(self) -> Array:
        variance = self.expected_squares(self.data.response)
        # Residuals without weight are zero: any variance will do.
        return np.where(variance > 0, variance, 1.0)

    def expected_squares(self, response: ComplexArray) -> Array:
        """Return the variances of the whitened residuals, (r,), without those of the prior.

        Parameters
        ----------
        response : ndarray of complex, (Q, F, m, n)
            Response at which the noise of a log residual is evaluated.
        """
        noise = self.kind.noise(self.data.covariance, response, self.used)
        shape, full = response.shape, is_full(noise, response.shape)
        if is_full(self.root, shape):
            matrix = noise if full else vec(noise)[..., None] * np.eye(shape[-2] * shape[-1])
            through = self.root @ matrix @ np.conj(np.swapaxes(self.root, -1, -2))
            variance = np.diagonal(through, axis1=-2, axis2=-1).real
        else:
            line_noise = np.diagonal(noise, axis1=-2, axis2=-1).real if full else vec(noise)
            variance = vec(self.weights) * line_noise
        half = np.ravel(variance) / 2  # each of real and imaginary part
        return half if self.real else np.concatenate([half, half])


def frf_problem(
    model: Elastic,
    estimate: FrfEstimate,
    residual: str | ResidualForm | None = None,
    weights: str | NDArray[Any] | None = None,
    bounds: tuple[float, float] | Array = (1e-3, 1e3),
    positions: Sequence[int] | IntArray | None = None,
    prior: Prior | None = None,
    loss: str = "linear",
) -> FrfProblem:
    """Return the problem of a fit; arguments as in `estimators.fit`.

    Raises
    ------
    InvalidInput
        For unknown names, misfitting arrays or too few data.
    """
    if residual == "sml":
        raise InvalidInput(
            "residual: 'sml' compares inputs and outputs; give RunSpectra or Records"
        )
    kind = find_residual("lls" if residual is None else residual)
    weights = "user" if weights is None else weights
    weight_values: Array | ComplexArray = evaluate_weights(weights, estimate, kind)
    if positions is not None:
        check_positions(positions)
        estimate, weight_values = estimate.subset(positions), weight_values[np.asarray(positions)]
    return FrfProblem(
        model=model,
        data=estimate,
        kind=kind,
        weights=weight_values,
        bounds=read_only(checked_bounds(bounds, model.parameters)),
        prior=prior,
        loss=check_loss(loss),
        weighting=weights if isinstance(weights, str) else "",
    )


def line_squares(root: Array | ComplexArray, error: Array | ComplexArray) -> Array:
    """Return |S error|^2 of residuals (..., Q, F, m, n): parts of the cost V.

    One per element, (..., Q, F, m, n), or per line, (..., Q, F), where S couples the elements.
    """
    if is_full(root, error.shape[-4:]):
        white = (root @ vec(error)[..., None])[..., 0]
        return np.asarray(np.sum(white.real**2 + white.imag**2, axis=-1))
    white = root * error
    return np.asarray(white.real**2 + white.imag**2)
