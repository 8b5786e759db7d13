"""Noise laws: how uncertain a measured FRF is, given the FRF or the experiment."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from robotmodels.common.arrays import (
    Array,
    ComplexArray,
    check_above_zero,
    complex_numbers,
    one_or_each,
    read_only,
    real_numbers,
)
from robotmodels.common.errors import InvalidInput
from robotmodels.linear.spring_network import SpringNetwork


@runtime_checkable
class NoiseLaw(Protocol):
    """A law of circular complex errors, independent over elements, such as `RelativeNoise`."""

    def variance(self, response: ComplexArray) -> Array:
        """Return the variances (Q, F, m, n) of `response` (Q, F, m, n), all positive."""


class LoopNoise(Protocol):
    """A noise law that depends on the experiment, such as `ClosedLoopNoise`."""

    def weights(self, network: SpringNetwork, omega: Array) -> ComplexArray:
        """Return the inverse covariances of vec(Ĝ), (Q, F, m n, m n), in each position."""


@runtime_checkable
class SeparableNoise(Protocol):
    """A noise law whose covariance of vec(Ĝ) is a Kronecker product, inputs times outputs."""

    def factors(self, network: SpringNetwork, omega: Array) -> tuple[ComplexArray, ComplexArray]:
        """Return U (Q, F, n, n) and V (Q, F, m, m): the inverse covariance is U ⊗ inv(V)."""


class OutputErrors(Protocol):
    """A law of the errors of outputs and inputs together, such as `InputOutputNoise`."""

    def output_error(
        self, network: SpringNetwork, response: ComplexArray, omega: Array
    ) -> ComplexArray:
        """Return the covariance of e = Y - G U, (Q, F, m, m), for FRFs G (Q, F, m, n)."""


@dataclass(frozen=True, eq=False)
class InputOutputNoise:
    """Noise of one measured period: at every line, in motors' motion and torques.

    Errors are circular, and independent between lines, outputs and inputs. They have a floor, so
    that a motor without torque tells nothing, which noise relative to FRFs cannot say.

    Attributes
    ----------
    speed : float or ndarray, (m,), rad/s
        Standard deviation of a line's speed, root mean square: of white noise of standard deviation
        s in N samples it is s sqrt(2/N). Measured angles and accelerations are as noisy as what
        that speed makes of them.
    torque : float or ndarray, (n,), N m
        Standard deviation of a line's torque, root mean square.
    """

    speed: ArrayLike
    torque: ArrayLike = 0.0

    def __post_init__(self) -> None:
        for name, zero in (("speed", False), ("torque", True)):
            values = real_numbers(getattr(self, name), f"noise.{name}")
            for value in np.atleast_1d(values).tolist():
                check_above_zero(value, f"noise.{name}", zero=zero)
            object.__setattr__(self, name, read_only(values))

    @classmethod
    def of_levels(
        cls, torque: ArrayLike, lines: int, share: float = 0.05, *, speed: ArrayLike
    ) -> "InputOutputNoise":
        """Return the noise whose part in torques is a share of those of flat spectra.

        Parameters
        ----------
        torque : float or ndarray, (n,), N m
            Root mean square torque of each motor over all lines.
        lines : int
            Number F of lines that share it.
        share : float
            Standard deviation of a line's torque, in parts of its flat level.
        speed : float or ndarray, (m,), rad/s
            As of the noise.
        """
        return cls(speed, share * np.asarray(torque, dtype=float) / np.sqrt(lines))

    def covariance(self, omega: Array, outputs: int, inputs: int) -> ComplexArray:
        """Return the covariance of a run's outputs and inputs, (F, m + n, m + n), as of `RunNoise`.

        Outputs are accelerations [rad/s^2].
        """
        w = np.asarray(omega, dtype=float)[:, None]
        parts = [w * self._each("speed", outputs), self._each("torque", inputs) + 0 * w]
        variances = np.concatenate(parts, axis=1) ** 2
        return np.asarray(variances[:, :, None] * np.eye(outputs + inputs), dtype=complex)

    def output_error(
        self, network: SpringNetwork, response: ComplexArray, omega: Array
    ) -> ComplexArray:
        """Return (omega speed)^2 I + G torque^2 G^H of accelerations, see `OutputErrors`.

        Raises
        ------
        InvalidInput
            If the robot measures more than its motors' motion, all alike.
        """
        m, n = response.shape[-2:]
        measured = network.measurement
        order = 2 if measured is None else measured.motor_order(network.selector)
        if order is None:
            raise InvalidInput(
                "noise: InputOutputNoise is that of motors' motion, and this robot has other "
                "outputs; give their ErrorCovariance"
            )
        scaled = response * self._each("torque", n)
        error = scaled @ np.conj(np.swapaxes(scaled, -1, -2))
        w = np.asarray(omega, dtype=float)[:, None]
        error[..., np.arange(m), np.arange(m)] += (w ** (order - 1) * self._each("speed", m)) ** 2
        return np.asarray(error)

    def _each(self, name: str, count: int) -> Array:
        """Return a standard deviation of each motor, (count,)."""
        return one_or_each(getattr(self, name), count, f"noise.{name}")


@dataclass(frozen=True, eq=False)
class ErrorCovariance:
    """Declared or estimated covariances of the errors of outputs and inputs, outputs first.

    Attributes
    ----------
    covariance : ndarray of complex, (F, m + n, m + n) or (Q, F, m + n, m + n)
        Such as `estimators.RunSpectra` has.
    """

    covariance: ComplexArray

    def output_error(
        self, network: SpringNetwork, response: ComplexArray, omega: Array
    ) -> ComplexArray:
        """Return [I -G] C [I -G]^H, see `OutputErrors`."""
        q, f, m, n = response.shape
        shape = (q, f, m + n, m + n)
        try:
            C = np.broadcast_to(self.covariance, shape)
        except ValueError:
            raise InvalidInput(
                f"noise: a covariance of shape {self.covariance.shape} for FRFs of shape "
                f"{response.shape}; (F, {m + n}, {m + n}) is needed, or that for each position"
            ) from None
        wide = np.concatenate([np.broadcast_to(np.eye(m), (q, f, m, m)), -response], axis=-1)
        return np.asarray(wide @ C @ np.conj(np.swapaxes(wide, -1, -2)))


@dataclass(frozen=True, eq=False)
class ExcitationNoise:
    """The noise of FRFs by an excitation: the information is linear in its spectral matrices.

    Attributes
    ----------
    spectrum : ndarray of complex, (F, n, n) or (Q, F, n, n), N^2 m^2
        Phi, the sum of U U^H over runs, of any rank: mean squares and products of the torques at
        each line. Without other lines, its trace over them is the sum of the mean squared torques.
    errors : OutputErrors
        Errors of outputs and torques, in the same units.
    """

    spectrum: ComplexArray
    errors: OutputErrors

    def factors(self, network: SpringNetwork, omega: Array) -> tuple[ComplexArray, ComplexArray]:
        """Return Phi^T, (Q, F, n, n), and the output error's covariance, see `SeparableNoise`.

        Raises
        ------
        InvalidInput
            If the spectrum is of other lines or inputs.
        """
        G = network.frequency_response(omega)
        shape = (*G.shape[:2], G.shape[3], G.shape[3])
        try:
            spectrum = np.broadcast_to(self.spectrum, shape)
        except ValueError:
            raise InvalidInput(
                f"spectrum: shape {self.spectrum.shape}; {shape[1:]} is needed, or that for each "
                "position"
            ) from None
        return np.swapaxes(spectrum, -1, -2), self.errors.output_error(network, G, omega)

    def weights(self, network: SpringNetwork, omega: Array) -> ComplexArray:
        """Return the inverse covariances of vec(G), (Q, F, m n, m n), as of `LoopNoise`."""
        return _weights(*self.factors(network, omega))


@dataclass(frozen=True, eq=False)
class RunNoise:
    """The noise of runs, any number of them, with torques and outputs in error.

    Of errors of covariance C in outputs and inputs, e = Y - G U has Sigma = [I -G] C [I -G]^H, and
    a run of torques U0 the information of an FRF whose inverse covariance is
    (U0 U0^H)^T kron Sigma^-1, which adds up over runs and is singular for fewer than inputs.

    Attributes
    ----------
    torques : ndarray of complex, (F, n, E) or (Q, F, n, E), N m
        True spectra of E runs.
    covariance : ndarray of complex, (F, m + n, m + n) or (Q, F, m + n, m + n)
        Covariance of the circular errors of outputs and inputs, outputs first, in each run.
    """

    torques: ComplexArray
    covariance: ComplexArray

    def __post_init__(self) -> None:
        torques = complex_numbers(self.torques, "torques")
        covariance = complex_numbers(self.covariance, "covariance")
        if torques.ndim not in (3, 4) or covariance.ndim not in (3, 4):
            raise InvalidInput(
                f"torques, covariance: shapes {torques.shape} and {covariance.shape}; (F, n, E) "
                "and (F, m + n, m + n) are needed, or that for each position"
            )
        object.__setattr__(self, "torques", read_only(torques))
        object.__setattr__(self, "covariance", read_only(covariance))

    def factors(self, network: SpringNetwork, omega: Array) -> tuple[ComplexArray, ComplexArray]:
        """Return (U0 U0^H)^T, (Q, F, n, n), and Sigma, (Q, F, m, m), see `SeparableNoise`.

        Raises
        ------
        InvalidInput
            If the runs are of other positions, lines, inputs or outputs.
        """
        U = self.torques
        spectrum = U @ np.conj(np.swapaxes(U, -1, -2))
        return ExcitationNoise(spectrum, ErrorCovariance(self.covariance)).factors(network, omega)

    def weights(self, network: SpringNetwork, omega: Array) -> ComplexArray:
        """Return the inverse covariances of vec(G), (Q, F, m n, m n), as of `LoopNoise`."""
        return _weights(*self.factors(network, omega))


def _weights(power: ComplexArray, sigma: ComplexArray) -> ComplexArray:
    """Return power kron inv(sigma), of factors (Q, F, n, n) and (Q, F, m, m)."""
    return kronecker(power, np.asarray(np.linalg.inv(sigma)))


def kronecker(left: ComplexArray, right: ComplexArray) -> ComplexArray:
    """Return the Kronecker products of matrices (..., k, k) and (..., l, l)."""
    product = np.einsum("...ij,...kl->...ikjl", left, right)
    size = left.shape[-1] * right.shape[-1]
    return np.asarray(product.reshape(*left.shape[:-2], size, size))


@dataclass(frozen=True)
class RelativeNoise:
    """Circular complex noise of a relative part and a floor, independent over elements.

    $var G_ij = (relative |G_ij|)^2 + (floor max_kl |G_kl|)^2$ at each position and frequency.

    Attributes
    ----------
    relative, floor : float, dimensionless
        Standard deviations, of the element and of the largest element.
    by_output : bool
        Whether the floor of an output is a part of its own largest element, max_l |G_il|: for
        outputs of different units.
    """

    relative: float = 0.03
    floor: float = 0.01
    by_output: bool = False

    def __post_init__(self) -> None:
        for name in ("relative", "floor"):
            check_above_zero(getattr(self, name), f"noise.{name}", zero=True)
        if self.relative == 0 and self.floor == 0:
            raise InvalidInput("noise: relative and floor are both zero; one must be positive")

    def variance(self, response: ComplexArray) -> Array:
        """Return the variances (Q, F, m, n) of `response` (Q, F, m, n)."""
        magnitude = np.abs(response)
        largest = magnitude.max(axis=-1 if self.by_output else (-2, -1), keepdims=True)
        return np.asarray((self.relative * magnitude) ** 2 + (self.floor * largest) ** 2)
