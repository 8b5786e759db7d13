"""What frozen equilibria leave out: derivatives of everything but the springs themselves."""

from dataclasses import dataclass, replace

import numpy as np

from robotmodels.common.arrays import Array, ComplexArray, IntArray
from robotmodels.linear.linear_model import LinearModel


@dataclass(frozen=True, eq=False)
class Tangents:
    """Derivatives by ln theta of mass, damping and stiffness, and of what is measured.

    Attributes
    ----------
    mass, damping, stiffness : ndarray, (Q, p, d, d)
        Mass, damping and stiffness.
    gravity : ndarray, (Q, p, d)
        Gravity torques.
    position, acceleration : ndarray, (Q, p, m, d)
        Of `Measurement.position` and `.acceleration`.
    ln_gain : ndarray, (p, n)
        Logarithms of the torque gains.
    delay : ndarray, (p,), s
        Measurement delay.
    """

    mass: Array
    damping: Array
    stiffness: Array
    gravity: Array
    position: Array
    acceleration: Array
    ln_gain: Array
    delay: Array

    def stiffened(self, stiffness: Array) -> "Tangents":
        """Return the tangents with `stiffness` (Q, p, d, d) added."""
        return replace(self, stiffness=self.stiffness + stiffness)

    def sensitivity(
        self,
        omega: Array,
        model: LinearModel,
        receptances: tuple[ComplexArray, ComplexArray] | None = None,
    ) -> ComplexArray:
        """Return the part of dG/d ln theta they add, (Q, F, m, n, p).

        dG = -Z^T (dK + j omega dD - omega^2 dM) X + dC X, then gains and delay. `receptances` are X
        and Z of the model, where the caller has them.
        """
        w = np.asarray(omega, dtype=float)[:, None, None, None]
        X, Z = model.receptances(omega) if receptances is None else receptances
        late = np.exp(-1j * w * model.measured.delay)
        J = np.zeros((*Z.shape[:2], Z.shape[-1], X.shape[-1], len(self.delay)), dtype=complex)
        moved = self._columns(self.mass, self.damping, self.stiffness)
        if len(moved):
            force = _times(self.stiffness[:, moved], X) - w**2 * _times(self.mass[:, moved], X)
            if self.damping.any():
                force += 1j * w * _times(self.damping[:, moved], X)
            q, f, d, n, p = force.shape
            answer = np.swapaxes(Z, -1, -2) @ force.reshape(q, f, d, n * p)
            J[..., moved] -= answer.reshape(q, f, -1, n, p)
        seen = self._columns(self.position, self.acceleration)
        if len(seen):
            change = _times(self.position[:, seen], X) - w**2 * _times(
                self.acceleration[:, seen], X
            )
            J[..., seen] += late * change
        if self.ln_gain.any() or self.delay.any():
            G = model.frequency_response(omega)[..., None]
            J += G * (self.ln_gain.T - 1j * w * self.delay)
        return J

    def _columns(self, *derivatives: Array) -> IntArray:
        """Return the parameters by which any of the derivatives is not zero."""
        return np.flatnonzero(sum(a.any(axis=(0, 2, 3)) for a in derivatives))


def _times(derivative: Array, columns: ComplexArray) -> ComplexArray:
    """Return derivative (Q, p, m, d) times columns (Q, F, d, n), as (Q, F, m, n, p)."""
    q, f, d, n = columns.shape
    p, m = derivative.shape[1:3]
    # One real product: real and imaginary parts lie side by side.
    flat = np.ascontiguousarray(columns.transpose(0, 2, 1, 3)).view(float).reshape(q, d, -1)
    product = (derivative.reshape(q, p * m, d) @ flat).view(complex)
    return np.ascontiguousarray(product.reshape(q, p, m, f, n).transpose(0, 3, 2, 4, 1))
