"""Measured FRFs with their uncertainty, and simulated ones."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.frf.pooled_noise import PooledNoise, pooled_covariances, pooled_noise
from robotmodels.common.arrays import (
    Array,
    ComplexArray,
    IntArray,
    chosen_positions,
    read_only,
    real_numbers,
)
from robotmodels.common.deprecation import renamed_attributes
from robotmodels.common.errors import InvalidInput
from robotmodels.common.printing import ReprHtml
from robotmodels.linear.held_torques import held_torque_images
from robotmodels.linear.noise import NoiseLaw
from robotmodels.linear.response import Elastic, frequency_response
from robotmodels.records.records import Records


def vec(matrices: NDArray[Any]) -> NDArray[Any]:
    """Stack the columns of (..., m, n) matrices into (..., m n) vectors, as in [WM]."""
    return np.swapaxes(matrices, -1, -2).reshape(*matrices.shape[:-2], -1)


def unvec(vectors: NDArray[Any], rows: int) -> NDArray[Any]:
    """Undo `vec`: (..., m n) vectors become (..., m, n) matrices with m = `rows`."""
    return np.swapaxes(vectors.reshape(*vectors.shape[:-1], -1, rows), -1, -2)


def is_full(per_line: NDArray[Any], shape: tuple[int, ...]) -> bool:
    """Tell (Q, F, m n, m n) matrices from (Q, F, m, n) element-wise values for FRFs of `shape`.

    Raises
    ------
    InvalidInput
        If the array has neither shape.
    """
    mn = shape[-2] * shape[-1]
    if per_line.shape == shape:
        return False
    if per_line.shape == (*shape[:2], mn, mn):
        return True
    raise InvalidInput(
        f"an array of shape {per_line.shape} does not fit FRFs of shape {shape}: {shape} "
        f"(one value per element) or {(*shape[:2], mn, mn)} (one matrix per line) is needed"
    )


def location(index: Sequence[int] | NDArray[np.intp], omega: Array | None = None) -> str:
    """Return words for an index of a (Q, F, ...) array: position, frequency, element."""
    q, f = int(index[0]), int(index[1])
    line = f"frequency {f}" if omega is None else f"frequency {f} ({omega[f]:.6g} rad/s)"
    element = f", element ({int(index[2])}, {int(index[3])})" if len(index) == 4 else ""
    return f"position {q}, {line}{element} (counted from 0)"


_MOST = 1e20  # response, and standard deviation from its inverse on: costs square their ratio


SAME_LINE = 1e-9
"""Relative difference below which two frequencies are one line."""


@renamed_attributes("0.2", noise_known="has_degrees_of_freedom")
@dataclass(frozen=True, eq=False)
class FrfEstimate(ReprHtml):
    """FRF estimates in Q positions at F frequencies, with the covariance of their errors.

    Attributes
    ----------
    positions : ndarray, (Q, n), rad
        Positions.
    omega : ndarray, (F,), rad/s
        Angular frequencies, positive and rising.
    response : ndarray of complex, (Q, F, m, n), rad/s^2/(N m)
        Motor torque to motor acceleration.
    covariance : ndarray or ndarray of complex
        Covariance of the circular complex errors of `response` as it stands (averages included):
        (Q, F, m, n) variances of independent elements, or (Q, F, m n, m n) Hermitian, of vec(G)
        with columns stacked.
    repetitions : ndarray of int, (Q,)
        Experiments averaged in each position.
    degrees_of_freedom : ndarray, (Q,)
        Complex degrees of freedom of the covariance in each position, B - 1 over B blocks of one
        visit; infinite where it is declared, as that of a noise law; not a number where it is not
        known. A scalar stands for all positions.
    deviations : ndarray of complex, (Q, R, F, m, n), optional
        Independent draws of the errors, scaled so that the outer products of their vec add up to
        the full covariance; zero where a position has fewer. They show how errors of elements and
        of neighbouring lines hang together.
    line_correlation : ndarray, (L,), dimensionless
        Correlation of the errors 1 to L lines apart, where lines share data.
    """

    positions: Array
    omega: Array
    response: ComplexArray
    covariance: Array | ComplexArray
    repetitions: IntArray
    degrees_of_freedom: Array = np.inf  # type: ignore[assignment]  # an array after __post_init__
    deviations: ComplexArray | None = None
    line_correlation: Array = ()  # type: ignore[assignment]  # an array after __post_init__

    def __post_init__(self) -> None:
        positions = real_numbers(self.positions, "positions")
        omega = real_numbers(self.omega, "omega")
        response = np.array(self.response, dtype=complex)
        _check_axes(positions, omega, response)
        covariance = _checked_covariance(np.array(self.covariance), response.shape, omega)
        repetitions = _checked_repetitions(self.repetitions, len(positions))
        freedom = _checked_freedom(self.degrees_of_freedom, len(positions))
        for name, array in (
            ("positions", positions),
            ("omega", omega),
            ("response", response),
            ("covariance", covariance),
            ("repetitions", repetitions),
            ("degrees_of_freedom", freedom),
            ("line_correlation", _checked_correlation(self.line_correlation, len(omega))),
        ):
            object.__setattr__(self, name, read_only(array))
        if self.deviations is not None:
            deviations = _checked_deviations(
                np.array(self.deviations, dtype=complex), self.variance
            )
            object.__setattr__(self, "deviations", read_only(deviations))

    @property
    def has_full_covariance(self) -> bool:
        """Whether the covariance couples the elements of one FRF matrix."""
        return is_full(self.covariance, self.response.shape)

    def of_outputs(self, rows: IntArray) -> "FrfEstimate":
        """Return the estimate of some outputs (rows), in that order."""
        m, n = self.response.shape[2:]
        elements = (m * np.arange(n)[:, None] + rows).ravel()
        full = self.has_full_covariance
        return replace(
            self,
            response=self.response[:, :, rows],
            covariance=self.covariance[..., elements[:, None], elements]
            if full
            else self.covariance[:, :, rows],
            deviations=None if self.deviations is None else self.deviations[..., rows, :],
        )

    @property
    def variance(self) -> Array:
        """The (Q, F, m, n) variances of the elements."""
        if not self.has_full_covariance:
            return np.asarray(self.covariance, dtype=float)
        diagonal = np.diagonal(self.covariance, axis1=-2, axis2=-1).real
        return np.asarray(unvec(diagonal, self.response.shape[-2]))

    @property
    def has_phase(self) -> bool:
        """Whether the response is more than magnitudes."""
        return bool(self.response.imag.any() or (self.response.real < 0).any())

    @property
    def has_degrees_of_freedom(self) -> bool:
        """Whether the degrees of freedom of the covariance are known in every position."""
        return not bool(np.isnan(self.degrees_of_freedom).any())

    @cached_property
    def pooled_noise(self) -> PooledNoise:
        """Variances (Q, F, m, n) from neighbouring lines."""
        return pooled_noise(self.variance, self._freedom, self.deviations, self.response)

    @property
    def pooled_variance(self) -> Array:
        """Variances (Q, F, m, n) from neighbouring lines alone, independent of the line's own."""
        return self.pooled_noise.variance

    @property
    def weight_variance(self) -> Array:
        """Variances (Q, F, m, n) for weights: from neighbouring lines and the line itself."""
        return self.pooled_noise.mixed

    @cached_property
    def weight_covariance(self) -> Array | ComplexArray:
        """Covariances with `weight_variance` and pooled correlations, as `covariance` is shaped."""
        if not self.has_full_covariance:
            return self.weight_variance
        covariance = np.asarray(self.covariance, dtype=complex)
        return pooled_covariances(
            covariance,
            vec(self.weight_variance),
            self._freedom,
            self.pooled_noise.lag_one,
        )

    @property
    def _freedom(self) -> Array:
        """Degrees of freedom, infinite where they are not known."""
        unknown = np.isnan(self.degrees_of_freedom)
        return np.where(unknown, np.inf, self.degrees_of_freedom)

    def __str__(self) -> str:
        q, f, m, n = self.response.shape
        low, high = self.omega.min() / (2 * np.pi), self.omega.max() / (2 * np.pi)
        ratio = np.abs(self.response) / np.sqrt(self.variance)
        with np.errstate(divide="ignore"):
            decibel = 20 * np.log10(np.median(ratio))
        noise = "correlated" if self.has_full_covariance else "independent"
        return (
            f"FRFs of {n} motors to {m} outputs in {q} positions at {f} frequencies, {low:.3g} to "
            f"{high:.3g} Hz; median signal-to-noise ratio {decibel:.0f} dB, errors of elements "
            f"{noise}"
        )

    def without_images(self, model: Elastic, records: Records, delay: float = 0.0) -> "FrfEstimate":
        """Return the estimate without images of held torques, by a model's nominal values.

        Parameters
        ----------
        model : Elastic
            Whose FRFs these are, see `held_torque_images`.
        records : Records
            Where they come from; measured torques have none.
        delay : float, s
            As in `estimators.estimate_frf`.
        """
        if not records.commanded:
            return self
        sampling = records.sample_time, records.derivatives, delay
        images = held_torque_images(
            partial(frequency_response, model, self.positions), self.omega, *sampling
        )
        return replace(self, response=self.response - images)

    def of_lines(self, step: int) -> "FrfEstimate":
        """Return the estimate at every `step`-th line."""
        lines = slice(None, None, step)
        return replace(
            self,
            omega=self.omega[lines],
            response=self.response[:, lines],
            covariance=self.covariance[:, lines],
            deviations=None if self.deviations is None else self.deviations[:, lines],
            line_correlation=self.line_correlation[step - 1 :: step],
        )

    def with_errors(self, rng: np.random.Generator) -> "FrfEstimate":
        """Return the estimate with independent circular complex normal errors of its variances."""
        parts = rng.standard_normal((2, *self.response.shape)) * np.sqrt(self.variance / 2)
        response = self.response.copy()
        response.real += parts[0]
        response.imag += parts[1]
        return replace(self, response=response)

    def subset(self, indices: Sequence[int] | IntArray) -> "FrfEstimate":
        """Return the estimates in the positions `indices` only."""
        i = chosen_positions(indices, len(self.positions))
        return replace(
            self,
            positions=self.positions[i],
            response=self.response[i],
            covariance=self.covariance[i],
            repetitions=self.repetitions[i],
            degrees_of_freedom=self.degrees_of_freedom[i],
            deviations=None if self.deviations is None else self.deviations[i],
        )


def simulate_frf(
    model: Elastic,
    positions: Array,
    omega: Array,
    noise: NoiseLaw,
    rng: np.random.Generator,
    repetitions: Sequence[int] | IntArray | None = None,
) -> FrfEstimate:
    """Return the model's FRFs with circular complex normal errors: the known-noise case.

    The errors have the law's variance at the true FRF, divided by the repetitions, and that very
    variance is stored as the covariance. A law evaluated at the noisy FRF instead would correlate
    weights with errors.

    Parameters
    ----------
    model : Elastic
        Robot, or anything with its ``parameters`` and ``network``.
    positions : ndarray, (Q, n), rad
        Positions.
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    noise : NoiseLaw
        Law of one experiment.
    rng : Generator
        Source of the errors.
    repetitions : sequence of int or ndarray of int, (Q,), optional
        Experiments averaged in each position; one where None.
    """
    truth = np.asarray(frequency_response(model, positions, omega))
    return exact_frf(truth, positions, omega, noise, repetitions).with_errors(rng)


def exact_frf(
    truth: ComplexArray,
    positions: Array,
    omega: Array,
    noise: NoiseLaw,
    repetitions: Sequence[int] | IntArray | None = None,
) -> FrfEstimate:
    """Return FRFs `truth` (Q, F, m, n) with the variances of `simulate_frf`, but no errors."""
    positions = np.asarray(positions, dtype=float)
    count = _checked_repetitions(
        np.ones(len(positions), dtype=np.int64) if repetitions is None else repetitions,
        len(positions),
    )
    variance = noise.variance(truth) / count[:, None, None, None]
    return FrfEstimate(positions, np.asarray(omega), truth, variance, count)


def _check_axes(positions: Array, omega: Array, response: ComplexArray) -> None:
    if positions.ndim != 2 or omega.ndim != 1 or response.ndim != 4:
        raise InvalidInput(
            f"FRF estimate: positions {positions.shape}, omega {omega.shape} and response "
            f"{response.shape}; (Q, n), (F,) and (Q, F, m, n) are needed"
        )
    if response.shape[:2] != (len(positions), len(omega)) or not response.size:
        raise InvalidInput(
            f"response: shape {response.shape} does not fit {len(positions)} positions and "
            f"{len(omega)} frequencies"
        )
    if not np.isfinite(positions).all():
        q, joint = np.argwhere(~np.isfinite(positions))[0]
        raise InvalidInput(f"positions: position {q}, coordinate {joint} is not finite")
    wrong = ~(np.isfinite(omega) & (omega > 0))
    if wrong.any():
        f = int(np.argmax(wrong))
        raise InvalidInput(f"omega: frequency {f} is {omega[f]:g}, a positive number is needed")
    _check_rising(omega)
    broken = ~np.isfinite(response)
    if broken.any():
        index = np.argwhere(broken)[0]
        raise InvalidInput(
            f"response: {response[tuple(index)]} at {location(index, omega)} is not finite"
        )
    large = ~((np.abs(response.real) <= _MOST) & (np.abs(response.imag) <= _MOST))
    if large.any():
        index = np.argwhere(large)[0]
        raise InvalidInput(
            f"response: {response[tuple(index)]:.3g} at {location(index, omega)} is beyond "
            f"any robot; at most {_MOST:g} is possible"
        )


def _check_rising(omega: Array) -> None:
    level = np.flatnonzero(~(np.diff(omega) > SAME_LINE * omega[1:]))
    if level.size:
        f = int(level[0])
        raise InvalidInput(
            f"omega: frequency {f + 1} ({omega[f + 1]:.9g} rad/s) does not lie above frequency {f} "
            f"({omega[f]:.9g} rad/s); sort the lines, with all that belongs to them, and give each "
            "once: copies of data count as new data"
        )


def _checked_covariance(
    covariance: NDArray[Any], shape: tuple[int, ...], omega: Array
) -> Array | ComplexArray:
    full = is_full(covariance, shape)
    if not full and np.iscomplexobj(covariance):
        raise InvalidInput("covariance: variances (Q, F, m, n) must be real numbers")
    covariance = covariance.astype(complex if full else float, copy=False)
    diagonal = np.diagonal(covariance, axis1=-2, axis2=-1).real if full else covariance
    elements = unvec(diagonal, shape[-2]) if full else diagonal
    wrong = ~((elements >= _MOST**-2) & (elements <= _MOST**2))
    if wrong.any():
        index = np.argwhere(wrong)[0]
        raise InvalidInput(
            f"covariance: the variance at {location(index, omega)} is "
            f"{elements[tuple(index)]:g}, a positive number is needed (from {_MOST**-2:g} to "
            f"{_MOST**2:g})"
        )
    if full:
        deviation = np.sqrt(diagonal)
        size = deviation[..., :, None] * deviation[..., None, :]
        with np.errstate(over="ignore", invalid="ignore"):  # of what is refused next
            skew = np.abs(covariance - np.conj(np.swapaxes(covariance, -1, -2)))
        bad = np.argwhere(~(skew <= 1e-9 * size).all(axis=(-2, -1)))
        if bad.size:
            raise InvalidInput(
                f"covariance: the matrix at {location(bad[0], omega)} is not Hermitian and finite"
            )
    return covariance


def _checked_repetitions(repetitions: Sequence[int] | IntArray, count: int) -> IntArray:
    counts = np.asarray(repetitions)
    if counts.shape != (count,) or not np.issubdtype(counts.dtype, np.integer):
        raise InvalidInput(
            f"repetitions: {counts.dtype} of shape {counts.shape}; one whole number for each of "
            f"{count} positions is needed"
        )
    if (counts < 1).any():
        q = int(np.argmax(counts < 1))
        raise InvalidInput(
            f"repetitions: {counts[q]} at position {q}; leave out positions that are not measured"
        )
    return counts.astype(np.int64)


def _checked_freedom(degrees_of_freedom: Array | float, count: int) -> Array:
    freedom = np.array(degrees_of_freedom, dtype=float)
    if freedom.ndim == 0:
        freedom = np.full(count, float(freedom))
    if freedom.shape != (count,) or (freedom <= 0).any():
        raise InvalidInput(
            f"degrees_of_freedom: {np.array2string(freedom, threshold=6)}; one positive number for "
            f"each of {count} positions is needed, infinite for a declared covariance"
        )
    return freedom


def _checked_correlation(line_correlation: Array, lines: int) -> Array:
    correlation = np.array(line_correlation, dtype=float)
    if correlation.ndim != 1 or not (np.abs(correlation) <= 1).all():
        raise InvalidInput(
            f"line_correlation: {np.array2string(correlation, threshold=6)}; correlations between "
            "-1 and 1 at lags 1 to L are needed"
        )
    return correlation[: lines - 1]


def _checked_deviations(deviations: ComplexArray, variance: Array) -> ComplexArray:
    Q, F, m, n = variance.shape
    if deviations.ndim != 5 or deviations.shape[::2] != (Q, F, n) or deviations.shape[3] != m:
        raise InvalidInput(
            f"deviations: shape {deviations.shape}; ({Q}, R, {F}, {m}, {n}) is needed"
        )
    power = (np.abs(deviations) ** 2).sum(axis=1)
    wrong = np.argwhere(~(np.abs(power - variance) <= 1e-6 * variance))
    if wrong.size:
        at = tuple(wrong[0])
        raise InvalidInput(
            f"deviations: their squares add up to {power[at]:g} at {location(wrong[0])}, the "
            f"variance there is {variance[at]:g}"
        )
    return deviations
