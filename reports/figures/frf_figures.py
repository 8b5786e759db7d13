"""Figures of measured FRFs beside their panels: what moves between the excited lines."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from estimators.frf.distortion import Distortion
from reports.figures.palette import Palette
from reports.figures.ticks import plain_ticks
from reports.text import fixed
from robotmodels.common.arrays import Array

_COLUMNS = 3
_DEEPEST = 140.0  # [dB]


def detection_panels(
    distortion: Distortion, position: int, outputs: Sequence[str]
) -> Callable[[Palette], Figure]:
    """Return motion at excited and at detection lines of one position, a panel per output."""

    def draw(palette: Palette) -> Figure:
        columns = min(len(outputs), _COLUMNS)
        rows = -(-len(outputs) // columns)
        figure = Figure(figsize=(0.9 + 2.6 * columns, 0.5 + 2.0 * rows), layout="constrained")
        panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        for k, axes in enumerate(panels.flat):
            if k >= len(outputs):
                axes.set_axis_off()
                continue
            _panel(axes, distortion, position, k, palette)
            axes.set_title(outputs[k])
        low, high = _range(distortion, position)
        panels[0, 0].set_ylim(low, high)
        figure.supxlabel("frequency [Hz]", color=palette.muted, size=9)
        figure.supylabel("dB of 1 rad/s²", color=palette.muted, size=9)
        return figure

    return draw


def _panel(
    axes: Axes, distortion: Distortion, position: int, output: int, palette: Palette
) -> None:
    axes.grid(True)
    axes.set_axisbelow(True)
    hertz = distortion.omega / (2 * np.pi)
    axes.plot(hertz, decibels(distortion.output[position, :, output]), color=palette.accent, lw=1.0)
    for omega, level, noise, marker, colour in (
        (distortion.odd_omega, distortion.odd_level, distortion.odd_noise, "o", palette.second),
        (distortion.even_omega, distortion.even_level, distortion.even_noise, "x", palette.ink),
    ):
        if len(omega):
            f = omega / (2 * np.pi)
            axes.plot(f, decibels(noise[position, :, output]), color=palette.muted, lw=0.6)
            y = decibels(level[position, :, output])
            axes.plot(f, y, marker, color=colour, ms=2.8, mew=0.8)
    axes.set_xscale("log")
    plain_ticks(axes.xaxis)
    axes.yaxis.set_major_locator(MaxNLocator(5))
    plain_ticks(axes.yaxis, partial(fixed, decimals=0))


def _range(distortion: Distortion, position: int) -> tuple[float, float]:
    """Return the lowest and highest level to show [dB]."""
    shown = [
        getattr(distortion, name)[position].ravel()
        for name in ("output", "odd_level", "even_level", "odd_noise", "even_noise")
    ]
    levels = decibels(np.concatenate(shown))
    levels = levels[np.isfinite(levels)]
    high = float(levels.max())
    return max(float(levels.min()), high - _DEEPEST) - 5, high + 5


def decibels(values: Array) -> Array:
    """Return 20 log10, not a number where there is nothing."""
    positive = np.where(values > 0, values, np.nan)
    return np.asarray(20 * np.log10(positive))
