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
    fitted: ComplexArray,
    motors: Sequence[str],
) -> Callable[[Palette], Figure]:
    """Return a drawing of an FRF, (F, m, n): measured with its band `std`, and fitted.

    One pair of axes holds all panels: drawing them as axes of their own takes ten times as long.
    """
    level = 20 * np.log10(np.maximum(np.abs(measured), 1e-300))
    low, high = 10 * np.floor(np.percentile(level, 0.5) / 10), 10 * np.ceil((level.max() + 1) / 10)
    scales = _Scales(omega / (2 * np.pi), float(low), float(high))

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
            curves = [
                axes.plot(x, corner[1] + np.maximum(scales.up(values), -0.3), color=c, lw=width)[0]
                for values, c, width in (
                    (magnitude, palette.accent, 0.7),
                    (np.abs(fitted[:, i, j]), palette.second, 1.1),
                )
            ]
            for artist in (band, *curves):
                artist.set_clip_path(frame)
        _labels(axes, rows, columns, motors, scales, palette)
        return figure

    return draw


def _canvas(rows: int, columns: int) -> tuple[Figure, Axes]:
    """Return a figure whose data coordinates are panels, with margins for labels [inch]."""
    width, height = (1.5, 1.17) if columns > 2 else (2.7, 2.0)
    left, right, bottom, top = 0.68, 0.05, 0.5, 0.28
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
    rows: int,
    columns: int,
    motors: Sequence[str],
    scales: _Scales,
    palette: Palette,
) -> None:
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
        axes.text(-0.36, low + 0.5, f"to {motors[i]}", ha="center", va="center", rotation=90)
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
