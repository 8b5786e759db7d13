"""The law of noise: disturbances of torques pass the FRF, noise of sensors does not.

A disturbance of torques with variance D_j a motor and white noise of the sensors with variance V_i
make errors of outputs with covariance S(w) = G D G^H + diag(w^(2 d_i) V_i), if output i was
differentiated d_i times.
"""

from dataclasses import dataclass

import numpy as np

from robotmodels.common.arrays import Array, ComplexArray, IntArray

_STEPS = 300
"""To the maximum of the likelihood; of six axes covariances change by 1e-7 beyond."""
_LEAST = 1e-4
"""Part of all power that each share keeps, so that S stays regular."""
_NONE = 1e-100
"""Where there is no power at all."""


@dataclass(frozen=True, eq=False)
class NoiseLaw:
    """Variances that explain errors of outputs at many lines.

    Attributes
    ----------
    disturbances : ndarray, (n,), N^2 m^2
        Of the spectra of torques.
    sensors : ndarray, (m,)
        Of the spectra of outputs before they are differentiated.
    derivatives : ndarray of int, (m,)
        How often outputs were differentiated.
    count : int
        Variances that errors tell; the others are the least that are possible.
    """

    disturbances: Array
    sensors: Array
    derivatives: IntArray
    count: int = 0

    @classmethod
    def likeliest(
        cls, power: Array, omega: Array, response: ComplexArray, derivatives: IntArray
    ) -> "NoiseLaw":
        """Return the law that is likeliest for mean powers of errors.

        Powers are exponential (Whittle's likelihood); multiplicative steps keep variances positive
        and never lower it.

        Parameters
        ----------
        power : ndarray, (D, m)
            Mean squares of errors.
        omega : ndarray, (D,), rad/s
            Where.
        response : ndarray of complex, (D, m, n)
            FRF there.
        derivatives : ndarray of int, (m,)
            How often outputs were differentiated.
        """
        m, n = response.shape[1:]
        sensors = _growth(omega, derivatives)[:, :, None] * np.eye(m)
        shares = np.concatenate([np.abs(response) ** 2, sensors], axis=2)  # (D, m, n + m)
        law = np.einsum("di,dij->j", power, shares) / np.einsum("dij,dij->j", shares, shares)
        least = np.maximum(_LEAST * law, _NONE)
        for _ in range(_STEPS):
            expected = shares @ law
            slope = np.einsum("dij,di->j", shares, power / expected**2)
            step = np.sqrt(slope / np.einsum("dij,di->j", shares, 1 / expected))
            law = np.maximum(law * step, least)
        return cls(law[:n], law[n:], derivatives, int((law > least).sum()))

    def covariance(self, omega: Array, response: ComplexArray) -> ComplexArray:
        """Return S at lines with FRFs (..., F, m, n), (..., F, m, m)."""
        passed = (response * self.disturbances) @ np.conj(np.swapaxes(response, -1, -2))
        sensors = _growth(omega, self.derivatives) * self.sensors
        return np.asarray(passed + sensors[..., None] * np.eye(len(self.sensors)))

    def of_signals(self, omega: Array) -> ComplexArray:
        """Return the covariance of outputs and torques behind S, (F, m + n, m + n)."""
        sensors = _growth(omega, self.derivatives) * self.sensors
        disturbances = np.tile(self.disturbances, (len(omega), 1))
        variances = np.concatenate([sensors, disturbances], axis=1)
        return np.asarray(variances[:, :, None] * np.eye(variances.shape[1]), dtype=complex)

    def root(self, omega: Array, response: ComplexArray) -> ComplexArray:
        """Return Cholesky factors of S, (..., F, m, m)."""
        return np.asarray(np.linalg.cholesky(self.covariance(omega, response)))


def _growth(omega: Array, derivatives: IntArray) -> Array:
    return np.asarray(omega[:, None] ** (2 * derivatives))
