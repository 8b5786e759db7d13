"""The narrow waist: every robot and every chain becomes a linear model."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from robotmodels.common.arrays import Array, ComplexArray, IntArray, read_only
from robotmodels.common.errors import InvalidInput


@dataclass(frozen=True, eq=False)
class Channels:
    """Gains, delays and first-order lags of k signals: h(s) = gain e^{-s delay} / (1 + s lag).

    Attributes
    ----------
    gain : ndarray, (k,), dimensionless
        Gains, of either sign.
    delay, lag : ndarray, (k,), s
        Delays and time constants.
    """

    gain: Array
    delay: Array
    lag: Array

    def __post_init__(self) -> None:
        for name in ("gain", "delay", "lag"):
            object.__setattr__(self, name, read_only(np.array(getattr(self, name), dtype=float)))

    @staticmethod
    def plain(gain: Array) -> "Channels":
        """Return channels of gains (k,) alone."""
        return Channels(gain, np.zeros_like(gain), np.zeros_like(gain))

    @property
    def ideal(self) -> bool:
        """Whether nothing is changed."""
        return not (self.delay.any() or self.lag.any() or (self.gain != 1).any())

    def response(self, omega: Array) -> ComplexArray:
        """Return h(j omega), (F, k)."""
        jw = 1j * np.asarray(omega, dtype=float)[:, None]
        return np.asarray(self.gain * np.exp(-jw * self.delay) / (1 + jw * self.lag))


@dataclass(frozen=True, eq=False)
class Measurement:
    """y = e^{-s delay} h_y(s) ((C0 + s C1 + s^2 C2) q + D u) with u = h_u(s) (commanded torques).

    Attributes
    ----------
    position, velocity, acceleration : ndarray, (..., m, d)
        C0, C1 and C2.
    torque : Channels
        h_u of the n torques.
    delay : float, s
        Common delay.
    sensor : Channels or None
        h_y of the m outputs; None where they are ideal.
    feedthrough : ndarray, (m, n), or None
        D, of sensors of the motors' torques; None where there are none.
    """

    position: Array
    velocity: Array
    acceleration: Array
    torque: Channels
    delay: float = 0.0
    sensor: Channels | None = None
    feedthrough: Array | None = None

    def __post_init__(self) -> None:
        for name in ("position", "velocity", "acceleration"):
            object.__setattr__(self, name, read_only(np.asarray(getattr(self, name), dtype=float)))

    def sensors(self, omega: Array) -> ComplexArray:
        """Return e^{-j omega delay} h_y, (F, m), or (F, 1) where all outputs are alike."""
        w = np.asarray(omega, dtype=float)[:, None]
        late = np.exp(-1j * w * self.delay)
        return np.asarray(late if self.sensor is None else late * self.sensor.response(omega))

    def outputs(self, omega: Array) -> ComplexArray:
        """Return e^{-j omega delay} h_y (C0 + j omega C1 - omega^2 C2), (..., F, m, d)."""
        w = np.asarray(omega, dtype=float)[:, None, None]
        C0, C1, C2 = (
            np.expand_dims(C, -3) for C in (self.position, self.velocity, self.acceleration)
        )
        return np.asarray(self.sensors(omega)[..., None] * (C0 + 1j * w * C1 - w**2 * C2))

    def direct(self, omega: Array) -> ComplexArray | float:
        """Return e^{-j omega delay} h_y D h_u, (F, m, n), or zero."""
        if self.feedthrough is None:
            return 0.0
        sensors, torques = self.sensors(omega)[..., None], self.torque.response(omega)[:, None]
        return np.asarray(sensors * self.feedthrough * torques)

    def motor_order(self, selector: Array) -> int | None:
        """Return 0, 1 or 2 where motor angles, speeds or accelerations are measured, else None.

        `selector` is the model's, (d, n).
        """
        if self.feedthrough is not None or not (self.sensor is None or self.sensor.ideal):
            return None
        parts = self.position, self.velocity, self.acceleration
        order = int(np.argmax([np.any(part) for part in parts]))
        for k, part in enumerate(parts):
            expected = selector.T if k == order else np.zeros_like(selector.T)
            if part.shape[-2:] != expected.shape or not np.array_equiv(part, expected):
                return None
        return order

    def of_outputs(self, rows: IntArray) -> "Measurement":
        """Return the measurement of some outputs, in that order."""
        parts: dict[str, Any] = {
            name: getattr(self, name)[..., rows, :]
            for name in ("position", "velocity", "acceleration")
        }
        if self.sensor is not None:
            sensor = self.sensor
            parts["sensor"] = Channels(sensor.gain[rows], sensor.delay[rows], sensor.lag[rows])
        if self.feedthrough is not None:
            parts["feedthrough"] = self.feedthrough[rows]
        return replace(self, **parts)

    def at(self, index: int | IntArray) -> "Measurement":
        """Return the measurement at one or several of many positions."""
        rows = {
            name: getattr(self, name)[index] for name in ("position", "velocity", "acceleration")
        }
        return replace(self, **rows)


def motor_measurement(selector: Array) -> Measurement:
    """Return the measurement of motor accelerations."""
    nothing, torque = np.zeros_like(selector.T), Channels.plain(np.ones(selector.shape[1]))
    return Measurement(nothing, nothing, selector.T, torque)


@dataclass(frozen=True, eq=False)
class LinearModel:
    """$M q'' + D q' + K q = S u$ about one equilibrium, or about many (leading axes).

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
        Generalised force per motor torque; its transpose reads the motor angles. One for each
        equilibrium, (..., d, n), where other forces act.
    measurement : Measurement or None
        What is measured; by default the motors' accelerations.
    """

    mass: Array
    damping: Array
    stiffness: Array
    selector: Array
    measurement: Measurement | None = None

    def __post_init__(self) -> None:
        d = np.asarray(self.selector).shape[-2]
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
            self.selector if self.selector.ndim == 2 else self.selector[index],
            None if self.measurement is None else self.measurement.at(index),
        )

    def dynamic_stiffness(self, omega: Array) -> ComplexArray:
        """Return A = K - omega^2 M + j omega D, (..., F, d, d), at `omega` [rad/s]."""
        w = np.asarray(omega, dtype=float)[:, None, None]
        M, D, K = (np.expand_dims(a, -3) for a in (self.mass, self.damping, self.stiffness))
        A = np.empty(np.broadcast_shapes(M.shape, D.shape, w.shape), dtype=complex)
        A.real, A.imag = K - w**2 * M, w * D  # three times as fast as complex arithmetic
        return A

    def receptances(self, omega: Array) -> tuple[ComplexArray, ComplexArray]:
        """Return X = A^-1 S h_u, (..., F, d, n), and Z = A^-1 C^T, (..., F, d, m).

        X holds the coordinates' answer to the torques [rad/(N m)], Z the outputs' answer to
        forces on the coordinates; A is symmetric.
        """
        A = self.dynamic_stiffness(omega)
        if self.measurement is None:
            S = np.broadcast_to(self.selector, (*A.shape[:-1], self.inputs))
            X = np.asarray(np.linalg.solve(A, S + 0j))
            return X, np.asarray(-(np.asarray(omega, dtype=float)[:, None, None] ** 2) * X)
        C = np.swapaxes(self.measured.outputs(omega), -1, -2)
        S = np.broadcast_to(self.forces(omega), (*A.shape[:-1], self.inputs))
        C = np.broadcast_to(C, (*A.shape[:-1], C.shape[-1]))
        both = np.linalg.solve(A, np.concatenate([S, C], axis=-1))
        return np.asarray(both[..., : self.inputs]), np.asarray(both[..., self.inputs :])

    def frequency_response(self, omega: Array) -> ComplexArray:
        """Return G = C A^-1 S h_u + h_y D h_u, (..., F, m, n); by default -omega^2 S^T A^-1 S."""
        A = self.dynamic_stiffness(omega)
        S = np.broadcast_to(self.forces(omega), (*A.shape[:-1], self.inputs))
        C = self.measured.outputs(omega)
        return np.asarray(C @ np.linalg.solve(A, S) + self.measured.direct(omega))

    def forces(self, omega: Array) -> ComplexArray:
        """Return S h_u, (..., F, d, n): generalised forces per commanded torque."""
        responses = self.measured.torque.response(omega)[:, None]
        return np.asarray(np.expand_dims(self.selector, -3) * responses)

    @property
    def inputs(self) -> int:
        """Number n of motors."""
        return int(self.selector.shape[-1])

    @property
    def measured(self) -> Measurement:
        """What is measured, the default filled in."""
        return self.measurement or motor_measurement(self.selector)


def stacked_measurements(models: Sequence[LinearModel]) -> Measurement | None:
    """Return the measurements of models as one with a leading axis, where they are not the same.

    They differ in position and velocity, where springs' torques are measured.
    """
    first, last = models[0].measurement, models[-1].measurement
    if first is None or first is last:
        return first
    measured = [model.measured for model in models]
    rows: dict[str, Any] = {
        name: np.stack([getattr(each, name) for each in measured])
        for name in ("position", "velocity")
    }
    return replace(first, **rows)
