"""An FRF matrix as Bode plots with axes of their own, for notebooks and papers."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from reports.figures.notebook_figure import NotebookFigure
from reports.figures.palette import Drawing, Palette
from reports.figures.response_panels import unbroken
from reports.figures.ticks import plain_logarithm, plain_ticks
from robotmodels.common.arrays import Array, ComplexArray


def bode(
    omega: Array,
    measured: ComplexArray,
    std: Array,
    inputs: Sequence[str],
    outputs: Sequence[str],
    model: tuple[Array, ComplexArray, Array | None] | None = None,
) -> Drawing:
    """Return magnitude above phase of each element.

    Parameters
    ----------
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    measured, std : ndarray, (F, m, n)
        Responses and their standard deviations.
    inputs, outputs : sequence of str
        Names of columns and rows.
    model : tuple of ndarray, optional
        Angular frequencies (G,) and responses (G, m, n) of a model, and the standard deviations of
        ln |G| if they are to be drawn.
    """
    m, n = measured.shape[1:]

    def draw(palette: Palette) -> Figure:
        figure = NotebookFigure(figsize=(1.2 + 1.9 * n, 0.7 + 2.3 * m), layout="constrained")
        ratios = {"height_ratios": [2, 1] * m}
        grid = figure.subplots(
            2 * m, n, squeeze=False, sharex=True, sharey="row", gridspec_kw=ratios
        )
        for i, j in np.ndindex(m, n):
            level, phase = grid[2 * i, j], grid[2 * i + 1, j]
            _measured(level, phase, omega / (2 * np.pi), measured[:, i, j], std[:, i, j], palette)
            if model is not None:
                of_model = None if model[2] is None else model[2][:, i, j]
                hertz, response = model[0] / (2 * np.pi), model[1][:, i, j]
                _modelled(level, phase, hertz, response, of_model, palette)
        for j, name in enumerate(inputs):
            grid[0, j].set_title(f"from {name}")
        for i, name in enumerate(outputs):
            grid[2 * i, 0].set_ylabel(f"to {name}")
        figure.supxlabel("frequency [Hz]", color=palette.muted, size=9)
        return figure

    return draw


def _measured(
    level: Axes, phase: Axes, hertz: Array, response: ComplexArray, std: Array, palette: Palette
) -> None:
    """Draw an element with its band, and set up its axes."""
    size = np.abs(response)
    ends = np.maximum(size - std, 1e-3 * size), size + std
    level.fill_between(hertz, *ends, color=palette.accent, alpha=0.28, lw=0)
    level.plot(hertz, size, color=palette.accent, lw=0.9)
    phase.plot(hertz, np.degrees(np.angle(response)), ".", color=palette.accent, ms=2)
    level.set(xscale="log", yscale="log")
    phase.set(ylim=(-185, 185), yticks=(-180, 0, 180))
    plain_logarithm(phase.xaxis)
    level.yaxis.set_major_locator(LogLocator(numticks=4))
    plain_ticks(level.yaxis)


def _modelled(
    level: Axes,
    phase: Axes,
    hertz: Array,
    response: ComplexArray,
    std: Array | None,
    palette: Palette,
) -> None:
    """Draw a model's element, with the band by its standard deviations of ln |G|."""
    if std is not None:
        low, high = np.abs(response) * np.exp(np.multiply.outer([-1, 1], std))
        level.fill_between(hertz, low, high, color=palette.second, alpha=0.28, lw=0)
    level.plot(hertz, np.abs(response), color=palette.second, lw=1.2)
    x, turns = unbroken(hertz, np.angle(response))
    phase.plot(x, np.degrees(turns), color=palette.second, lw=1.2)
