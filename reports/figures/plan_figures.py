"""Figures of plans: what more visits bring."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from reports.figures.notebook_figure import NotebookFigure
from reports.figures.study_figures import Drawing, plain_logarithm
from reports.figures.svg import Palette
from robotmodels.common.arrays import Array, IntArray


def trade_off(
    cost: Array | IntArray,
    std: Array,
    names: Sequence[str],
    *,
    bound: Array | None = None,
    label: str = "visits",
) -> Drawing:
    """Return the largest and the median standard deviation over the robot's time or visits.

    Parameters
    ----------
    cost : ndarray, (C,)
        Visits or minutes of each plan.
    std : ndarray, (C, p)
        Relative standard deviations of the parameters `names`; infinite ones leave a gap.
    bound : ndarray, (C,), optional
        Certified efficiency of each plan, written below the curve.
    label : str
        What `cost` is.
    """

    def draw(palette: Palette) -> Figure:
        figure = NotebookFigure(figsize=(7.0, 2.9 if bound is None else 3.6), layout="constrained")
        ratios = [1] if bound is None else [3, 1]
        grid = figure.subplots(
            len(ratios), 1, squeeze=False, sharex=True, gridspec_kw={"height_ratios": ratios}
        )[:, 0]
        _accuracy(grid[0], cost, std, names, palette)
        if bound is not None:
            grid[1].plot(cost, 100 * bound, "o-", color=palette.accent, ms=3, lw=1.3)
            grid[1].set(ylabel="efficiency [%]", ylim=(None, 101))
        grid[-1].set(xlabel=label)
        grid[-1].xaxis.set_major_locator(MaxNLocator(10, integer=label == "visits"))
        for axes in grid:
            axes.grid(True)
            axes.set_axisbelow(True)
        return figure

    return draw


def _accuracy(
    axes: Axes, cost: Array | IntArray, std: Array, names: Sequence[str], palette: Palette
) -> None:
    """Draw every parameter's standard deviation, their largest and their median."""
    worst = int(np.argmax(np.where(np.isfinite(std[-1]), std[-1], -np.inf)))
    every = np.isfinite(std).all(axis=1)
    shown = np.where(np.isfinite(std), 100 * std, np.nan)
    axes.plot(cost, shown, color=palette.rule, lw=0.6)
    for values, colour, words in (
        (shown.max(axis=1), palette.accent, f"largest, at last {names[worst]}"),
        (np.median(shown, axis=1), palette.second, "median"),
    ):
        gaps = np.where(every, values, np.nan)
        axes.plot(cost, gaps, "o-", color=colour, ms=3, lw=1.3, label=words)
    axes.set(yscale="log", ylabel="std [%]")
    axes.legend()
    plain_logarithm(axes.yaxis)
