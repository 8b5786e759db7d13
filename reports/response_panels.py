"""Magnitudes of an FRF matrix, a panel per element, on shared axes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from reports.svg import Palette
from reports.text import fixed
from robotmodels.arrays import Array, ComplexArray

_DEEPEST = 160.0  # of a panel [dB]
_GAP_X, _GAP_Y = 0.09, 0.12  # between panels, in panel widths and heights


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
        """Return heights of a curve: kept near the panel, with gaps where there is no value."""
        known = np.where(magnitude > 0, magnitude, np.nan)
        return np.asarray(np.where(magnitude > 0, np.maximum(self.up(known), -0.3), np.nan))

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

    One pair of axes holds all panels: drawing them as axes of their own takes ten times as long.
    """
    below = [part for part in (noise, distortion) if part is not None]
    low, high = _level_range(np.abs(measured), below)
    scales = _Scales(omega / (2 * np.pi), low, high)

    def draw(palette: Palette) -> Figure:
        rows, columns = measured.shape[1:]
        figure, axes = _canvas(rows, columns)
        for i, j in np.ndindex(rows, columns):
            corner = (j * (1 + _GAP_X), -i * (1 + _GAP_Y) - 1)
            frame = _panel(axes, corner, scales, palette)
            x = corner[0] + scales.across(scales.frequency)
            magnitude = np.abs(measured[:, i, j])
            lower = np.maximum(scales.up(np.maximum(magnitude - std[:, i, j], 0)), -0.1)
            upper = scales.up(magnitude + std[:, i, j])
            band = axes.fill_between(
                x,
                corner[1] + lower,
                corner[1] + upper,
                color=palette.accent,
                alpha=0.28,
                lw=0,
            )
            shown = [
                (noise, palette.muted, 0.6),
                (distortion, palette.ink, 0.6),
                (np.abs(measured), palette.accent, 0.7),
                (None if fitted is None else np.abs(fitted), palette.second, 1.1),
            ]
            curves = [
                axes.plot(x, corner[1] + scales.line(values[:, i, j]), color=c, lw=width)[0]
                for values, c, width in shown
                if values is not None
            ]
            if distortion is not None:
                lone = corner[1] + _lone(scales.line(distortion[:, i, j]))
                curves += axes.plot(x, lone, ".", color=palette.ink, ms=1.6, mew=0)
            for artist in (band, *curves):
                artist.set_clip_path(frame)
        _labels(axes, motors if outputs is None else outputs, motors, scales, palette)
        return figure

    return draw


def _level_range(magnitude: Array, below: Sequence[Array]) -> tuple[float, float]:
    """Return the lowest and highest level to show [dB], whole tens."""
    level = 20 * np.log10(np.maximum(magnitude, 1e-300))
    low, high = float(np.percentile(level, 0.5)), float(level.max())
    for part in below:
        positive = part[part > 0]
        if positive.size:
            low = min(low, float(20 * np.log10(np.percentile(positive, 5))))
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
    down = rows + (rows - 1) * _GAP_Y
    figure = Figure(figsize=(left + across * width + right, bottom + down * height + top))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    axes.set_xlim(-left / width, across + right / width)
    axes.set_ylim(-down - bottom / height, top / height)
    return figure, axes


def _panel(axes: Axes, corner: tuple[float, float], scales: _Scales, palette: Palette) -> Rectangle:
    """Draw grid and spines of one panel; return the frame that clips its curves."""
    x0, y0 = corner
    x = x0 + scales.across(scales.frequency_ticks())
    y = y0 + (scales.level_ticks() - scales.low) / (scales.high - scales.low)
    y = y[(y >= y0 - 1e-9) & (y <= y0 + 1 + 1e-9)]
    lines = [[(v, y0), (v, y0 + 1)] for v in x] + [[(x0, v), (x0 + 1, v)] for v in y]
    broken = np.concatenate([np.array([*line, (np.nan, np.nan)]) for line in lines])
    axes.plot(*broken.T, color=palette.rule, lw=0.5)  # one path for all is short
    axes.plot([x0, x0, x0 + 1], [y0 + 1, y0, y0], color=palette.muted, lw=0.6)
    return Rectangle(corner, 1, 1, transform=axes.transData)


def _labels(
    axes: Axes,
    outputs: Sequence[str],
    motors: Sequence[str],
    scales: _Scales,
    palette: Palette,
) -> None:
    rows, columns = len(outputs), len(motors)
    bottom = -rows - (rows - 1) * _GAP_Y
    for j in range(columns):
        left = j * (1 + _GAP_X)
        axes.text(left + 0.5, 0.07, f"from {motors[j]}", ha="center", va="bottom")
        for tick, x in zip(
            scales.frequency_ticks(), scales.across(scales.frequency_ticks()), strict=True
        ):
            axes.text(
                left + float(x),
                bottom - 0.05,
                f"{tick:g}",
                ha="center",
                va="top",
                size=8,
                color=palette.muted,
            )
    for i in range(rows):
        low = -i * (1 + _GAP_Y) - 1
        axes.text(-0.36, low + 0.5, f"to {outputs[i]}", ha="center", va="center", rotation=90)
        for tick in scales.level_ticks():
            y = (tick - scales.low) / (scales.high - scales.low)
            if -1e-9 <= y <= 1 + 1e-9:
                axes.text(
                    -0.05,
                    low + float(y),
                    fixed(float(tick), 0),
                    ha="right",
                    va="center",
                    size=8,
                    color=palette.muted,
                )
    middle = (columns + (columns - 1) * _GAP_X) / 2
    axes.text(middle, bottom - 0.24, "frequency [Hz]", ha="center", va="top", color=palette.muted)
