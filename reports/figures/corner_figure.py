"""The corner plot of a posterior: densities of each pair of parameters, with ellipses."""

from collections.abc import Sequence

import contourpy
import numpy as np
from matplotlib.ticker import FixedLocator

from reports.figures.panels import DASHES, Axis, Curve, Mark, Panel, Panels, Rule
from robotmodels.common.arrays import Array, IntArray

_ELLIPSE_RADII = (1.0, 2.0)
_BINS, _SMOOTHING = 36, 0.9  # bins, and standard deviation of the smoothing in bins
_REACH = int(4 * _SMOOTHING + 0.5)  # of the smoothing [bins]


def corner_plot(names: Sequence[str], draws: Array, covariance: Array, truth: Array) -> Panels:
    """Return a corner plot of draws, with Theorem 1's ellipses and the truth.

    Contours enclose the shares of draws that ellipses of one and two standard deviations would.

    Parameters
    ----------
    draws : ndarray, (N, k)
        ln theta less its estimate, times 100, that is in per cent.
    covariance : ndarray, (k, k)
        Covariance by Theorem 1 and `truth` (k,), in the same measure; NaN where unknown. The axes
        reach as far as the truth, however far it lies.
    """
    spans = corner_spans(draws, covariance, truth)
    edges = np.linspace(draws.min(axis=0), draws.max(axis=0), _BINS + 1)
    width = np.maximum(edges[1] - edges[0], 1e-300)
    bins = np.minimum(((draws - edges[0]) / width).astype(np.int64), _BINS - 1)
    middles = edges[0] + (np.arange(-_REACH, _BINS + _REACH)[:, None] + 0.5) * width
    last = len(names) - 1
    rows = []
    for i, name in enumerate(names):
        row: list[Panel | None] = [None] * len(names)
        for j in range(i):
            lines = contours(middles[:, j], middles[:, i], counted(bins[:, j], bins[:, i]))
            ellipses = _ellipses(covariance[np.ix_([j, i], [j, i])])
            marks = [*_truths(truth[j], truth[i]), Curve(*lines, "accent", 1.1), *ellipses]
            x = _axis(names[j], spans[j], outer=i == last)
            row[j] = Panel(marks, x, _axis(name, spans[i], outer=j == 0))
        steps = Curve(*_steps(edges[:, i], bins[:, i]), "accent", 1.1)
        height = Axis(limits=(0.0, None), names={}, line=False)
        row[i] = Panel(
            [*_truths(truth[i], np.nan), steps], _axis(name, spans[i], outer=i == last), height
        )
        rows.append(row)
    return Panels((1.35 * len(names) + 0.9,) * 2, rows)


def counted(across: IntArray, up: IntArray) -> IntArray:
    """Return how many draws lie in each bin, (_BINS, _BINS), rows upwards."""
    counts = np.bincount(up * _BINS + across, minlength=_BINS**2)
    return counts.reshape(_BINS, _BINS)


def _steps(edges: Array, bins: IntArray) -> tuple[Array, Array]:
    """Return the outline of a histogram."""
    heights = np.pad(np.bincount(bins, minlength=_BINS).astype(float), 1)
    return np.repeat(edges, 2), np.repeat(heights, 2)[1:-1]


def _axis(name: str, span: Array, *, outer: bool) -> Axis:
    low, high = (float(end) for end in span)
    ticks = FixedLocator(three_ticks(low, high))
    return Axis(name if outer else "", (low, high), locator=ticks, numbered=outer, grid=False)


def _truths(x: float, y: float) -> list[Mark]:
    """Return dashed lines at true values, where there are any."""
    ends = ((x, True), (y, False))
    return [Rule(float(v), "muted", 0.7, DASHES, upright=up) for v, up in ends if np.isfinite(v)]


def contours(x: Array, y: Array, counts: IntArray) -> tuple[Array, Array]:
    """Return lines about the densest bins, parted by NaN, with the shares of the ellipses within.

    Parameters
    ----------
    x, y : ndarray, (C + 2 _REACH,), (R + 2 _REACH,)
        Middles of the bins and of as many more as the smoothing reaches beyond.
    counts : ndarray of int, (R, C)
        Draws in each bin; they are smoothed by a normal distribution.
    """
    kernel = np.exp(-0.5 * (np.arange(-_REACH, _REACH + 1) / _SMOOTHING) ** 2)
    smooth = counts / kernel.sum() ** 2
    for axis in (0, 1):
        smooth = np.apply_along_axis(np.convolve, axis, smooth, kernel)
    falling = np.sort(smooth, axis=None)[::-1]
    shares = np.cumsum(falling) / falling.sum()
    drawer = contourpy.contour_generator(x, y, smooth)
    parts = [np.full((1, 2), np.nan)]
    for radius in _ELLIPSE_RADII:
        level = falling[np.searchsorted(shares, 1 - np.exp(-(radius**2) / 2))]
        for line in drawer.lines(level):
            parts += [np.asarray(line), parts[0]]
    across, up = np.concatenate(parts).T
    return across, up


def corner_spans(draws: Array, covariance: Array, truth: Array) -> Array:
    """Return the ends (k, 2) of axes that show draws, ellipses and, if there is one, the truth."""
    reach = max(_ELLIPSE_RADII) * np.sqrt(np.diagonal(covariance))
    low = np.minimum(draws.min(axis=0), np.fmin(-reach, truth))
    high = np.maximum(draws.max(axis=0), np.fmax(reach, truth))
    margin = 0.04 * (high - low)
    return np.stack([low - margin, high + margin], axis=1)


def three_ticks(low: float, high: float) -> list[float]:
    """Return zero and a round number on either side, far enough from the ends for its words.

    Where zero lies near one end, the round number is on the other side only.
    """
    short, long = sorted((-low, high))
    if short <= 0:
        return [low, high]
    lopsided = long > 2 * short
    reach = 0.75 * (long if lopsided else short)
    decade = 10.0 ** np.floor(np.log10(reach))
    step = float(decade * max(round_ for round_ in (1, 2, 5) if round_ * decade <= reach))
    if lopsided:
        return [0.0, step] if high > -low else [-step, 0.0]
    return [-step, 0.0, step]


def _ellipses(covariance: Array) -> list[Mark]:
    """Return the outlines of one and two standard deviations."""
    angle = np.linspace(0, 2 * np.pi, 73)
    x, y = np.linalg.cholesky(covariance) @ np.stack([np.cos(angle), np.sin(angle)])
    return [Curve(radius * x, radius * y, "second", 1.0) for radius in _ELLIPSE_RADII]
