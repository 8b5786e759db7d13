"""Lines that were not excited: what they show of the noise of those that were.

Feedback and friction move torques and outputs there alike, by the robot's own FRF. So what does not
fit the FRF at these lines is noise: of sensors, which grows with the frequency, or of disturbances
of torques, which the FRF passes on.
"""

from dataclasses import dataclass

import numpy as np

from estimators.input_output.noise_law import NoiseLaw
from robotmodels.common.arrays import Array, ComplexArray, IntArray

_SHRINK = 2
"""Draws without correlation that each output adds to those of its correlation with others."""


@dataclass(frozen=True, eq=False)
class SilentLines:
    """Spectra of one position at lines that were not excited.

    Attributes
    ----------
    omega : ndarray, (D,), rad/s
        Angular frequencies.
    outputs : ndarray of complex, (K, D, m)
        Outputs of K runs.
    inputs : ndarray of complex, (K, D, n) or (K, D, 2 n)
        Torques, and behind them the shares of friction, if it is estimated.
    derivatives : ndarray of int, (m,)
        How often outputs were differentiated: so the noise of the sensors grows.
    nearest : ndarray of int, (F, k)
        Lines that show the noise of each excited one.
    """

    omega: Array
    outputs: ComplexArray
    inputs: ComplexArray
    derivatives: IntArray
    nearest: IntArray

    @property
    def degrees_of_freedom(self) -> float:
        """Complex degrees of freedom of the covariance of a line."""
        return float(self.nearest.shape[1] * len(self.outputs))

    def covariance(self, omega: Array) -> ComplexArray:
        """Return the covariance of outputs and inputs at excited lines `omega`, (F, c, c)."""
        near = self.nearest
        outputs = self._growth(omega) * self.outputs[:, near]
        return self._products(np.concatenate([outputs, self.inputs[:, near]], axis=-1))

    def covariance_beside(
        self, omega: Array, at: ComplexArray, here: ComplexArray
    ) -> tuple[ComplexArray, float, float]:
        """Return the covariance of outputs and torques beside what FRFs explain.

        Levels of friction are those of these lines: a robot that fits badly elsewhere has other
        ones there. Errors are whitened by their law here. What correlation is left, shrunk towards
        none, counts for all lines, their size for the nearest; the law colours them there.

        Parameters
        ----------
        omega : ndarray, (F,), rad/s
            Excited lines.
        at : ndarray of complex, (F, m, n)
            FRF at the excited lines.
        here : ndarray of complex, (D, m, n)
            FRF at the lines that were not.

        Returns
        -------
        covariance : ndarray of complex, (F, m + n, m + n)
            Of errors of outputs; torques count as exact, as their errors are in those.
        degrees_of_freedom : float
            By how much it scatters: that of a Wishart matrix whose inverse is as large in the mean.
        draws : float
            Complex draws that all lines share in it.
        """
        m, n = here.shape[1:]
        law = NoiseLaw(np.zeros(n), np.ones(m), self.derivatives)
        for _ in range(2):
            whiten = np.asarray(np.linalg.inv(law.root(self.omega, here)))
            torques = self._torques(whiten, here)
            errors = self._errors(torques, here)
            power = (np.abs(errors) ** 2).mean(axis=0)
            law = NoiseLaw.likeliest(power, self.omega, here, self.derivatives)
        white = np.asarray(np.linalg.solve(law.root(self.omega, here), errors[..., None])[..., 0])
        W, size, alike = _correlation(white)
        draws = white[..., 0].size
        told = min(law.count + (self.inputs.shape[2] - n) / 2, draws * m / 2)
        # The law fits these lines better than others by the share of what it has from them.
        scale = size[self.nearest].mean(axis=1) / (len(white) * m) / (1 - told / (draws * m))
        root = law.root(omega, at) * np.sqrt(scale)[:, None, None]
        covariance = np.zeros((len(omega), m + n, m + n), dtype=complex)
        covariance[:, :m, :m] = root @ W @ np.conj(np.swapaxes(root, 1, 2))
        freedom = 1 / (1 / (self.degrees_of_freedom * m**2) + alike)
        return covariance, float(freedom), float(draws * m - told)

    def _torques(self, whiten: ComplexArray, here: ComplexArray) -> ComplexArray:
        """Return torques less friction of the levels that leave least errors, (K, D, n)."""
        n = here.shape[2]
        torques, shares = self.inputs[..., :n], self.inputs[..., n:]
        if not shares.size:
            return torques
        moved = (whiten @ here) * shares[..., None, :]  # (K, D, m, n)
        errors = self._errors(torques, here)
        moved = moved.reshape(-1, n)
        white = -np.einsum("dim,kdm->kdi", whiten, errors).ravel()
        levels = np.linalg.lstsq(
            np.concatenate([moved.real, moved.imag]), np.concatenate([white.real, white.imag])
        )[0]
        return np.asarray(torques - levels * shares)

    def _errors(self, torques: ComplexArray, here: ComplexArray) -> ComplexArray:
        """Return what torques (K, D, n) leave of the outputs, (K, D, m)."""
        return np.asarray(self.outputs - np.einsum("dmn,kdn->kdm", here, torques))

    def _growth(self, omega: Array) -> Array:
        """Return by how much more the noise of sensors is at excited lines, (F, k, m)."""
        ratio = omega[:, None] / self.omega[self.nearest]
        return np.asarray(ratio[..., None] ** self.derivatives)

    def _products(self, draws: ComplexArray) -> ComplexArray:
        """Return the mean products of draws (K, F, k, c), (F, c, c)."""
        total = np.einsum("bfsi,bfsk->fik", draws, np.conj(draws))
        return np.asarray(total / self.degrees_of_freedom)


def _correlation(white: ComplexArray) -> tuple[ComplexArray, Array, float]:
    """Return the correlation W (m, m) of draws (K, D, m), their sizes (D,), and how W scatters.

    W is shrunk towards none; sizes are sums of x^H W^-1 x; W scatters as one over its degrees of
    freedom does.
    """
    m, draws = white.shape[2], white[..., 0].size
    prior = _SHRINK * m
    products = np.einsum("kdi,kdj->ij", white, np.conj(white))
    W = (products / products.trace().real * m * draws + prior * np.eye(m)) / (draws + prior)
    size = np.einsum("kdi,ij,kdj->d", np.conj(white), np.linalg.inv(W), white).real
    return np.asarray(W), size, draws * (1 - 1 / m**2) / (draws + prior) ** 2
