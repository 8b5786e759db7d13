"""Bode panels of an FRF matrix: magnitude above phase for each element, on shared axes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from reports.figures.svg import Palette
from reports.text import fixed
from robotmodels.common.arrays import Array, ComplexArray, IntArray

_DEEPEST = 160.0  # of a panel [dB]
# Percentiles of what is drawn that may lie below a panel; a model dips far under any noise.
_LEAST_LEVEL, _LEAST_FITTED = 5.0, 2.0
# Between columns, rows, and a magnitude and its phase, in widths and heights of the magnitude.
_GAP_X, _GAP_Y, _GAP_PHASE = 0.09, 0.16, 0.05
_PHASE = 0.5  # height of a phase
_PITCH = 1 + _GAP_PHASE + _PHASE + _GAP_Y  # from row to row


@dataclass(frozen=True, eq=False)
class _Scales:
    """What all panels share: frequencies [Hz] and levels [dB], each mapped to 0 ... 1."""

    frequency: Array
    low: float
    high: float

    def across(self, frequency: Array) -> Array:
        first, last = np.log(self.frequency[[0, -1]])
        return np.asarray((np.log(frequency) - first) / max(last - first, 1e-12))

    def up(self, magnitude: Array) -> Array:
        level = 20 * np.log10(np.maximum(magnitude, 1e-300))
        return np.asarray((level - self.low) / (self.high - self.low))

    def line(self, magnitude: Array) -> Array:
        """Return heights of a curve, clipped near the panel, with gaps where there is no value."""
        positive = np.where(magnitude > 0, magnitude, np.nan)
        return np.asarray(np.where(magnitude > 0, np.maximum(self.up(positive), -0.3), np.nan))

    def frequency_ticks(self) -> Array:
        """Return 1, 2, 5, 10, ... Hz, or fewer where they would crowd."""
        first, last = self.frequency[[0, -1]]
        steps = (1, 2, 5) if last / first < 12 else (1, 5) if last / first < 60 else (1,)
        ticks = np.array([m * 10.0**e for e in range(-4, 7) for m in steps])
        inside = ticks[(ticks >= first * 0.999) & (ticks <= last * 1.001)]
        return inside if inside.size else self.frequency[:1]

    def level_ticks(self) -> Array:
        return np.asarray(MaxNLocator(4, steps=[1, 2, 4, 5, 10]).tick_values(self.low, self.high))


def response_panels(
    omega: Array,
    measured: ComplexArray,
    std: Array,
    fitted: ComplexArray | None,
    motors: Sequence[str],
    noise: Array | None = None,
    distortion: Array | None = None,
    outputs: Sequence[str] | None = None,
) -> Callable[[Palette], Figure]:
    """Return a drawing of an FRF, (F, m, n): measured with its band `std`, and fitted.

    `noise` and `distortion`, (F, m, n), are parts of `std`, drawn as levels below; where one is
    zero or not a number there is a gap. `outputs` names the rows, which are motors by default.

    One pair of axes holds all panels: drawing separate axes takes ten times as long.
    """
    below = [part for part in (noise, distortion) if part is not None]
    low, high = _level_range(np.abs(measured), below, fitted)
    scales = _Scales(omega / (2 * np.pi), low, high)

    curves = _Curves(measured, std, fitted, noise, distortion)

    def draw(palette: Palette) -> Figure:
        rows, columns = measured.shape[1:]
        figure, axes = _canvas(rows, columns)
        for i, j in np.ndindex(rows, columns):
            left_edge, low = j * (1 + _GAP_X), -i * _PITCH - 1
            heights = (scales.level_ticks() - scales.low) / (scales.high - scales.low)
            frame = _panel(axes, (left_edge, low), 1.0, scales, heights, palette)
            artists = curves.magnitude(axes, (i, j), (left_edge, low), scales, palette)
            below = low - _GAP_PHASE - _PHASE
            phase_frame = _panel(axes, (left_edge, below), _PHASE, scales, np.array([0.5]), palette)
            for artist in artists:
                artist.set_clip_path(frame)
            for artist in curves.phase(axes, (i, j), (left_edge, below), scales, palette):
                artist.set_clip_path(phase_frame)
        _labels(axes, motors if outputs is None else outputs, motors, scales, palette)
        return figure

    return draw


@dataclass(frozen=True, eq=False)
class _Curves:
    """What is drawn in the panels of an element, all (F, m, n)."""

    measured: ComplexArray
    std: Array
    fitted: ComplexArray | None
    noise: Array | None
    distortion: Array | None

    def magnitude(
        self,
        axes: Axes,
        element: tuple[int, int],
        corner: tuple[float, float],
        scales: _Scales,
        palette: Palette,
    ) -> list[Artist]:
        """Draw the measured magnitude in its band, the fitted one, and levels below."""
        at = (slice(None), *element)
        x, base = corner[0] + scales.across(scales.frequency), corner[1]
        size, std = np.abs(self.measured[at]), self.std[at]
        lower = np.maximum(scales.up(np.maximum(size - std, 0)), -0.1)
        ends = base + lower, base + scales.up(size + std)
        band = axes.fill_between(x, *ends, color=palette.accent, alpha=0.28, lw=0)
        shown = (
            (self.noise, palette.muted, 0.6),
            (self.distortion, palette.ink, 0.6),
            (np.abs(self.measured), palette.accent, 0.7),
            (None if self.fitted is None else np.abs(self.fitted), palette.second, 1.1),
        )
        artists: list[Artist] = [band]
        for values, colour, width in shown:
            if values is not None:
                artists += axes.plot(x, base + scales.line(values[at]), color=colour, lw=width)
        if self.distortion is not None:
            lone = base + _lone(scales.line(self.distortion[at]))
            artists += axes.plot(x, lone, ".", color=palette.ink, ms=1.6, mew=0)
        return artists

    def phase(
        self,
        axes: Axes,
        element: tuple[int, int],
        corner: tuple[float, float],
        scales: _Scales,
        palette: Palette,
    ) -> list[Artist]:
        """Draw phases from -180 to 180 degrees; the measured one where it is more than noise."""
        at = (slice(None), *element)
        above_noise = np.where(self.std[at] < np.abs(self.measured[at]), self.measured[at], np.nan)
        artists: list[Artist] = []
        for values, colour, width in (
            (above_noise, palette.accent, 0.7),
            (None if self.fitted is None else self.fitted[at], palette.second, 1.1),
        ):
            if values is not None:
                x, turns = _unbroken(scales.across(scales.frequency), np.angle(values))
                y = corner[1] + _PHASE * (turns / (2 * np.pi) + 0.5)
                artists += axes.plot(corner[0] + x, y, color=colour, lw=width)
        return artists


def _unbroken(x: Array, phase: Array) -> tuple[Array, Array]:
    """Return a wrapped phase with a gap wherever it jumps from one edge to the other."""
    jumps = np.flatnonzero(np.abs(np.diff(phase)) > np.pi) + 1
    return np.insert(x, jumps, np.nan), np.insert(phase, jumps, np.nan)


def _level_range(
    magnitude: Array, below: Sequence[Array], fitted: ComplexArray | None = None
) -> tuple[float, float]:
    """Return the lowest and highest level to show [dB], whole tens."""
    level = 20 * np.log10(np.maximum(magnitude, 1e-300))
    low, high = float(np.percentile(level, 0.5)), float(level.max())
    parts = [(part, _LEAST_LEVEL) for part in below]
    parts += [] if fitted is None else [(np.abs(fitted), _LEAST_FITTED)]
    for part, percentile in parts:
        positive = part[part > 0]
        if positive.size:
            low = min(low, float(20 * np.log10(np.percentile(positive, percentile))))
    low = max(low, high - _DEEPEST)
    return 10 * float(np.floor(low / 10)), 10 * float(np.ceil((high + 1) / 10))


def _lone(heights: Array) -> Array:
    """Return the points with a gap on either side, of which a line shows nothing."""
    gap = np.concatenate([[True], np.isnan(heights), [True]])
    return np.asarray(np.where(gap[:-2] & gap[2:], heights, np.nan))


def _canvas(rows: int, columns: int) -> tuple[Figure, Axes]:
    """Return a figure whose data coordinates are panels, with margins for labels [inch]."""
    width, height = (1.5, 1.17) if columns > 2 else (2.7, 2.0) if columns == 2 else (4.6, 2.4)
    # Labels keep their distance in panel heights.
    left, right, bottom, top = max(0.68, 0.45 * width), 0.05, 0.43 * height, 0.24 * height
    across = columns + (columns - 1) * _GAP_X
    down = rows * _PITCH - _GAP_Y
    figure = Figure(figsize=(left + across * width + right, bottom + down * height + top))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    axes.set_xlim(-left / width, across + right / width)
    axes.set_ylim(-down - bottom / height, top / height)
    return figure, axes


def _panel(
    axes: Axes,
    corner: tuple[float, float],
    height: float,
    scales: _Scales,
    levels: Array,
    palette: Palette,
) -> Rectangle:
    """Draw grid and spines of one panel; return the frame that clips its curves.

    Parameters
    ----------
    levels : ndarray
        Levels of the horizontal lines, as parts of the height.
    """
    x0, y0 = corner
    x = x0 + scales.across(scales.frequency_ticks())
    y = y0 + height * levels[(levels >= -1e-9) & (levels <= 1 + 1e-9)]
    lines = [[(v, y0), (v, y0 + height)] for v in x] + [[(x0, v), (x0 + 1, v)] for v in y]
    broken = np.concatenate([np.array([*line, (np.nan, np.nan)]) for line in lines])
    axes.plot(*broken.T, color=palette.rule, lw=0.5)  # one path for all is short
    axes.plot([x0, x0, x0 + 1], [y0 + height, y0, y0], color=palette.muted, lw=0.6)
    return Rectangle(corner, 1, height, transform=axes.transData)


def _labels(
    axes: Axes,
    outputs: Sequence[str],
    motors: Sequence[str],
    scales: _Scales,
    palette: Palette,
) -> None:
    small: dict[str, Any] = {"size": 8, "color": palette.muted}
    columns = len(motors)
    bottom = _GAP_Y - len(outputs) * _PITCH
    ticks = scales.frequency_ticks()
    for j in range(columns):
        left_edge = j * (1 + _GAP_X)
        axes.text(left_edge + 0.5, 0.07, f"from {motors[j]}", ha="center", va="bottom")
        for tick, x in zip(ticks, left_edge + scales.across(ticks), strict=True):
            axes.text(float(x), bottom - 0.05, f"{tick:g}", ha="center", va="top", **small)
    for i in range(len(outputs)):
        low = -i * _PITCH - 1
        axes.text(-0.4, low + 0.3, f"to {outputs[i]}", ha="center", va="center", rotation=90)
        for tick in scales.level_ticks():
            y = (tick - scales.low) / (scales.high - scales.low)
            if 0.06 < y <= 1 + 1e-9:  # the lowest would meet the phase's highest
                level = fixed(float(tick), 0)
                axes.text(-0.05, low + float(y), level, ha="right", va="center", **small)
        for part, degrees in ((0.0, -180), (0.5, 0), (1.0, 180)):
            y = low - _GAP_PHASE - _PHASE * (1 - part)
            label = fixed(degrees, 0) + "°"
            align = {0.0: "bottom", 0.5: "center", 1.0: "top"}[part]
            axes.text(-0.05, y, label, ha="right", va=align, **small)
    middle = (columns + (columns - 1) * _GAP_X) / 2
    words = "frequency [Hz]"
    axes.text(middle, bottom - 0.24, words, ha="center", va="top", color=palette.muted)


BUDGET = 3_200_000
"""Bytes that all panels of a page may take."""

_BYTES_OF_ELEMENT, _BYTES_OF_LINE, _FEWEST = 900, 46, 20
"""What an element of a position takes, and each of its lines; fewest lines to draw."""


def lines_drawn(shape: tuple[int, ...]) -> IntArray:
    """Return which lines of (Q, F, m, n) responses are drawn: all, or evenly so many as fit."""
    positions, lines, m, n = shape
    room = (BUDGET / (positions * m * n) - _BYTES_OF_ELEMENT) / _BYTES_OF_LINE
    count = min(lines, max(int(room), _FEWEST))
    return np.unique(np.linspace(0, lines - 1, count).round().astype(np.int64))
