"""Figures of modes: frequencies and damping ratios with their intervals, over positions."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from estimators.validation.predict_tool import ToolPrediction
from reports.figures.notebook_figure import NotebookFigure
from reports.figures.study_figures import Drawing
from reports.figures.svg import Palette


def modes(prediction: ToolPrediction) -> Drawing:
    """Return resonances and damping ratios of each position, with one standard deviation."""
    frequency, damping = prediction.resonances, prediction.damping
    panels = (
        ("resonance [Hz]", frequency.values.real / (2 * np.pi), frequency.std),
        ("damping ratio [%]", 100 * damping.values.real, damping.std),
    )
    number = np.arange(1, len(prediction.points) + 1)

    def draw(palette: Palette) -> Figure:
        figure = NotebookFigure(figsize=(7.0, 2.6), layout="constrained")
        colours = (palette.accent, palette.second, palette.ink, palette.muted)
        for axes, (title, values, std) in zip(figure.subplots(1, 2), panels, strict=True):
            for k in range(values.shape[1]):
                colour, y = colours[k % len(colours)], values[:, k]
                axes.errorbar(
                    number, y, y * std[:, k], fmt="o", color=colour, ms=4, label=f"mode {k + 1}"
                )
            axes.set(xlabel="position", ylabel=title, ylim=(0, None), xlim=(0.5, len(number) + 0.5))
            axes.xaxis.set_major_locator(MaxNLocator(12, integer=True))
            axes.grid(True, axis="y")
            axes.set_axisbelow(True)
        figure.legend(*axes.get_legend_handles_labels(), loc="outside upper right", ncols=4)
        return figure

    return draw
