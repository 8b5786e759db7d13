"""Figures of how certain the parameters are: intervals, correlations, corner."""

from collections.abc import Sequence
from typing import Any

import corner
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from reports.figures.notebook_figure import NotebookFigure
from reports.figures.study_figures import Drawing
from reports.figures.svg import Palette
from reports.text import MINUS
from robotmodels.common.arrays import Array

_ELLIPSE_RADII = (1.0, 2.0)
_SHADE, _LEAST_SHADE = 0.05, 0.02


def intervals(
    names: Sequence[str],
    offsets: Sequence[Array],
    stds: Sequence[Array],
    methods: Sequence[str],
    reference: str,
) -> Drawing:
    """Return estimates in per cent of a reference, one standard deviation either way.

    Parameters
    ----------
    offsets, stds : sequence of ndarray
        Of ln theta, (p,) by each of the `methods`; the reference lies at zero.
    """

    def draw(palette: Palette) -> Figure:
        groups = parameter_groups(names)
        longest = max(len(group) for group in groups.values())
        step = 0.2 + 0.08 * max(len(methods) - 2, 0)
        figure = NotebookFigure(figsize=(8.2, 0.95 + step * longest), layout="constrained")
        grid = figure.subplots(1, len(groups), squeeze=False)[0]
        colours = (palette.accent, palette.second, palette.ink, palette.muted)
        shifts = 0.16 * (2 * np.arange(len(methods)) - len(methods) + 1)
        if len(methods) > 2:
            shifts *= 1.6 / len(methods)
        for axes, (title, group) in zip(grid, groups.items(), strict=True):
            axes.axvline(0, color=palette.muted, lw=0.8)
            for k, (shift, offset, std, label) in enumerate(
                zip(shifts, offsets, stds, methods, strict=True)
            ):
                colour = colours[k % len(colours)]
                y = np.arange(len(group)) + shift
                x, half = 100 * offset[group], 100 * std[group]
                axes.hlines(y, x - half, x + half, color=colour, lw=1.6)
                axes.plot(x, y, "o", color=colour, ms=3.4, label=label)
            axes.set_yticks(range(len(group)), [names[i].rsplit(".", 1)[0] for i in group])
            axes.set_ylim(longest - 0.4, -0.6)
            axes.tick_params(axis="y", length=0)
            axes.xaxis.set_major_locator(MaxNLocator(6))
            axes.set_title(title)
            axes.set_xlabel(f"estimate against {reference} [%]")
            axes.grid(True, axis="x")
            axes.set_axisbelow(True)
            axes.spines["left"].set_visible(False)
        handles, _ = grid[0].get_legend_handles_labels()
        figure.legend(handles, methods, loc="outside upper right", ncols=len(methods))
        return figure

    return draw


def deviations(
    names: Sequence[str],
    stds: Sequence[Array],
    studies: Sequence[str],
    ends: Sequence[Array | None] | None = None,
) -> Drawing:
    """Return relative standard deviations on a logarithmic axis.

    Parameters
    ----------
    stds : sequence of ndarray
        (p,) of each study, or (k, p) of several that share a name.
    ends : sequence of ndarray, (p, 2), optional
        Ends between which the true ones of a study lie, drawn as a bar; None for no bar.
    """

    def draw(palette: Palette) -> Figure:
        groups = parameter_groups(names)
        longest = max(len(group) for group in groups.values())
        figure = NotebookFigure(figsize=(8.2, 0.95 + 0.2 * longest), layout="constrained")
        grid = figure.subplots(1, len(groups), squeeze=False)[0]
        colours = (palette.accent, palette.second, palette.ink, palette.muted)
        bars = [None] * len(stds) if ends is None else ends
        # Bars lie beside each other.
        offsets = np.linspace(-0.22, 0.22, len(stds)) if ends else np.zeros(len(stds))
        for axes, (title, group) in zip(grid, groups.items(), strict=True):
            # The first study last, on top of the others.
            for k in reversed(range(len(stds))):
                colour, bar = colours[k % len(colours)], bars[k]
                x = 100 * np.atleast_2d(stds[k])[:, group]
                rows = np.arange(len(group)) + offsets[k]
                y = np.tile(rows, len(x))
                axes.plot(x.ravel(), y, "o", color=colour, ms=4 if len(x) == 1 else 2.5)
                if bar is not None:
                    axes.hlines(rows, *100 * bar[group].T, color=colour, lw=1.4)
            axes.set_yticks(range(len(group)), [names[i].rsplit(".", 1)[0] for i in group])
            axes.set(ylim=(longest - 0.4, -0.6), xscale="log", title=title)
            axes.set_xlabel("relative standard deviation [%]")
            _plain_decades(axes)
        handles = [
            Line2D([], [], marker="o", ls="", ms=4, color=colours[k % len(colours)])
            for k in range(len(stds))
        ]
        figure.legend(handles, studies, loc="outside upper right", ncols=len(studies))
        return figure

    return draw


def _plain_decades(axes: Axes) -> None:
    """Write a logarithmic axis in plain figures, with ticks enough where it is short."""
    low, high = axes.get_xlim()
    if high < 10 * low:
        axes.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    elif high < 200 * low:
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.tick_params(axis="y", length=0)
    axes.grid(True)
    axes.set_axisbelow(True)
    axes.spines["left"].set_visible(False)


def correlation_map(names: Sequence[str], correlation: Array) -> Drawing:
    """Return the correlations (p, p) as a map: one colour for each sign, strength as opacity."""

    def draw(palette: Palette) -> Figure:
        p = len(names)
        side = max(0.19 * p, 1.6)
        figure = NotebookFigure(figsize=(side + 1.9, side + 1.15), layout="constrained")
        axes, key = figure.subplots(1, 2, width_ratios=[side, 0.16])
        rows, columns = np.indices((p, p)).reshape(2, -1)
        corners = np.stack([columns - 0.5, rows - 0.5], axis=1)
        _shade(axes, corners, (1.0, 1.0), correlation.ravel(), palette)
        axes.set(xlim=(-0.5, p - 0.5), ylim=(p - 0.5, -0.5), aspect="equal")
        axes.set_xticks(range(p), names, rotation=90)
        axes.set_yticks(range(p), names)
        axes.tick_params(length=0, labelsize=7.5)
        levels = np.arange(-1, 1, _SHADE) + _SHADE / 2
        edges = np.stack([np.zeros_like(levels), levels - _SHADE / 2], axis=1)
        _shade(key, edges, (1.0, _SHADE), levels, palette)
        key.set(xlim=(0, 1), ylim=(-1, 1))
        key.set_xticks([])
        key.set_yticks([-1, -0.5, 0, 0.5, 1], [f"{MINUS}1", f"{MINUS}0.5", "0", "0.5", "1"])
        key.yaxis.tick_right()
        key.tick_params(labelsize=7.5)
        key.set_title("correlation", size=7.5, color=palette.muted)
        for spine in (*axes.spines.values(), *key.spines.values()):
            spine.set(visible=True, color=palette.rule)
        return figure

    return draw


def _shade(
    axes: Axes, corners: Array, size: tuple[float, float], values: Array, palette: Palette
) -> None:
    """Fill rectangles at `corners` (N, 2) by the sign and strength of `values`, (N,)."""
    steps = np.rint(values / _SHADE).astype(int)
    steps = np.where(np.abs(values) < _LEAST_SHADE, 0, np.where(steps == 0, np.sign(values), steps))
    outline = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]) * size
    for step in np.unique(steps[steps != 0]):
        squares = [Path(corner + outline, closed=True) for corner in corners[steps == step]]
        axes.add_patch(
            PathPatch(
                Path.make_compound_path(*squares),
                color=palette.second if step > 0 else palette.accent,
                alpha=round(min(abs(int(step)) * _SHADE, 1.0), 2),
                lw=0,
            )
        )


def corner_plot(names: Sequence[str], draws: Array, covariance: Array, truth: Array) -> Drawing:
    """Return a corner plot of draws, with Theorem 1's ellipses and the truth.

    Parameters
    ----------
    draws : ndarray, (N, k)
        ln theta less its estimate, times 100, that is in per cent.
    covariance : ndarray, (k, k)
        Covariance by Theorem 1 and `truth` (k,), in the same measure; NaN where unknown. The axes
        reach as far as the truth, however far it lies.
    """
    spans = corner_spans(draws, covariance, truth)

    def draw(palette: Palette) -> Figure:
        k = len(names)
        figure = NotebookFigure(figsize=(1.35 * k + 0.9, 1.35 * k + 0.9))
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
            label_kwargs={"fontsize": 10},
        )
        grid: Any = np.array(figure.axes).reshape(k, k)
        for i, j in np.ndindex(k, k):
            if j > i:
                continue
            axes = grid[i, j]
            if np.isfinite(truth[j]):
                axes.axvline(float(truth[j]), color=palette.muted, lw=0.7, dashes=(3, 2))
            if i != j:
                if np.isfinite(truth[i]):
                    axes.axhline(float(truth[i]), color=palette.muted, lw=0.7, dashes=(3, 2))
                for radius in _ELLIPSE_RADII:
                    x, y = radius * _ellipse(covariance[np.ix_([j, i], [j, i])])
                    axes.plot(x, y, color=palette.second, lw=1.0)
            axes.set_xlim(spans[j])
            if j < i:
                axes.set_ylim(spans[i])
            axes.tick_params(labelsize=8.5, length=2, labelrotation=0)
            axes.set_xticks(three_ticks(*axes.get_xlim()))
            if j < i:
                axes.set_yticks(three_ticks(*axes.get_ylim()))
            outer = ([axes.xaxis] if i == k - 1 else []) + ([axes.yaxis] if j == 0 < i else [])
            for axis in outer:
                axis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}".replace("-", MINUS)))
            for spine in axes.spines.values():
                spine.set_color(palette.rule)
        return figure

    return draw


def corner_spans(draws: Array, covariance: Array, truth: Array) -> Array:
    """Return the ends (k, 2) of axes that show draws, ellipses and, if there is one, the truth."""
    reach = max(_ELLIPSE_RADII) * np.sqrt(np.diagonal(covariance))
    low = np.minimum(draws.min(axis=0), np.fmin(-reach, truth))
    high = np.maximum(draws.max(axis=0), np.fmax(reach, truth))
    margin = 0.04 * (high - low)
    return np.stack([low - margin, high + margin], axis=1)


def three_ticks(low: float, high: float) -> list[float]:
    """Return zero and a round number on either side, far enough from the ends for its words.

    Where zero lies near one end, the round number is on the other side only.
    """
    short, long = sorted((-low, high))
    if short <= 0:
        return [low, high]
    lopsided = long > 2 * short
    reach = 0.75 * (long if lopsided else short)
    decade = 10.0 ** np.floor(np.log10(reach))
    step = float(decade * max(round_ for round_ in (1, 2, 5) if round_ * decade <= reach))
    if lopsided:
        return [0.0, step] if high > -low else [-step, 0.0]
    return [-step, 0.0, step]


def _ellipse(covariance: Array) -> Array:
    """Return the outline of one standard deviation, (2, N)."""
    angle = np.linspace(0, 2 * np.pi, 73)
    return np.asarray(np.linalg.cholesky(covariance) @ np.stack([np.cos(angle), np.sin(angle)]))


def parameter_groups(names: Sequence[str]) -> dict[str, list[int]]:
    """Return the indices of springs, dampers and others, each under its name for people."""
    groups: dict[str, list[int]] = {}
    for i, name in enumerate(names):
        kind = name.rsplit(".", 1)[-1]
        groups.setdefault(
            {"stiffness": "Springs", "damping": "Dampers"}.get(kind, "Others"), []
        ).append(i)
    return groups
