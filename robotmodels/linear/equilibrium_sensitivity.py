"""What frozen equilibria leave out: derivatives of everything but the springs themselves."""

from dataclasses import dataclass, replace

import numpy as np

from robotmodels.common.arrays import Array, ComplexArray, IntArray
from robotmodels.linear.linear_model import Channels, LinearModel, Measurement


@dataclass(frozen=True, eq=False)
class ChannelTangents:
    """Derivatives by ln theta of the gains, delays and lags of k channels.

    Attributes
    ----------
    ln_gain : ndarray, (p, k)
        Of logarithms of the gains' sizes.
    delay, lag : ndarray, (p, k), s
        Of delays and time constants.
    """

    ln_gain: Array
    delay: Array
    lag: Array

    def relative(self, omega: Array, channels: Channels) -> ComplexArray:
        """Return d ln h/d ln theta, (F, k, p)."""
        jw = 1j * np.asarray(omega, dtype=float)[:, None, None]
        lag = self.lag.T / (1 + jw * channels.lag[:, None])
        return np.asarray(self.ln_gain.T - jw * (self.delay.T + lag))


@dataclass(frozen=True, eq=False)
class Tangents:
    """Derivatives by ln theta of mass, damping and stiffness, and of what is measured.

    Attributes
    ----------
    mass, damping, stiffness : ndarray, (Q, p, d, d)
        Mass, damping and stiffness.
    gravity : ndarray, (Q, p, d)
        Gravity torques.
    rows : ndarray, (3, Q, p, m, d), or None
        Of `Measurement.position`, `.velocity` and `.acceleration`; None where they are fixed.
    delay : ndarray, (p,), s, or None
        Common delay; None where it is known.
    torque, sensor : ChannelTangents or None
        Of the channels of torques and outputs; None where they are known.
    """

    mass: Array
    damping: Array
    stiffness: Array
    gravity: Array
    rows: Array | None = None
    delay: Array | None = None
    torque: ChannelTangents | None = None
    sensor: ChannelTangents | None = None

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

        dG = -Z^T (dK + j omega dD - omega^2 dM) X + dC X, then gains, delays and lags.
        `receptances` are X and Z of the model, where the caller has them.
        """
        w = np.asarray(omega, dtype=float)[:, None, None, None]
        X, Z = model.receptances(omega) if receptances is None else receptances
        count = self.mass.shape[1]
        J = np.zeros((*Z.shape[:2], Z.shape[-1], X.shape[-1], count), dtype=complex)
        moved = self._columns(self.mass, self.damping, self.stiffness)
        if len(moved):
            force = self._forces(w[..., 0], X, moved)
            q, f, d, n, p = force.shape
            answer = np.swapaxes(Z, -1, -2) @ force.reshape(q, f, d, n * p)
            J[..., moved] -= answer.reshape(q, f, -1, n, p)
        if self.rows is not None:
            seen = self._columns(*self.rows)
            change = sum((1j * w) ** k * _times(C[:, seen], X) for k, C in enumerate(self.rows))
            J[..., seen] += model.measured.sensors(omega)[..., None, None] * change
        relative = self._relative(omega, model.measured)
        if relative.any():
            J += model.frequency_response(omega)[..., None] * relative
        return J

    def _forces(self, w: Array, motion: ComplexArray, moved: IntArray) -> ComplexArray:
        """Return (dK + j w dD - w^2 dM) motion, (Q, F, d, n, r), by the parameters `moved`."""
        matrices, motions = [self.stiffness, self.mass], [motion, -(w**2) * motion]
        if self.damping.any():
            matrices.append(self.damping)
            motions.append(1j * w * motion)
        wide = np.concatenate([matrix[:, moved] for matrix in matrices], axis=-1)
        return _times(wide, np.concatenate(motions, axis=2))

    def _relative(self, omega: Array, measured: Measurement) -> ComplexArray:
        """Return d ln G/d ln theta by gains, delays and lags, (F, m or 1, n or 1, p)."""
        jw = 1j * np.asarray(omega, dtype=float)[:, None, None, None]
        relative = np.zeros((1, 1, 1, self.mass.shape[1]), dtype=complex)
        if self.delay is not None:
            relative = relative - jw * self.delay
        if self.torque is not None:
            relative = relative + self.torque.relative(omega, measured.torque)[:, None]
        if self.sensor is not None and measured.sensor is not None:
            relative = relative + self.sensor.relative(omega, measured.sensor)[:, :, None]
        return relative

    def _columns(self, *derivatives: Array) -> IntArray:
        """Return the parameters by which any of the derivatives is not zero."""
        return np.flatnonzero(sum(a.any(axis=(0, 2, 3)) for a in derivatives))


def _times(derivative: Array, columns: ComplexArray) -> ComplexArray:
    """Return derivative (Q, p, m, d) times columns (Q, F, d, n), as (Q, F, m, n, p)."""
    q, f, d, n = columns.shape
    p, m = derivative.shape[1:3]
    result = np.empty((q, f, m, n, p), dtype=complex)
    for one, matrices, motion in zip(result, derivative, columns, strict=True):
        # Real products, position by position: what is turned over stays in the cache.
        rows = motion.swapaxes(-1, -2).reshape(-1, d)
        flat = matrices.transpose(2, 1, 0).reshape(d, m * p)
        one.real, one.imag = (
            (part @ flat).reshape(f, n, m, p).swapaxes(1, 2) for part in (rows.real, rows.imag)
        )
    return result
