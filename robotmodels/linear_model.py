"""The narrow waist: every robot and every chain becomes a linear model."""

from dataclasses import dataclass

import numpy as np

from robotmodels.arrays import Array, ComplexArray, read_only
from robotmodels.elastic.measurement import Measurement, motor_measurement
from robotmodels.errors import InvalidInput


@dataclass(frozen=True, eq=False)
class LinearModel:
    """M q'' + D q' + K q = S u about one equilibrium, or about many (leading axes).

    Its `resonances`, `rigid_modes`, `anti_resonances`, damping ratios (`damped_modes`) and the
    model with a motor held still (`clamped`) are functions of `robotmodels.modes`, all of them
    exported by `robotmodels`.

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
