"""How many torques are independent of each other at a line, above what is noise in them."""

import numpy as np

from estimators.frf.spectra import Spectra, spectra
from robotmodels.common.arrays import Array, ComplexArray, IntArray
from robotmodels.records.records import Records

_ROUNDING = 1e-8  # of a motor's torque, rms over lines
_UNASKED = 1e-6  # of its reference
_NEAREST = 6
"""Lines without excitation that show a line's noise, where there is one period only."""


def input_noise(records: Records, measured: Spectra, lines: IntArray) -> Array:
    """Return the standard deviations of the period-averaged torques of one position, (F, n).

    From bins between those of the periods. Of one period from the nearest lines within the band
    that were left out, which hold distortion too: zero where there are none, or where references
    tell what was excited.
    """
    if measured.noise_input.shape[1]:
        count = max(int(measured.present.sum()) * measured.noise_input.shape[1], 1)
        power = (np.abs(measured.noise_input) ** 2).sum(axis=(0, 1, 4)) / count
        return np.asarray(np.sqrt(power))
    others = np.setdiff1d(np.arange(records.lines[0], records.lines[-1]), records.lines)
    if len(others) < _NEAREST or records.reference.any():
        return np.zeros(measured.input.shape[2:4])
    torque = spectra(records, 0, others).input[:, 0]  # (B, F', n, E)
    power = (np.abs(torque) ** 2).sum(axis=(0, 3)) / max(int(measured.present.sum()), 1)
    nearest = np.argsort(np.abs(others - lines[:, None]), axis=1)[:, :_NEAREST]
    return np.asarray(np.sqrt(power[nearest].mean(axis=1)))


def side_by_side(signal: ComplexArray, measured: Spectra) -> ComplexArray:
    """Return a signal (B, P, F, c, E), averaged over periods, of all runs present, (F, c, r)."""
    runs = np.concatenate(list(signal.mean(axis=1)), axis=-1)
    return np.asarray(runs[..., measured.present.reshape(-1)])


def input_rank(inputs: ComplexArray, noise: Array, least: float = _ROUNDING) -> IntArray:
    """Return the rank (F,) of torques (F, n, r) whose noise has standard deviations (F, n).

    Counted are singular values above those of noise alone, and above the part `least` of their
    mean: behind j larger ones noise is left in n - j rows and r - j columns, whose singular values
    are at most about sqrt(n - j) + sqrt(r - j) times its standard deviation.
    """
    _, n, runs = inputs.shape
    rank = np.arange(min(n, runs))
    edge = np.sqrt(n - rank) + np.sqrt(runs - rank)
    rounding = least * np.sqrt(runs * np.mean(np.abs(inputs) ** 2, axis=(0, 2)))
    scale = np.hypot(noise, rounding / edge[0])
    scaled = inputs / np.where(scale > 0, scale, np.inf)[..., None]
    above = np.linalg.svd(scaled, compute_uv=False) > edge
    return np.asarray(np.logical_and.accumulate(above, axis=-1).sum(axis=-1))


def excited_rank(measured: Spectra, noise: Array) -> IntArray:
    """Return the rank (F,) of the torques of all runs: at most that of their references."""
    rank = input_rank(side_by_side(measured.input, measured), noise)
    if not measured.reference.any():
        return rank
    reference = side_by_side(measured.reference, measured)
    return np.minimum(rank, input_rank(reference, np.zeros(noise.shape), _UNASKED))


def condition_numbers(inputs: ComplexArray) -> Array:
    """Return the condition numbers (...) of inputs (..., n, r), motors of any size."""
    size = np.sqrt(np.mean(np.abs(inputs) ** 2, axis=-1, keepdims=True))
    values = np.linalg.svd(inputs / np.where(size == 0, 1.0, size), compute_uv=False)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = values[..., 0] / values[..., -1]
    return np.asarray(np.where(values[..., -1] > 0, ratio, np.inf))
