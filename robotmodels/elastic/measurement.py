"""What is measured: motor angles or their derivatives, accelerometers, gains and a delay."""

from dataclasses import dataclass

import numpy as np

from robotmodels.arrays import Array, ComplexArray, IntArray, read_only


@dataclass(frozen=True, eq=False)
class Measurement:
    """y = e^{-s delay} (C0 + s C1 + s^2 C2) q with the torques u = gain * (commanded torques).

    Attributes
    ----------
    position, velocity, acceleration : ndarray, (..., m, d)
        C0, C1 and C2.
    gain : ndarray, (n,), dimensionless
        Torque gains.
    delay : float, s
        Common delay.
    """

    position: Array
    velocity: Array
    acceleration: Array
    gain: Array
    delay: float = 0.0

    def __post_init__(self) -> None:
        for name in ("position", "velocity", "acceleration", "gain"):
            object.__setattr__(self, name, read_only(np.asarray(getattr(self, name), dtype=float)))

    def outputs(self, omega: Array) -> ComplexArray:
        """Return e^{-j omega delay} (C0 + j omega C1 - omega^2 C2), (..., F, m, d)."""
        w = np.asarray(omega, dtype=float)[:, None, None]
        C0, C1, C2 = (
            np.expand_dims(C, -3) for C in (self.position, self.velocity, self.acceleration)
        )
        return np.asarray(np.exp(-1j * w * self.delay) * (C0 + 1j * w * C1 - w**2 * C2))

    def motor_order(self, selector: Array) -> int | None:
        """Return 0, 1 or 2 where motor angles, speeds or accelerations are measured, else None.

        `selector` is the model's, (d, n).
        """
        parts = self.position, self.velocity, self.acceleration
        order = int(np.argmax([np.any(part) for part in parts]))
        for k, part in enumerate(parts):
            wanted = selector.T if k == order else np.zeros_like(selector.T)
            if part.shape[-2:] != wanted.shape or not np.array_equiv(part, wanted):
                return None
        return order

    def at(self, index: int | IntArray) -> "Measurement":
        """Return the measurement at one or several of many positions."""
        return Measurement(
            self.position[index],
            self.velocity[index],
            self.acceleration[index],
            self.gain,
            self.delay,
        )


def motor_measurement(selector: Array, order: int = 2) -> Measurement:
    """Return the measurement of motor angles (order 0), speeds (1) or accelerations (2)."""
    position, velocity, acceleration = (
        selector.T if order == k else np.zeros_like(selector.T) for k in range(3)
    )
    return Measurement(position, velocity, acceleration, np.ones(selector.shape[1]))
