"""Panels drawn by matplotlib, for notebooks and papers."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from reports.figures.notebook_figure import NotebookFigure
from reports.figures.palette import Palette
from reports.figures.panels import Area, Axis, Bubbles, Curve, Mark, Panel, Panels, Rule
from robotmodels.common.arrays import Array


def drawn(panels: Panels, palette: Palette) -> NotebookFigure:
    """Return panels as a figure, in the colours of a palette."""
    figure = NotebookFigure(figsize=panels.size, layout="constrained")
    rows, columns = len(panels.rows), len(panels.rows[0])
    ratios = {"width_ratios": [*panels.widths] or None, "height_ratios": [*panels.heights] or None}
    grid = figure.subplots(rows, columns, squeeze=False, gridspec_kw=ratios)
    for axes, panel in zip(grid.ravel(), (p for row in panels.rows for p in row), strict=True):
        axes.set_visible(panel is not None)
        if panel is not None:
            _draw(axes, panel, palette)
    if panels.legend:
        handles = [
            Line2D([], [], marker="o", ms=4, lw=1.4, color=getattr(palette, colour))
            for _, colour in panels.legend
        ]
        names = [name for name, _ in panels.legend]
        figure.legend(handles, names, loc="outside upper right", ncols=len(names))
    figure.supxlabel(panels.across, color=palette.muted, size=9)
    figure.supylabel(panels.up, color=palette.muted, size=9)
    return figure


def _draw(axes: Axes, panel: Panel, palette: Palette) -> None:
    """Draw one panel."""
    spans = panel.spans()
    for which, axis, span in zip("xy", (panel.x, panel.y), spans, strict=True):
        _scale(axes, which, axis, span)
    for mark in panel.marks:
        _mark(axes, mark, palette)
    axes.set(xlim=spans[0], ylim=spans[1])
    axes.set_axisbelow(True)
    axes.set_title(panel.title, loc="left")
    if panel.square:
        axes.set_aspect("equal")
    for side, axis in (("left", panel.y), ("bottom", panel.x)):
        axes.spines[side].set_visible(axis.line)
    if panel.boxed:
        for spine in axes.spines.values():
            spine.set(visible=True, color=palette.rule)


def _scale(axes: Axes, which: str, axis: Axis, span: tuple[float, float]) -> None:
    """Set scale, ticks, words and grid of an axis."""
    axes.set(**{f"{which}scale": "log" if axis.log else "linear", f"{which}label": axis.label})
    ticks = axis.ticks(span)
    words = list(ticks.values()) if axis.numbered else [""] * len(ticks)
    one = axes.xaxis if which == "x" else axes.yaxis
    one.set_ticks(list(ticks), words, rotation=axis.rotation)
    one.set_ticks([], minor=True)
    axes.grid(axis.grid, axis="x" if which == "x" else "y")
    if not axis.line or axis.names is not None:
        axes.tick_params(axis="x" if which == "x" else "y", length=0)


def _mark(axes: Axes, mark: Mark, palette: Palette) -> None:
    """Draw one mark."""
    style: dict[str, Any] = {"color": getattr(palette, mark.colour)}
    if isinstance(mark, Curve | Rule):
        style |= {"lw": mark.width} | ({"dashes": mark.dashes} if mark.dashes else {})
    match mark:
        case Curve():
            style |= {"ls": "-" if mark.width else "", "marker": "o" if mark.dots else ""}
            axes.plot(mark.x, mark.y, ms=mark.dots, mew=0, alpha=mark.opacity, **style)
        case Rule():
            (axes.axvline if mark.upright else axes.axhline)(mark.at, **style)
        case Area():
            outline = _polygons(mark.x, mark.y)
            axes.add_patch(PathPatch(outline, alpha=mark.opacity, lw=0, **style))
        case Bubbles():
            style |= {"edgecolor": palette.ink, "lw": 0.6, "zorder": 2}
            axes.scatter(mark.x, mark.y, mark.areas, **style)


def _polygons(x: Array, y: Array) -> Path:
    """Return closed outlines of polygons that NaN parts."""
    points = np.column_stack([x, y])
    gaps = np.flatnonzero(np.isnan(points).any(axis=1))
    parts = [p[~np.isnan(p).any(axis=1)] for p in np.split(points, gaps)]
    closed = [Path(np.concatenate([p, p[:1]]), closed=True) for p in parts if len(p)]
    return Path.make_compound_path(*closed)
