"""What searches, covariances and posteriors ask of a fit's cost, whatever its data."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from threading import Lock
from typing import TYPE_CHECKING, Any, TypeVar
from weakref import ref

import numpy as np

from estimators.fitting.priors import Prior
from estimators.frf.frf_estimate import FrfEstimate
from estimators.input_output.run_spectra import RunSpectra
from estimators.trust.linearised_fit import LinearisedFit, Lines
from robotmodels.common.arrays import Array, ComplexArray, IntArray, read_only
from robotmodels.common.errors import InvalidInput, SolverFailed
from robotmodels.description.parameters import Parameters
from robotmodels.linear.response import Elastic, sensitivity
from robotmodels.linear.spring_network import SpringNetwork

if TYPE_CHECKING:
    from robotmodels.kernel import FitKernel

Measured = FrfEstimate | RunSpectra
"""What a model is fitted to; both have positions, lines and a `subset` of their positions."""

Derived = tuple[ComplexArray, ComplexArray]
"""FRF of the model (Q, F, m, n) and its derivatives by ln theta, (Q, F, m, n, p)."""

T = TypeVar("T")

_RECENT: "list[ref[FitProblem]]" = []
_LOCK = Lock()
_MOST = 2
"""Problems that memoise: derivatives of one of 12 positions and 64 lines take 50 MB."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FitProblem(ABC):
    """A cost to minimise over x = ln(theta/reference), checked and prepared once for all starts.

    Attributes
    ----------
    model : Elastic
        Model whose FRFs are compared with the data.
    data : FrfEstimate or RunSpectra
        Data.
    bounds : ndarray, (2, p)
        Lowest and highest values.
    prior : Prior or None
        Prior knowledge of some parameters.
    loss : str
        "linear", or the robust loss.
    weighting : str
        The name of the weights; empty for an array.
    """

    model: Elastic
    data: Measured
    bounds: Array
    prior: Prior | None = None
    loss: str = "linear"
    weighting: str = ""

    @property
    @abstractmethod
    def name(self) -> str:
        """Name of the residual."""

    @property
    def positions(self) -> Array:
        """Positions of the data, (Q, n) [rad]."""
        return self.data.positions

    @property
    def omega(self) -> Array:
        """Angular frequencies of the data, (F,) [rad/s]."""
        return self.data.omega

    @property
    @abstractmethod
    def used_data(self) -> int:
        """Number of real data that carry weight."""

    @property
    @abstractmethod
    def size(self) -> int:
        """Complex numbers in the data."""

    @property
    @abstractmethod
    def identity(self) -> tuple[object, object]:
        """What the cost depends on beside model, bounds and prior: data, and what they led to."""

    @property
    def names(self) -> tuple[str, ...]:
        """The p parameters."""
        return self.model.parameters.names

    @property
    def real(self) -> bool:
        """Whether residuals have no imaginary parts."""
        return False

    @property
    def any_outputs(self) -> bool:
        """Whether there is compiled code for other outputs than the motors' motions."""
        return False

    @property
    def has_degrees_of_freedom(self) -> bool:
        """Whether the data tell the degrees of freedom of their noise."""
        return True

    def likelihood_scale(self, values: Array) -> float:
        """Return the factor of the cost in the logarithm of the likelihood near `values` (p,)."""
        return 1.0

    @abstractmethod
    def residuals(self, values: Array) -> tuple[Lines, Lines]:
        """Return whitened residuals (Q, F, ...) and their derivatives by ln theta (Q, F, ..., p).

        Raises
        ------
        SolverFailed
            If they are not finite.
        """

    @abstractmethod
    def squares(self, response: ComplexArray, values: Array) -> Array:
        """Return the parts of the cost, (w, Q, F, ...), of FRFs (w, Q, F, m, n).

        `values` (w, p) are the parameters they are of.
        """

    def linearise(self, values: Array) -> LinearisedFit:
        """Return the fit about its solution `values` (p,); the latest one stays."""
        return self._memoised("linearised", values, self._linearised)

    @abstractmethod
    def _linearised(self, values: Array) -> LinearisedFit:
        """Return the fit about its solution `values` (p,)."""

    @abstractmethod
    def by_output(self, values: Array) -> Array:
        """Return numbers of the k residuals of a line, (k,), as rows of outputs, (m, k / m)."""

    @abstractmethod
    def changes(self, values: Array, at: Derived) -> Callable[[ComplexArray], Lines]:
        """Return what turns changes (Q, F, m, n, r) of the FRF into those of modelled values."""

    @abstractmethod
    def sandwich_parts(self, values: Array) -> tuple[Array, Array]:
        """Return the Hessian of the cost and the covariance of its gradient, (p, p), at `values`.

        Neither the prior nor a robust loss is in them.
        """

    @abstractmethod
    def robust(self, squares: Array) -> Array:
        """Return the loss of squared residuals (r,) and its two derivatives, (3, r)."""

    @abstractmethod
    def compiles(self, network: SpringNetwork) -> bool:
        """Tell whether there is a compiled cost of such data, about a network's equilibria."""

    @abstractmethod
    def kernel(self, network: SpringNetwork) -> "FitKernel":
        """Return the compiled cost about a network's equilibria, if it `compiles`."""

    @property
    def rough(self) -> "FitProblem":
        """A problem of about the same minimum whose cost takes less time, or this one."""
        return self

    def evaluate(self, values: Array) -> tuple[Array, Array]:
        """Return the whitened residuals (r,) and their Jacobian (r, p) at `values` (p,).

        The residuals of the prior come last.
        """
        error, slope = self.residuals(values)
        return real_rows(error, slope, self.prior, self.names, values, real=self.real)

    def derived(self, values: Array) -> Derived:
        """Return the model's FRF and its derivatives at `values` (p,); the latest stay."""
        return self._memoised("derived", values, self._derived)

    def _derived(self, values: Array) -> Derived:
        G, J = sensitivity(self.model, self.positions, self.omega, values, equilibrium_shift=True)
        return read_only(G), read_only(J)

    def _memoised(self, name: str, values: Array, compute: Callable[[Array], T]) -> T:
        """Return what is computed at `values` (p,), of which the latest stay: much is asked there.

        Safe in threads, which may compute the same twice.
        """
        key = values.tobytes()
        latest = self._latest.pop(name, None)
        if latest is None or latest[0] != key:
            latest = key, compute(values)
        self._latest[name] = latest
        self._forget_others()
        return latest[1]

    def _forget_others(self) -> None:
        """Let the problems that have not been asked for longest forget what they memoise."""
        with _LOCK:
            recent = [one for one in (link() for link in _RECENT) if one and one is not self]
            for old in recent[: 1 - _MOST]:
                old._latest.clear()
            _RECENT[:] = map(ref, [*recent[1 - _MOST :], self])

    @cached_property
    def _latest(self) -> dict[str, tuple[bytes, Any]]:
        return {}

    def __getstate__(self) -> dict[str, Any]:
        # What is computed again in less time than it travels to another process.
        return {name: value for name, value in self.__dict__.items() if name != "_latest"}

    def checked_start(self, start: Array | None) -> Array:
        """Return `checked_start` within the bounds."""
        return checked_start(self.model.parameters, start, self.bounds)


def check_enough_data(problem: FitProblem) -> None:
    """Refuse a fit of more parameters than data.

    Raises
    ------
    InvalidInput
        If there are more.
    """
    data, names, prior = problem.used_data, problem.names, problem.prior
    if data + (0 if prior is None else len(prior.columns(names))) < len(names):
        raise InvalidInput(
            f"fit: {len(names)} parameters but only {data} real data have non-zero weight; "
            "add positions, frequencies or runs, or free fewer parameters"
        )


def all_finite(*arrays: Lines) -> None:
    """Refuse what no FRF leads to.

    Raises
    ------
    SolverFailed
        If a number is not finite.
    """
    if not all(np.isfinite(array).all() for array in arrays):
        raise SolverFailed("the model's FRF or its sensitivity is not finite")


def check_positions(positions: Sequence[int] | IntArray) -> None:
    """Refuse what is no choice of positions; the data know how many there are.

    Raises
    ------
    InvalidInput
        If it is none.
    """
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
