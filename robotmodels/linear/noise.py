"""Noise laws: how uncertain a measured FRF is, given the FRF or the experiment."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from robotmodels.common.arrays import (
    Array,
    ComplexArray,
    check_above_zero,
    complex_numbers,
    read_only,
)
from robotmodels.common.errors import InvalidInput
from robotmodels.linear.spring_network import SpringNetwork


@runtime_checkable
class NoiseLaw(Protocol):
    """A law of circular complex errors, independent over elements, such as `RelativeNoise`."""

    def variance(self, response: ComplexArray) -> Array:
        """Return the variances (Q, F, m, n) of `response` (Q, F, m, n), all positive."""
        ...


class LoopNoise(Protocol):
    """A noise law that depends on the experiment, such as `ClosedLoopNoise`."""

    def weights(self, network: SpringNetwork, omega: Array) -> ComplexArray:
        """Return the inverse covariances of vec(Ĝ), (Q, F, m n, m n), in each position."""


@runtime_checkable
class SeparableNoise(Protocol):
    """A noise law whose covariance of vec(Ĝ) is a Kronecker product, inputs times outputs."""

    def factors(self, network: SpringNetwork, omega: Array) -> tuple[ComplexArray, ComplexArray]:
        """Return U (Q, F, n, n) and V (Q, F, m, m): the inverse covariance is U ⊗ inv(V)."""


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
        G = network.frequency_response(omega)
        q, f, m, n = G.shape
        U, C = (x if x.ndim == 4 else x[None] for x in (self.torques, self.covariance))
        shapes = (q, f, n, U.shape[3]), (q, f, m + n, m + n)
        try:
            U, C = (np.broadcast_to(x, shape) for x, shape in zip((U, C), shapes, strict=True))
        except ValueError:
            raise InvalidInput(
                f"noise: torques of shape {self.torques.shape} and a covariance of shape "
                f"{self.covariance.shape} for FRFs of shape {G.shape}"
            ) from None
        wide = np.concatenate([np.broadcast_to(np.eye(m), (q, f, m, m)), -G], axis=-1)
        power = U @ np.conj(np.swapaxes(U, -1, -2))
        return np.swapaxes(power, -1, -2), wide @ C @ np.conj(np.swapaxes(wide, -1, -2))

    def weights(self, network: SpringNetwork, omega: Array) -> ComplexArray:
        """Return the inverse covariances of vec(G), (Q, F, m n, m n), as of `LoopNoise`."""
        power, sigma = self.factors(network, omega)
        return kronecker(power, np.asarray(np.linalg.inv(sigma)))


def kronecker(left: ComplexArray, right: ComplexArray) -> ComplexArray:
    """Return the Kronecker products of matrices (..., k, k) and (..., l, l)."""
    product = np.einsum("...ij,...kl->...ikjl", left, right)
    size = left.shape[-1] * right.shape[-1]
    return np.asarray(product.reshape(*left.shape[:-2], size, size))


@dataclass(frozen=True)
class RelativeNoise:
    """Circular complex noise of a relative part and a floor, independent over elements.

    var G_ij = (relative |G_ij|)^2 + (floor max_kl |G_kl|)^2 at each position and frequency.

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
