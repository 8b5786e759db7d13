"""Spring characteristics: linear, and cubic ones that harden with torque."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from robotmodels.common.arrays import Array


@dataclass(frozen=True, eq=False)
class SpringLaws:
    """torque = low d + kappa d^3 of every spring, d its elongation.

    kappa = (high - low) (2 low + high)^2 / (27 torque^2) makes the slope `high` where the torque
    is `torque`; a linear spring has high = low and an infinite torque.

    Attributes
    ----------
    low, high, torque : ndarray, (s,)
        Low, high and torque [N m/rad], [N m/rad], [N m].
    """

    low: Array
    high: Array
    torque: Array

    @cached_property
    def linear(self) -> bool:
        """Whether no spring hardens."""
        return not np.isfinite(self.torque).any()

    @cached_property
    def kappa(self) -> Array:
        """Cubic coefficients, (s,) [N m/rad^3]."""
        k: Array = (self.high - self.low) * (2 * self.low + self.high) ** 2 / (27 * self.torque**2)
        return k

    def __call__(self, elongations: Array) -> tuple[Array, Array]:
        """Return torques and slopes at `elongations` (..., s)."""
        square = elongations**2
        return (self.low + self.kappa * square) * elongations, self.low + 3 * self.kappa * square

    def elongations(self, torques: Array) -> Array:
        """Return the elongations at `torques` (..., s); of a softening spring to first order.

        The torque of a hardening spring is convex: Newton's method from above converges.
        """
        if self.linear:
            return np.asarray(torques / self.low)
        load, kappa = np.abs(torques), np.maximum(self.kappa, 0.0)
        cubic = np.full(load.shape, np.inf)
        np.cbrt(np.divide(load, kappa, where=kappa > 0, out=cubic), out=cubic)
        d = np.minimum(load / self.low, cubic)
        for _ in range(8 if kappa.any() else 0):
            d = d - ((self.low + kappa * d**2) * d - load) / (self.low + 3 * kappa * d**2)
        return np.asarray(np.copysign(d, torques))

    def stiffening(self, elongations: Array) -> Array:
        """Return d slope / d elongation."""
        k: Array = 6 * self.kappa * elongations
        return k

    def by_low(self, elongations: Array) -> tuple[Array, Array]:
        """Return d torque / d ln low and d slope / d ln low at fixed elongation and high."""
        kappa = (2 * self.low + self.high) * (3 * self.high - 6 * self.low)
        kappa = kappa / (27 * self.torque**2)
        return self._scaled(self.low, 1.0, kappa, elongations)

    def by_high(self, elongations: Array) -> tuple[Array, Array]:
        """Return d torque / d ln high and d slope / d ln high at fixed elongation and low."""
        kappa = 3 * self.high * (2 * self.low + self.high) / (27 * self.torque**2)
        return self._scaled(self.high, 0.0, kappa, elongations)

    def _scaled(
        self, value: Array, linear: float, kappa: Array, elongations: Array
    ) -> tuple[Array, Array]:
        torque = value * (linear + kappa * elongations**2) * elongations
        slope = value * (linear + 3 * kappa * elongations**2)
        return torque, slope
