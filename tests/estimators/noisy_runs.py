"""Runs of elastic systems with noise on inputs and outputs."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from derivatives import circular
from mass_springs import OMEGA, POSITIONS, MassSprings

from estimators import RunSpectra
from robotmodels.linear.response import frequency_response


@dataclass(frozen=True, eq=False)
class NoisySystem:
    """A model in positions, at lines; noise is relative to the rms of each signal at a line."""

    model: object
    positions: np.ndarray = field(default_factory=lambda: POSITIONS)
    omega: np.ndarray = field(default_factory=lambda: OMEGA)

    @property
    def truth(self):
        """Parameters (p,)."""
        return self.model.parameters.values

    @cached_property
    def response(self):
        """FRF (Q, F, m, n)."""
        return frequency_response(self.model, self.positions, self.omega, self.truth)

    def noise_root(self, input_noise, output_noise, correlated=True):
        """T (F, m + n, m + n) with T T^H the covariance of [Y; U]."""
        F, m, n = self.response.shape[1:]
        output = output_noise * np.sqrt((np.abs(self.response) ** 2).sum(axis=3).mean(axis=0))
        scale = np.concatenate([output, np.full((F, n), input_noise)], axis=1)
        mix = np.eye(m + n) + 0j
        if correlated:
            mix = mix + 0.5 * circular(np.random.default_rng(5), m + n, m + n)
            mix /= np.linalg.norm(mix, axis=1, keepdims=True)
        return scale[:, :, None] * mix

    def runs(self, rng, runs, input_noise=0.1, output_noise=0.1, freedom=np.inf, correlated=True):
        """Random-phase runs; the covariance is known, or sampled with degrees of freedom."""
        Q, F, m, n = self.response.shape
        U = circular(rng, Q, runs, F, n)
        Y = np.einsum("qfmn,qefn->qefm", self.response, U)
        root = self.noise_root(input_noise, output_noise, correlated)
        covariance = np.broadcast_to(root @ np.conj(root.swapaxes(1, 2)), (Q, F, m + n, m + n))
        if np.isfinite(freedom):
            draws = np.einsum("fij,qfjk->qfik", root, circular(rng, Q, F, m + n, int(freedom)))
            covariance = draws @ np.conj(draws.swapaxes(2, 3)) / freedom
        N = np.einsum("fij,qefj->qefi", root, circular(rng, Q, runs, F, m + n))
        outputs, inputs = Y + N[..., :m], U + N[..., m:]
        return RunSpectra(self.positions, self.omega, inputs, outputs, covariance, freedom)


SMALL = NoisySystem(MassSprings())
MODEL, TRUTH, RESPONSE = SMALL.model, SMALL.truth, SMALL.response
Q, F = RESPONSE.shape[:2]
noise_root, noisy_runs = SMALL.noise_root, SMALL.runs
