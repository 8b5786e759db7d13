"""The narrow waist: every robot and every chain becomes a linear model."""

from dataclasses import dataclass

import numpy as np

from robotmodels.arrays import Array, ComplexArray, read_only
from robotmodels.errors import InvalidInput


@dataclass(frozen=True, eq=False)
class LinearModel:
    """M q'' + D q' + K q = S u about one equilibrium, or about many (leading axes).

    Attributes
    ----------
    mass : (..., d, d) symmetric, arm side [kg m^2].
    damping : (..., d, d) symmetric [N m s/rad].
    stiffness : (..., d, d) symmetric, gravity included [N m/rad].
    selector : (d, n) generalised force per motor torque; its transpose reads the motor angles [-].
    """

    mass: Array
    damping: Array
    stiffness: Array
    selector: Array

    def __post_init__(self) -> None:
        d = self.selector.shape[0]
        for name in ("mass", "damping", "stiffness", "selector"):
            array = np.asarray(getattr(self, name), dtype=float)
            if name != "selector" and array.shape[-2:] != (d, d):
                raise InvalidInput(
                    f"{name}: shape {array.shape} does not fit the {d} coordinates of the selector"
                )
            object.__setattr__(self, name, read_only(array))

    def dynamic_stiffness(self, omega: Array) -> ComplexArray:
        """Return A = K - omega^2 M + j omega D, (..., F, d, d), at `omega` [rad/s]."""
        w = np.asarray(omega, dtype=float)[:, None, None]
        M, D, K = (np.expand_dims(a, -3) for a in (self.mass, self.damping, self.stiffness))
        return np.asarray(K - w**2 * M + 1j * w * D)

    def receptance(self, omega: Array) -> ComplexArray:
        """Return X = A^-1 S, (..., F, d, n): coordinates per motor torque [rad/(N m)]."""
        A = self.dynamic_stiffness(omega)
        S = np.broadcast_to(self.selector.astype(complex), (*A.shape[:-1], self.selector.shape[1]))
        return np.asarray(np.linalg.solve(A, S))

    def frequency_response(self, omega: Array) -> ComplexArray:
        """Return G = -omega^2 S^T A^-1 S, (..., F, n, n), from motor torque to acceleration."""
        w = np.asarray(omega, dtype=float)[:, None, None]
        return np.asarray(-(w**2) * (self.selector.T @ self.receptance(omega)))
