"""FRFs of one position as a search for modes needs them: weighted, and their errors kept apart."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.frf.frf_estimate import FrfEstimate, vec
from estimators.trust.linearised_fit import LinearisedFit, sandwich
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import InvalidInput
from robotmodels.common.symmetric_matrices import scaled_pinv

_FLOOR = 0.3  # of guessed errors: a share of the largest element of a line


@dataclass(frozen=True, eq=False)
class Data:
    """FRFs of one position with weights element by element.

    Weights are made of variances of neighbouring lines and leave correlations of elements out; the
    covariance as it was estimated enters the uncertainty only, linearly.

    Attributes
    ----------
    estimate : FrfEstimate
        Estimate of one position.
    error : ndarray, (F, M, M)
        Variances of errors beside the noise, which weights allow for.
    scaled : bool
        Whether the noise is guessed, so that its size is to be taken from the misfit.
    undamped : bool
        Whether the FRFs are real to rounding: computed, not measured.
    """

    estimate: FrfEstimate
    error: Array
    scaled: bool
    undamped: bool

    @property
    def omega(self) -> Array:
        """Frequencies (F,) [rad/s]."""
        return self.estimate.omega

    @property
    def response(self) -> ComplexArray:
        """The FRFs (F, M, M)."""
        return np.asarray(self.estimate.response[0])

    @property
    def chains(self) -> int:
        """Number M of motors."""
        return int(self.response.shape[-1])

    @property
    def size(self) -> int:
        """Number of real data."""
        return 2 * self.response.size

    @property
    def variance(self) -> Array:
        """Variances of the elements, (F, M, M): of the noise as estimated, and of other errors."""
        return np.asarray(self.estimate.variance[0] + self.error)

    @cached_property
    def std(self) -> Array:
        """Standard deviations (F, M, M) whose inverse squares are the weights."""
        return np.asarray(np.sqrt(self.estimate.pooled_variance[0] + self.error))

    @property
    def expected(self) -> float:
        """Expectation of the cost, a sum of squares, were the model exact."""
        return float(np.sum(self.variance / self.std**2))

    @cached_property
    def correlation(self) -> NDArray[Any]:
        """Covariance over the weights' deviations, (F, M M) or (F, M M, M M)."""
        std = vec(self.std)
        more = vec(self.error) / std**2
        if not self.estimate.has_full_covariance:
            return np.asarray(vec(self.estimate.covariance[0]) / std**2 + more)
        scaled = self.estimate.covariance[0] / (std[:, :, None] * std[:, None, :])
        return np.asarray(scaled + more[:, :, None] * np.eye(more.shape[1]))

    def whitened(self, values: NDArray[Any]) -> Array:
        """Return values (F, M, M) or (F, M, M, p) over deviations, as real rows (size, 1 or p)."""
        columns = values.reshape(*self.response.shape, -1) / self.std[..., None]
        rows = np.swapaxes(columns, 1, 2).reshape(self.response.size, -1)
        return np.asarray(np.concatenate([rows.real, rows.imag]))

    def covariance_of(self, jacobian: Array, cost: float, names: tuple[str, ...]) -> Array:
        """Return the covariance (p, p) of what the whitened `jacobian` (size, p) is by.

        Raises
        ------
        NotIdentifiable
            If the data do not say all of them.
        """
        bread = jacobian.T @ jacobian
        half, p = self.response.size, jacobian.shape[1]
        J = (jacobian[:half] + 1j * jacobian[half:]).reshape(len(self.omega), -1, p)
        R = self.correlation
        turned = R @ J if R.ndim == 3 else R[..., None] * J
        meat = np.einsum("fkp,fkq->pq", np.conj(J), turned).real / 2
        if self.scaled:
            meat = meat * 2 * cost / max(self.size - p, 1)
        return _along_lines(sandwich(bread, meat, names), bread, J, self.estimate.line_correlation)

    def linearised(
        self, names: tuple[str, ...], fitted: ComplexArray, jacobian: ComplexArray
    ) -> LinearisedFit:
        """Return a fit about its solution; FRFs (F, M, M) and derivatives (F, M, M, p)."""
        e = self.estimate
        covariance = e.covariance if e.has_full_covariance else vec(e.variance)
        freedom = e.degrees_of_freedom
        return LinearisedFit(
            names=names,
            residuals=vec(self.response - fitted)[None],
            jacobian=np.moveaxis(vec(np.moveaxis(jacobian, -1, 1)), 1, -1)[None],
            weights=vec(1 / self.std**2)[None],
            noise_weights=vec(1 / e.pooled_variance),
            covariance=covariance,
            deviations=None if e.deviations is None else vec(e.deviations),
            degrees_of_freedom=np.where(np.isnan(freedom), np.inf, freedom),
            line_correlation=e.line_correlation,
            prior=np.zeros((len(names),) * 2),
        )

    def from_line(self, first: int) -> "Data":
        """Return the data without the lines before `first`."""
        e = self.estimate
        shorter = replace(
            e,
            omega=e.omega[first:],
            response=e.response[:, first:],
            covariance=e.covariance[:, first:],
            deviations=None if e.deviations is None else e.deviations[:, :, first:],
        )
        return replace(self, estimate=shorter, error=self.error[first:])

    def with_error(self, variance: Array) -> "Data":
        """Return the data with independent errors of `variance` (F, M, M) beside the noise."""
        return replace(self, error=self.error + variance)

    def without(self, part: ComplexArray) -> "Data":
        """Return the data less a `part` (F, M, M) of the FRFs."""
        e = self.estimate
        return replace(self, estimate=replace(e, response=e.response - part))

    def of_size(self, factor: float) -> "Data":
        """Return the data with the variances of the noise multiplied by a factor."""
        e = self.estimate
        return replace(self, estimate=replace(e, covariance=e.covariance * factor))


def prepared(
    omega: Array, response: ComplexArray, covariance: NDArray[Any] | None, undamped: bool = False
) -> Data:
    """Return FRFs with their weights.

    Without a covariance the noise is taken to be relative, the same for all elements of a line
    but for a floor, and its size comes from the misfit.

    Parameters
    ----------
    omega : ndarray
        As in `identify_chains`.
    response : ndarray of complex
        As in `identify_chains`.
    covariance : ndarray or None
        As in `identify_chains`.
    undamped : bool
        Whether the FRFs are exact and of chains without damping.
    """
    guessed = relative_variance(response) if covariance is None else covariance
    if guessed.shape == response.shape:
        guessed = guessed.real
    estimate = FrfEstimate(
        np.zeros((1, response.shape[-1])),
        omega,
        response[None],
        guessed[None],
        np.ones(1, dtype=np.int64),
        np.array([np.nan if covariance is None else np.inf]),
    )
    return Data(estimate, np.zeros(response.shape), covariance is None, undamped)


def relative_variance(response: ComplexArray) -> Array:
    """Return variances (F, M, M) of relative errors, but for a factor, with a floor per line."""
    size = np.abs(response)
    largest = size.max(axis=(1, 2), keepdims=True)
    return np.asarray(size**2 + (_FLOOR * largest) ** 2)


def _along_lines(
    covariance: Array, bread: Array, jacobian: ComplexArray, correlation: Array
) -> Array:
    """Return a covariance (p, p) with standard deviations as errors correlated along lines make.

    Parameters
    ----------
    jacobian : ndarray of complex, (F, k, p)
        Whitened derivatives.
    correlation : ndarray, (L,)
        Correlation of errors 1 to L lines apart.
    """
    if not len(correlation):
        return covariance
    rows = jacobian @ scaled_pinv(bread)
    power = (np.abs(rows) ** 2).sum(axis=(0, 1))
    total = power.copy()
    for lag, rho in enumerate(correlation[: len(rows) - 1], start=1):
        total += 2 * rho * (np.conj(rows[:-lag]) * rows[lag:]).real.sum(axis=(0, 1))
    growth = np.sqrt(np.maximum(total / power, 1.0))
    return np.asarray(covariance * np.outer(growth, growth))


# Relative distortion from which on a line at the low end is not trusted, and how far it must stand
# out from that of the rest of the band.
_LARGEST = 0.05
_OUTSTANDING = 4.0
_MOST = 0.4  # of the lines, at most


def unfrictioned(data: Data, distortion: Array | None) -> tuple[Data, int]:
    """Return the data without the lines at the low end that friction distorts, and their number.

    A motor in friction hardly moves at low frequencies: there the distortion of its FRF is largest
    and falls with frequency. Lines are left out from the lowest on while they are distorted by
    more than 5 % and stand out of the rest. On those that stay, friction shifts the FRF by about
    as much as it makes one block differ from the next, most near anti-resonances, where the motor
    stands still: that is added to their errors.

    Parameters
    ----------
    data : Data
        FRFs of one position.
    distortion : ndarray or None, (F, M, M)
        Standard deviations of one block's FRF by distortion; None keeps all lines.

    Raises
    ------
    InvalidInput
        If shapes do not fit.
    """
    if distortion is None:
        return data, 0
    level = np.asarray(distortion, dtype=float)
    if level.shape != data.response.shape:
        raise InvalidInput(
            f"distortion: shape {level.shape} given; {data.response.shape} is needed, as response"
        )
    first = friction_limit(data.omega, relative_distortion(data, level))
    undistorted = data.from_line(first) if first else data
    return undistorted.with_error(_smooth(level[first:] ** 2)), first


def _smooth(variance: Array) -> Array:
    """Return variances averaged over five lines: those from a few blocks scatter widely."""
    padded = np.pad(np.nan_to_num(variance), [(2, 2), (0, 0), (0, 0)], mode="edge")
    return np.asarray(np.lib.stride_tricks.sliding_window_view(padded, 5, axis=0).mean(axis=-1))


def relative_distortion(data: Data, level: Array) -> Array:
    """Return each line's distortion, (F,): the worst of the motors' own FRFs, relative."""
    direct = np.diagonal(level, axis1=1, axis2=2)
    size = np.abs(np.diagonal(data.response, axis1=1, axis2=2))
    return np.asarray(np.nan_to_num(direct / np.maximum(size, 1e-300)).max(axis=1))


def friction_limit(omega: Array, relative: Array) -> int:
    """Return how many lines at the low end friction distorts, given relative distortions (F,).

    Only those from the lowest on without a break: anti-resonances further up, where the motor
    stands still, are distorted too, but tell of the springs. A moving median over five lines
    keeps one wild line from deciding.
    """
    padded = np.pad(relative, 2, mode="edge")
    smooth = np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1)
    most = int(_MOST * len(omega))
    usual = float(np.median(smooth[most:]))
    bad = smooth[:most] > max(_LARGEST, _OUTSTANDING * usual)
    return most if bad.all() else int(np.argmin(bad))
