"""Figures of profile likelihoods: how the data constrain one parameter, all others adapted."""

from collections.abc import Sequence
from statistics import NormalDist

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from estimators.sampling.profile_likelihood import Profile
from reports.figures.notebook_figure import NotebookFigure
from reports.figures.study_figures import Drawing
from reports.figures.svg import Palette
from robotmodels.common.arrays import Array

_COLUMNS, _POINTS = 3, 121


def profiles(curves: Sequence[Profile], estimate: Array, std: Array) -> Drawing:
    """Return the rise of -2 log p over each parameter, beside the parabola of a covariance.

    Parameters
    ----------
    curves : sequence of Profile, (k,)
        With their curves.
    estimate : ndarray, (k,)
        Estimates [SI], from which deviations are drawn in per cent.
    std : ndarray, (k,)
        Relative standard deviations, of the parabolas.
    """

    def draw(palette: Palette) -> Figure:
        rows = -(-len(curves) // _COLUMNS)
        figure = NotebookFigure(figsize=(7.6, 0.5 + 1.9 * rows), layout="constrained")
        grid = figure.subplots(rows, _COLUMNS, squeeze=False, sharey=True).ravel()
        for axes, one, value, width in zip(grid, curves, estimate, std, strict=False):
            _panel(axes, one, float(value), float(width), palette)
        for axes in grid[len(curves) :]:
            axes.set_visible(False)
        figure.supxlabel("deviation from the estimate [%]", color=palette.muted, size=9)
        figure.supylabel("rise of −2 log p", color=palette.muted, size=9)
        return figure

    return draw


def _panel(axes: Axes, one: Profile, estimate: float, std: float, palette: Palette) -> None:
    """Draw one profile, its interval and the parabola."""
    rise = NormalDist().inv_cdf((1 + one.level) / 2) ** 2
    at, height, between, smooth = _smooth(one, estimate)
    axes.plot(between, smooth, color=palette.accent, lw=1.4)
    axes.plot(at, height, "o", color=palette.accent, ms=3)
    axes.plot(between, (between / (100 * std)) ** 2, color=palette.second, lw=1.4, dashes=(6, 6))
    axes.axhline(rise, color=palette.muted, lw=0.8, dashes=(1, 2))
    for end in (one.lower, one.upper):
        axes.axvline(100 * np.log(end / estimate), color=palette.muted, lw=0.8, dashes=(1, 2))
    axes.set(ylim=(0, 3 * rise))
    axes.set_title(one.name, loc="left")
    axes.grid(True)
    axes.set_axisbelow(True)


def _smooth(one: Profile, estimate: float) -> tuple[Array, Array, Array, Array]:
    """Return the points of a curve, (2, n), and the curve between them, (2, N), in per cent.

    The signed root of a rise is nearly linear, which makes it easy to interpolate.
    """
    values, rises = np.insert(one.curve, 0, [one.mode, 0.0], axis=1)
    at = 100 * np.log(values / estimate)
    order = np.argsort(at)
    order = order[np.isfinite(rises[order])]
    at, height = at[order], np.maximum(rises[order], 0.0)
    root = np.sign(at - 100 * np.log(one.mode / estimate)) * np.sqrt(height)
    between = np.linspace(at[0], at[-1], _POINTS)
    return at, height, between, np.interp(between, at, root) ** 2
