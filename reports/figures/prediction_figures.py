"""Figures of predictions: responses of a tool with bands, compliance over the workspace."""

from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from estimators.validation.predict_tool import ToolPrediction
from reports.figures.palette import Drawing, Palette
from reports.text import significant
from robotmodels.elastic.tool_response import MOTIONS


def driving_point(prediction: ToolPrediction, position: int) -> Drawing:
    """Return responses along x, y, z to forces along the same, with bands, in one position."""

    def draw(palette: Palette) -> Figure:
        figure = Figure(figsize=(7.0, 3.2), layout="constrained")
        axes = figure.add_subplot()
        band, hertz = prediction.response, prediction.omega / (2 * np.pi)
        assert band is not None
        for i, colour in enumerate((palette.accent, palette.second, palette.ink)):
            values = np.abs(band.values[position, :, i, i])
            axes.plot(hertz, values, color=colour, lw=1.2, label="xyz"[i])
            ends = band.lower[position, :, i, i], band.upper[position, :, i, i]
            axes.fill_between(hertz, *ends, color=colour, alpha=0.2, lw=0)
        units = {"displacement": "m/N", "velocity": "m/s/N", "acceleration": "m/s²/N"}
        label = f"{MOTIONS[prediction.motion]} [{units[prediction.motion]}]"
        axes.set(yscale="log", xscale="log", xlabel="frequency [Hz]", ylabel=label)
        _plain_ticks(axes)
        axes.grid(True, axis="y")
        figure.legend(loc="outside upper right", ncols=3)
        return figure

    return draw


def workspace(prediction: ToolPrediction) -> Drawing:
    """Return largest compliance, lowest resonance and its damping over where the point is."""

    def draw(palette: Palette) -> Figure:
        figure = Figure(figsize=(7.0, 8.0), layout="constrained")
        x, y, z = prediction.points.T
        resonances, deviations = prediction.resonances, "relative deviation [%]"
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
            dots = axes.scatter(np.hypot(x, y), z, c=value, s=14, cmap="viridis")
            axes.set(title=title, xlabel="from the base's axis [m]", ylabel="height [m]")
            figure.colorbar(dots, ax=axes)
        return figure

    return draw


def _plain_ticks(axes: Axes) -> None:
    """Label logarithmic axes with plain numbers."""
    for axis, subs, digits in ((axes.xaxis, (1.0, 2.0, 5.0), 2), (axes.yaxis, (1.0,), 1)):
        axis.set_major_locator(LogLocator(subs=subs))
        axis.set_major_formatter(FuncFormatter(partial(_tick, digits)))
        axis.set_minor_formatter(NullFormatter())


def _tick(digits: int, value: float, _: int) -> str:
    return significant(value, digits)
