"""Runs of a small elastic system with noise on inputs and outputs."""

import numpy as np
from mass_springs import OMEGA, POSITIONS, MassSprings

from estimators import RunSpectra
from robotmodels.linear.response import frequency_response

MODEL = MassSprings()
TRUTH = MODEL.parameters.values
RESPONSE = frequency_response(MODEL, POSITIONS, OMEGA, TRUTH)  # (Q, F, 2, 2)
Q, F = RESPONSE.shape[:2]


def circular(rng, *shape):
    """Complex normal numbers of variance one."""
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)


def noise_root(input_noise, output_noise, correlated=True):
    """T (F, 4, 4) with T T^H the covariance of [Y; U], relative to their rms at each line."""
    output = output_noise * np.sqrt((np.abs(RESPONSE) ** 2).sum(axis=3).mean(axis=0))
    scale = np.concatenate([output, np.full((F, 2), input_noise)], axis=1)
    mix = np.eye(4) + 0j
    if correlated:
        mix = mix + 0.5 * circular(np.random.default_rng(5), 4, 4)
        mix /= np.linalg.norm(mix, axis=1, keepdims=True)
    return scale[:, :, None] * mix


def noisy_runs(rng, runs, input_noise=0.1, output_noise=0.1, freedom=np.inf, correlated=True):
    """Random-phase runs; the covariance is known, or sampled with so many degrees of freedom."""
    U = circular(rng, Q, runs, F, 2)
    Y = np.einsum("qfmn,qefn->qefm", RESPONSE, U)
    root = noise_root(input_noise, output_noise, correlated)
    covariance = np.broadcast_to(root @ np.conj(root.swapaxes(1, 2)), (Q, F, 4, 4))
    if np.isfinite(freedom):
        draws = np.einsum("fij,qfjk->qfik", root, circular(rng, Q, F, 4, int(freedom)))
        covariance = draws @ np.conj(draws.swapaxes(2, 3)) / freedom
    N = np.einsum("fij,qefj->qefi", root, circular(rng, Q, runs, F, 4))
    return RunSpectra(POSITIONS, OMEGA, U + N[..., 2:], Y + N[..., :2], covariance, freedom)
