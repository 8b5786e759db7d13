"""Crest factors: how much of a signal's peak is energy, and how to get more of it.

Clipping a signal and keeping only the phases of the result, again and again, lowers the peaks of
a multisine whose amplitudes are prescribed (Van der Ouderaa, Schoukens and Renneboog 1988). Input
i of an orthogonal multisine has all its phases turned by 2 pi i l / n in run l; one set of
phases has to serve all n, so that it is their common peak that is lowered.

Starting from random phases, blocks still differ at random, as averaging out distortions needs;
their phases are no longer independent from line to line, though.
"""

import numpy as np
from scipy.fft import next_fast_len

from oed.experiment.multisine import Multisine
from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput

# Points per period of the highest line; clipping sees peaks to a few percent, which is enough.
_POINTS = 10
# Clipping at this part of the peak, rising to 1, is slow enough not to get stuck.
_FIRST_CLIP, _LAST_CLIP = 0.75, 0.98


def crest_factor(signal: Array, axis: int = -2) -> Array:
    """Return peak over root mean square along the axis of time; a sine has sqrt 2."""
    signal = np.asarray(signal, dtype=float)
    return np.asarray(np.abs(signal).max(axis=axis) / np.sqrt(np.mean(signal**2, axis=axis)))


def reduced_crest(grid: Multisine, phases: Array, iterations: int = 200) -> Array:
    """Return phases, (B, F, n), near `phases` with lower peaks over all runs.

    Parameters
    ----------
    grid : Multisine
        Lines and amplitudes, which stay as they are.
    phases : ndarray, (B, F, n)
        Where to start; the outcome depends on nothing else.
    iterations : int
        How often to clip.

    Raises
    ------
    InvalidInput
        If `iterations` is negative or the phases have a wrong shape.
    """
    if iterations < 0:
        raise InvalidInput(f"crest_iterations: {iterations}; a number >= 0 is needed")
    shape = (len(grid.lines), grid.inputs)
    if phases.ndim != 3 or phases.shape[1:] != shape:
        raise InvalidInput(f"phases: shape {phases.shape}; (B, {shape[0]}, {shape[1]}) is needed")
    lowered = np.array(phases, dtype=float)
    for i in range(grid.inputs):
        lowered[:, :, i] = _clipped(grid, lowered[:, :, i], i, iterations)
    return lowered


def _clipped(grid: Multisine, phases: Array, motor: int, iterations: int) -> Array:
    """Return the lowest of `iterations` clippings of one input's phases, (B, F)."""
    turns = _turns(motor, grid.inputs)
    amplitudes = grid.amplitudes[:, motor] / np.linalg.norm(grid.amplitudes[:, motor])
    points = next_fast_len(max(_POINTS * int(grid.lines[-1]), 64), real=True)
    best, lowest = phases.copy(), np.full(len(phases), np.inf)
    levels = np.linspace(_FIRST_CLIP, _LAST_CLIP, iterations)
    for level in [*levels, None]:
        spectrum = np.zeros((len(phases), len(turns), points // 2 + 1), dtype=complex)
        lines = amplitudes * np.exp(1j * phases)
        spectrum[:, :, grid.lines] = turns[:, None] * lines[:, None, :]
        signal = np.fft.irfft(spectrum, points)
        peak = np.abs(signal).max(axis=(1, 2))
        better = peak < lowest
        best[better], lowest[better] = phases[better], peak[better]
        if level is not None:
            limit = level * peak[:, None, None]
            after = np.fft.rfft(np.clip(signal, -limit, limit))[:, :, grid.lines]
            phases = np.angle(np.einsum("e,bef->bf", turns.conj(), after))
    return np.asarray(best % (2 * np.pi))


def _turns(motor: int, inputs: int) -> Array:
    """Return the turns e^{2 pi j i l / n} of input i that differ by more than a sign."""
    steps = {(2 * motor * run) % inputs for run in range(inputs)}
    return np.asarray(np.exp(1j * np.pi * np.array(sorted(steps)) / inputs))
