"""Figures of predictions: responses of a tool with bands, compliance over the workspace."""

from functools import partial

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from estimators.validation.predict_tool import ToolPrediction
from reports.figures.palette import Drawing, Palette
from reports.figures.ticks import plain_logarithm
from reports.text import significant
from robotmodels.elastic.tool_response import MOTIONS

_NOTHING = 1e-9  # of the largest response, below which there is no curve
_ON_BOTH = (0.3, 0.9)  # part of a scale of colours that is seen on light and on dark pages


def driving_point(prediction: ToolPrediction, position: int) -> Drawing:
    """Return responses along x, y, z to forces along the same, with bands, in one position."""

    def draw(palette: Palette) -> Figure:
        figure = Figure(figsize=(7.0, 4.4), layout="constrained")
        axes, below = figure.subplots(2, sharex=True, height_ratios=[2, 1])
        _curves(prediction, position, axes, below, palette)
        units = {"displacement": "m/N", "velocity": "m/s/N", "acceleration": "m/s²/N"}
        label = f"{MOTIONS[prediction.motion]} [{units[prediction.motion]}]"
        axes.set(yscale="log", xscale="log", ylabel=label)
        below.set(xlabel="frequency [Hz]", ylabel="std [%]", ylim=(0, None))
        _plain_ticks(axes)
        below.grid(True, axis="y")
        axes.grid(True, axis="y")
        figure.legend(loc="outside upper right", ncols=3)
        return figure

    return draw


def _curves(
    prediction: ToolPrediction, position: int, axes: Axes, below: Axes, palette: Palette
) -> None:
    """Draw responses with bands, and below them their standard deviations."""
    band, hertz = prediction.response, prediction.omega / (2 * np.pi)
    assert band is not None
    for i, colour in enumerate((palette.accent, palette.second, palette.ink)):
        values = np.abs(band.values[position, :, i, i])
        if not values.max() > _NOTHING * np.abs(band.values[position]).max():
            continue  # nothing moves along this axis
        axes.plot(hertz, values, color=colour, lw=1.2, label=f"{'xyz'[i]}, force along it")
        ends = band.lower[position, :, i, i], band.upper[position, :, i, i]
        axes.fill_between(hertz, *ends, color=colour, alpha=0.35, lw=0)
        below.plot(hertz, 100 * band.std[position, :, i, i], color=colour, lw=1.0)


def workspace(prediction: ToolPrediction) -> Drawing:
    """Return largest compliance, lowest resonance and its damping over where the point is."""

    def draw(palette: Palette) -> Figure:
        figure = Figure(figsize=(7.0, 8.0), layout="constrained")
        scale = ListedColormap(colormaps["viridis"](np.linspace(*_ON_BOTH, 256)))
        x, y, z = prediction.points.T
        resonances, deviations = prediction.resonances, "relative standard deviation [%]"
        damping = prediction.damping
        values = (
            ("softest compliance [µm/N]", 1e6 * prediction.compliance.values[:, 0].real),
            (deviations, 100 * prediction.compliance.std[:, 0]),
            ("lowest resonance [Hz]", resonances.values[:, 0].real / (2 * np.pi)),
            (deviations, 100 * resonances.std[:, 0]),
            ("damping ratio of that mode [%]", 100 * damping.values[:, 0].real),
            (deviations, 100 * damping.std[:, 0]),
        )
        for k, (title, value) in enumerate(values):
            axes = figure.add_subplot(3, 2, k + 1)
            dots = axes.scatter(np.hypot(x, y), z, c=value, s=18, cmap=scale)
            dots.set(edgecolors=palette.muted, linewidths=0.4)
            axes.set(title=title, xlabel="from the base's axis [m]")
            axes.set_ylabel("" if k % 2 else "height [m]")
            axes.tick_params(labelleft=not k % 2)  # the heights beside it
            figure.colorbar(dots, ax=axes)
        return figure

    return draw


def _plain_ticks(axes: Axes) -> None:
    """Label logarithmic axes with plain numbers."""
    plain_logarithm(axes.xaxis, partial(significant, digits=2))
    plain_logarithm(axes.yaxis, partial(significant, digits=1), (1.0,))
