"""Band-limited interpolation of evenly sampled signals, and what it gets wrong."""

from collections.abc import Callable

import numpy as np

from robotmodels.common.arrays import Array

HALF_WIDTH = 32
"""Samples on each side that the kernel takes."""
_BETA = 9.0  # of the Kaiser window: ripple of about 1e-4 of what is below 0.9 Nyquist
_EDGE = 0.9
_NODES = 1 << 12


def interpolate(read: Callable[[int, int], Array], rows: int, where: Array, step: float) -> Array:
    """Return a signal at fractional rows by a windowed sinc.

    Parameters
    ----------
    read : callable
        Returns rows ``start`` to ``stop``.
    rows : int
        Number of rows; before the first and after the last the end values go on.
    where : ndarray, (N,)
        Fractional rows, rising.
    step : float
        Spacing of `where`; above one the band is narrowed accordingly.

    Returns
    -------
    ndarray, (N,)
        Values there.
    """
    wide = max(1.0, step)
    half = int(np.ceil(HALF_WIDTH * wide))
    low, high = int(np.floor(where[0])) - half, int(np.ceil(where[-1])) + half + 1
    inside = read(max(low, 0), min(high, rows))
    values = np.pad(inside, (max(0, -low), max(0, high - rows)), mode="edge")
    base = np.floor(where).astype(int)
    total, weight = np.zeros(len(where)), np.zeros(len(where))
    for offset in range(-half + 1, half + 1):
        distance = (where - base - offset) / wide
        kernel = np.sinc(distance) * _window(distance)
        total += kernel * values[base + offset - low]
        weight += kernel
    return np.asarray(total / weight)  # constants stay exact


def band_edge_share(values: Array, step: float) -> float:
    """Return the part of a signal, as rms over rms, that interpolation does not get right.

    It lies above 0.9 of the Nyquist frequency, of the new samples where they are sparser.
    """
    if len(values) < 16 or not np.isfinite(values).all():
        return 0.0
    n = len(values)
    smooth = values - np.linspace(values[0], values[-1], n)  # ends meet
    spectrum = np.abs(np.fft.rfft((smooth - smooth.mean()) * np.hanning(n))) ** 2
    total = spectrum.sum()
    edge = int(_EDGE * len(spectrum) / max(1.0, step))
    return float(np.sqrt(spectrum[edge:].sum() / total)) if total > 0 else 0.0


def _window(distance: Array) -> Array:
    grid = np.linspace(0.0, 1.0, _NODES)
    window = np.i0(_BETA * np.sqrt(1 - grid**2)) / np.i0(_BETA)
    return np.interp(np.abs(distance) / HALF_WIDTH, grid, window, right=0.0)
