"""The narrow waist: every robot and every chain becomes a linear model."""

from dataclasses import dataclass

import numpy as np

from robotmodels.common.arrays import Array, ComplexArray, IntArray, read_only
from robotmodels.common.errors import InvalidInput


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
            expected = selector.T if k == order else np.zeros_like(selector.T)
            if part.shape[-2:] != expected.shape or not np.array_equiv(part, expected):
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


@dataclass(frozen=True, eq=False)
class LinearModel:
    """M q'' + D q' + K q = S u about one equilibrium, or about many (leading axes).

    Its `resonances`, `rigid_modes`, `anti_resonances`, damping ratios (`damped_modes`) and the
    model with a clamped motor (`clamped`) are functions of `robotmodels.linear.modes`, all of
    them exported by `robotmodels`.

    Attributes
    ----------
    mass : ndarray, (..., d, d), kg m^2
        Mass matrix, symmetric, arm side.
    damping : ndarray, (..., d, d), N m s/rad
        Damping matrix, symmetric.
    stiffness : ndarray, (..., d, d), N m/rad
        Stiffness matrix, symmetric, gravity included.
    selector : ndarray, (d, n), dimensionless
        Generalised force per motor torque; its transpose reads the motor angles.
    measurement : Measurement or None
        What is measured; by default the motors' accelerations.
    """

    mass: Array
    damping: Array
    stiffness: Array
    selector: Array
    measurement: Measurement | None = None

    def __post_init__(self) -> None:
        d = np.asarray(self.selector).shape[0]
        for name in ("mass", "damping", "stiffness", "selector"):
            array = np.asarray(getattr(self, name), dtype=float)
            if name != "selector" and array.shape[-2:] != (d, d):
                raise InvalidInput(
                    f"{name}: shape {array.shape} does not fit the {d} coordinates of the selector"
                )
            object.__setattr__(self, name, read_only(array))

    def at(self, index: int) -> "LinearModel":
        """Return the model about one equilibrium of many (one leading axis)."""
        count = len(self.mass)
        return LinearModel(
            self.mass[index],
            np.broadcast_to(self.damping, (count, *self.damping.shape[-2:]))[index],
            self.stiffness[index],
            self.selector,
            None if self.measurement is None else self.measurement.at(index),
        )

    def dynamic_stiffness(self, omega: Array) -> ComplexArray:
        """Return A = K - omega^2 M + j omega D, (..., F, d, d), at `omega` [rad/s]."""
        w = np.asarray(omega, dtype=float)[:, None, None]
        M, D, K = (np.expand_dims(a, -3) for a in (self.mass, self.damping, self.stiffness))
        return np.asarray(K - w**2 * M + 1j * w * D)

    def receptances(self, omega: Array) -> tuple[ComplexArray, ComplexArray]:
        """Return X = A^-1 S gain, (..., F, d, n), and Z = A^-1 C^T, (..., F, d, m).

        X holds the coordinates' answer to the torques [rad/(N m)], Z the outputs' answer to
        forces on the coordinates; A is symmetric.
        """
        A = self.dynamic_stiffness(omega)
        if self.measurement is None:
            S = np.broadcast_to(self.selector, (*A.shape[:-1], self.inputs))
            X = np.asarray(np.linalg.solve(A, S + 0j))
            return X, np.asarray(-(np.asarray(omega, dtype=float)[:, None, None] ** 2) * X)
        C = np.swapaxes(self.measured.outputs(omega), -1, -2)
        S = np.broadcast_to(self.selector * self.measured.gain, (*A.shape[:-1], self.inputs))
        C = np.broadcast_to(C, (*A.shape[:-1], C.shape[-1]))
        both = np.linalg.solve(A, np.concatenate([S, C], axis=-1))
        return np.asarray(both[..., : self.inputs]), np.asarray(both[..., self.inputs :])

    def frequency_response(self, omega: Array) -> ComplexArray:
        """Return G = C A^-1 S, (..., F, m, n); by default -omega^2 S^T A^-1 S."""
        A = self.dynamic_stiffness(omega)
        S = np.broadcast_to(self.selector * self.measured.gain, (*A.shape[:-1], self.inputs))
        return np.asarray(self.measured.outputs(omega) @ np.linalg.solve(A, S + 0j))

    @property
    def inputs(self) -> int:
        """Number n of motors."""
        return int(self.selector.shape[1])

    @property
    def measured(self) -> Measurement:
        """What is measured, the default filled in."""
        return self.measurement or motor_measurement(self.selector)
