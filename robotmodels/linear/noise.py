"""Noise laws: how uncertain a measured FRF is, given the FRF or the experiment."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from robotmodels.common.arrays import Array, ComplexArray, check_above_zero
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
        """Return U and V, (Q, F, n, n) each: the inverse covariance is U ⊗ inv(V)."""


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
