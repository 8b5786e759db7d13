"""Figures of how certain the parameters are: intervals, correlations, corner."""

from collections.abc import Sequence
from typing import Any

import corner
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from reports.figures import Drawing
from reports.svg import Palette
from reports.text import MINUS
from robotmodels.arrays import Array

_ELLIPSE_RADII = (1.0, 2.0)


def intervals(
    names: Sequence[str], offsets: tuple[Array, Array], stds: tuple[Array, Array]
) -> Drawing:
    """Return estimates against the truth in per cent, one standard deviation either way.

    offsets, stds : of ln theta, (p,) by Theorem 1 and by emcee; the truth lies at zero.
    """

    def draw(palette: Palette) -> Figure:
        groups = _groups(names)
        longest = max(len(group) for group in groups.values())
        figure = Figure(figsize=(8.2, 0.95 + 0.2 * longest), layout="constrained")
        grid = figure.subplots(1, len(groups), squeeze=False)[0]
        colours = (palette.accent, palette.second)
        labels = ("Theorem 1", "emcee")
        for axes, (title, group) in zip(grid, groups.items(), strict=True):
            axes.axvline(0, color=palette.muted, lw=0.8)
            for shift, offset, std, colour, label in zip(
                (-0.16, 0.16), offsets, stds, colours, labels, strict=True
            ):
                y = np.arange(len(group)) + shift
                x, half = 100 * offset[group], 100 * std[group]
                axes.hlines(y, x - half, x + half, color=colour, lw=1.6)
                axes.plot(x, y, "o", color=colour, ms=3.4, label=label)
            axes.set_yticks(range(len(group)), [names[i].rsplit(".", 1)[0] for i in group])
            axes.set_ylim(longest - 0.4, -0.6)
            axes.tick_params(axis="y", length=0)
            axes.xaxis.set_major_locator(MaxNLocator(6))
            axes.set_title(title)
            axes.set_xlabel("estimate against truth [%]")
            axes.grid(True, axis="x")
            axes.set_axisbelow(True)
            axes.spines["left"].set_visible(False)
        handles, _ = grid[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper right", ncols=2)
        return figure

    return draw


def correlation_map(names: Sequence[str], correlation: Array) -> Drawing:
    """Return the correlations (p, p) as a map: one colour for each sign, strength as opacity."""

    def draw(palette: Palette) -> Figure:
        p = len(names)
        side = max(0.19 * p, 1.6)
        figure = Figure(figsize=(side + 1.3, side + 1.15), layout="constrained")
        axes = figure.add_subplot()
        rows, columns = np.nonzero(np.abs(correlation) >= 0.02)
        edges = [(j - 0.5, i - 0.5, correlation[i, j]) for i, j in zip(rows, columns, strict=True)]
        for left, top, value in edges:
            colour = palette.second if value > 0 else palette.accent
            axes.fill(
                [left, left + 1, left + 1, left],
                [top, top, top + 1, top + 1],
                color=colour,
                alpha=round(min(abs(value), 1.0), 2),
                lw=0,
            )
        axes.set(xlim=(-0.5, p - 0.5), ylim=(p - 0.5, -0.5), aspect="equal")
        axes.set_xticks(range(p), names, rotation=90)
        axes.set_yticks(range(p), names)
        axes.tick_params(length=0, labelsize=7.5)
        for spine in axes.spines.values():
            spine.set(visible=True, color=palette.rule)
        return figure

    return draw


def corner_plot(names: Sequence[str], draws: Array, covariance: Array, truth: Array) -> Drawing:
    """Return a corner plot of draws, with Theorem 1's ellipses and the truth.

    draws : (N, k) ln theta less its estimate, times 100, that is in per cent.
    covariance : (k, k) by Theorem 1 and `truth` (k,), in the same measure.
    """

    def draw(palette: Palette) -> Figure:
        k = len(names)
        figure = Figure(figsize=(1.35 * k + 0.9, 1.35 * k + 0.9))
        figure.subplots(k, k)
        corner.corner(
            draws,
            fig=figure,
            bins=36,
            labels=list(names),
            color=palette.accent,
            smooth=0.9,
            levels=[1 - np.exp(-(r**2) / 2) for r in _ELLIPSE_RADII],
            plot_datapoints=False,
            plot_density=False,
            fill_contours=False,
            no_fill_contours=True,
            contour_kwargs={"colors": [palette.accent], "linewidths": 1.1},
            hist_kwargs={"lw": 1.1},
            max_n_ticks=3,
            labelpad=-0.05,
            label_kwargs={"fontsize": 8},
        )
        grid: Any = np.array(figure.axes).reshape(k, k)
        for i, j in np.ndindex(k, k):
            if j > i:
                continue
            axes = grid[i, j]
            axes.axvline(float(truth[j]), color=palette.muted, lw=0.7, dashes=(3, 2))
            if i != j:
                axes.axhline(float(truth[i]), color=palette.muted, lw=0.7, dashes=(3, 2))
                for radius in _ELLIPSE_RADII:
                    x, y = radius * _ellipse(covariance[np.ix_([j, i], [j, i])])
                    axes.plot(x, y, color=palette.second, lw=1.0)
            axes.tick_params(labelsize=7, length=2, labelrotation=0)
            outer = ([axes.xaxis] if i == k - 1 else []) + ([axes.yaxis] if j == 0 < i else [])
            for axis in outer:
                axis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}".replace("-", MINUS)))
            for spine in axes.spines.values():
                spine.set_color(palette.rule)
        return figure

    return draw


def _ellipse(covariance: Array) -> Array:
    """Return the outline of one standard deviation, (2, N)."""
    angle = np.linspace(0, 2 * np.pi, 73)
    return np.asarray(np.linalg.cholesky(covariance) @ np.stack([np.cos(angle), np.sin(angle)]))


def _groups(names: Sequence[str]) -> dict[str, list[int]]:
    """Return the indices of springs, dampers and others, each under its name for people."""
    groups: dict[str, list[int]] = {}
    for i, name in enumerate(names):
        kind = name.rsplit(".", 1)[-1]
        groups.setdefault(
            {"stiffness": "Springs", "damping": "Dampers"}.get(kind, "Others"), []
        ).append(i)
    return groups
