"""The cost of a fit: whitened residuals, those of the prior, and their Jacobian."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.fitting.priors import Prior
from estimators.fitting.residuals import Residual, check_loss, find_residual, robust_loss
from estimators.fitting.weight_choice import evaluate_weights
from estimators.fitting.weights import square_root, used_elements, whiten
from estimators.frf.frf_estimate import FrfEstimate, is_full, vec
from robotmodels.common.arrays import Array, ComplexArray, IntArray, read_only
from robotmodels.common.errors import InvalidInput, SolverFailed
from robotmodels.description.parameters import Parameters
from robotmodels.linear.residuals import ResidualForm
from robotmodels.linear.response import Elastic, sensitivity


@dataclass(frozen=True, eq=False)
class Problem:
    """A cost to minimise over x = ln(theta/reference), checked and whitened once for all starts.

    Attributes
    ----------
    model : Elastic
        As in `estimators.Fit`.
    estimate : FrfEstimate
        As in `estimators.Fit`.
    kind : Residual
        As in `estimators.Fit`.
    weights : ndarray or ndarray of complex
        As in `estimators.Fit`.
    bounds : ndarray
        As in `estimators.Fit`.
    prior : Prior or None
        As in `estimators.Fit`.
    loss : str
        As in `estimators.Fit`.
    weighting : str
        As in `estimators.Fit`.
    root : ndarray or ndarray of complex
        Square root of the weights, see `square_root`.
    used : ndarray
        Elements with a weight, see `used_elements`.
    """

    model: Elastic
    estimate: FrfEstimate
    kind: Residual
    weights: Array | ComplexArray
    bounds: Array
    prior: Prior | None = None
    loss: str = "linear"
    weighting: str = ""
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
        prior_rows = 0 if self.prior is None else len(self.prior.columns(parameters.names))
        if data + prior_rows < len(parameters):
            raise InvalidInput(
                f"fit: {len(parameters)} parameters but only {data} real data carry weight; "
                "add positions or frequencies, or free fewer parameters"
            )
        if not (self.kind.real or self.estimate.has_phase):
            raise InvalidInput(
                f"fit: the FRFs are magnitudes without phases, and {self.kind.name} compares "
                "phases; use lls_magnitude, or give complex FRFs"
            )
        # A measured zero would spoil every start alike: better said before the first.
        self.kind.error(self.estimate.response, np.ones(shape, dtype=complex), used)

    def evaluate(self, values: Array) -> tuple[Array, Array]:
        """Return the whitened residuals (r,) and their Jacobian (r, p) at parameter `values`.

        The residuals of the prior come last.
        """
        G, J = sensitivity(
            self.model, self.estimate.positions, self.estimate.omega, values, equilibrium_shift=True
        )
        error = whiten(self.root, self.kind.error(self.estimate.response, G, self.used))
        slope = whiten(self.root, self.kind.jacobian(G, J, self.used))
        if not (np.isfinite(error).all() and np.isfinite(slope).all()):
            raise SolverFailed("the model's FRF or its sensitivity is not finite")
        names = self.model.parameters.names
        return real_rows(error, slope, self.prior, names, values, real=self.kind.real)

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
        variance = self.expected_squares(self.estimate.response)
        # Residuals without weight are zero: any variance will do.
        return np.where(variance > 0, variance, 1.0)

    def expected_squares(self, response: ComplexArray) -> Array:
        """Return the variances of the whitened residuals, (r,), without those of the prior.

        Parameters
        ----------
        response : ndarray of complex, (Q, F, m, n)
            Response at which the noise of a log residual is evaluated.
        """
        noise = self.kind.noise(self.estimate.covariance, response, self.used)
        shape, full = response.shape, is_full(noise, response.shape)
        if is_full(self.root, shape):
            matrix = noise if full else vec(noise)[..., None] * np.eye(shape[-2] * shape[-1])
            through = self.root @ matrix @ np.conj(np.swapaxes(self.root, -1, -2))
            variance = np.diagonal(through, axis1=-2, axis2=-1).real
        else:
            line_noise = np.diagonal(noise, axis1=-2, axis2=-1).real if full else vec(noise)
            variance = vec(self.weights) * line_noise
        half = np.ravel(variance) / 2  # each of real and imaginary part
        return half if self.kind.real else np.concatenate([half, half])

    def checked_start(self, start: Array | None) -> Array:
        """Return `checked_start` within the bounds."""
        return checked_start(self.model.parameters, start, self.bounds)


def make_fit_problem(
    model: Elastic,
    estimate: FrfEstimate,
    residual: str | ResidualForm,
    weights: str | NDArray[Any],
    bounds: tuple[float, float] | Array,
    positions: Sequence[int] | IntArray | None = None,
    prior: Prior | None = None,
    loss: str = "linear",
) -> Problem:
    """Return the problem of a fit; arguments as in `estimators.fit`.

    Raises
    ------
    InvalidInput
        For unknown names, misfitting arrays or too few data.
    """
    kind = find_residual(residual)
    weight_values: Array | ComplexArray = evaluate_weights(weights, estimate, kind)
    if positions is not None:
        _check_positions(positions)
        estimate, weight_values = estimate.subset(positions), weight_values[np.asarray(positions)]
    return Problem(
        model=model,
        estimate=estimate,
        kind=kind,
        weights=weight_values,
        bounds=read_only(checked_bounds(bounds, model.parameters)),
        prior=prior,
        loss=check_loss(loss),
        weighting=weights if isinstance(weights, str) else "",
    )


def _check_positions(positions: Sequence[int] | IntArray) -> None:
    """Refuse what is no choice of positions; the estimate knows how many there are."""
    indices = np.asarray(positions)
    if indices.ndim != 1 or not (np.issubdtype(indices.dtype, np.integer) or not indices.size):
        raise InvalidInput(f"positions: {positions!r}; numbers of positions, from 0, are needed")
    values, counts = np.unique(indices, return_counts=True)
    if (counts > 1).any():
        raise InvalidInput(
            f"positions: {values[counts > 1][0]} is given twice; its data would count twice"
        )


def checked_bounds(bounds: tuple[float, float] | Array, parameters: Parameters) -> Array:
    """Return the bounds' values, (2, p).

    Raises
    ------
    InvalidInput
        If they are neither two factors nor two values each.
    """
    limits = np.asarray(bounds, dtype=float)
    if limits.shape == (2,):
        if not 0 < limits[0] < limits[1] < np.inf:
            raise InvalidInput(f"bounds: {bounds} are not factors 0 < low < high")
        return np.outer(limits, parameters.values)
    if limits.shape != (2, len(parameters)):
        raise InvalidInput(
            f"bounds: shape {limits.shape}; two factors or (2, {len(parameters)}) values are needed"
        )
    wrong = ~((limits[0] > 0) & (limits[0] < limits[1]) & (limits[1] < np.inf))
    if wrong.any():
        i = int(np.argmax(wrong))
        raise InvalidInput(
            f"bounds: {parameters.names[i]} between {limits[0, i]:g} and {limits[1, i]:g}; "
            "0 < low < high is needed"
        )
    return limits


def real_rows(
    error: Array | ComplexArray,
    slope: Array | ComplexArray,
    prior: Prior | None,
    names: tuple[str, ...],
    values: Array,
    *,
    real: bool = False,
) -> tuple[Array, Array]:
    """Return whitened residuals and their Jacobian as real rows, (r,) and (r, p).

    Parameters
    ----------
    error : ndarray or ndarray of complex
        Whitened residuals of any shape.
    slope : ndarray or ndarray of complex, (..., p)
        Their derivatives with respect to ln theta.
    prior : Prior or None
        Its residuals come last.
    names : tuple of str
        p parameters.
    values : ndarray, (p,), SI
        Where they are evaluated.
    real : bool
        Whether residuals have no imaginary parts.
    """
    p = slope.shape[-1]
    errors, slopes = [error.real.ravel()], [slope.real.reshape(-1, p)]
    if not real:
        errors.append(error.imag.ravel())
        slopes.append(slope.imag.reshape(-1, p))
    if prior is not None:
        errors.append(prior.standardised(names, values) / np.sqrt(2))
        slopes.append(prior.slope(names) / np.sqrt(2))
    return np.concatenate(errors), np.concatenate(slopes)


def checked_start(parameters: Parameters, start: Array | None, bounds: Array) -> Array:
    """Return the start's values (p,), the model's nominal values where None.

    Raises
    ------
    InvalidInput
        If it has the wrong size or lies outside the bounds.
    """
    values = np.array(parameters.check(start))
    low, high = bounds
    outside = (values < low) | (values > high)
    if outside.any():
        i = int(np.argmax(outside))
        raise InvalidInput(
            f"start: {parameters.names[i]} = {values[i]:g} lies outside its bounds "
            f"[{low[i]:g}, {high[i]:g}]; move it or widen the bounds"
        )
    return values
