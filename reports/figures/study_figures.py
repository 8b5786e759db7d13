"""Figures of the design, the frequency responses and the fits; each returns its drawing."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from reports.figures.notebook_figure import NotebookFigure
from reports.figures.svg import Palette
from reports.text import fixed, residual_label, significant
from robotmodels.common.arrays import Array, IntArray

Drawing = Callable[[Palette], Figure]

_RANKS = 3000
"""Points of a curve over candidates, of which there may be millions."""


def sensitivity_function(sensitivity: Array, support: IntArray) -> Drawing:
    """Return the candidates' sensitivity in falling order, those of the design marked.

    Parameters
    ----------
    sensitivity : ndarray, (Q,)
        tr(M^-1 H_i)/p; at the optimum none exceeds 1 and used ones reach it.
    """

    def draw(palette: Palette) -> Figure:
        figure, axes = _single(palette, 7.0, 2.6)
        order = np.argsort(-sensitivity, kind="stable")
        rank = np.empty(len(order))
        rank[order] = np.arange(1, len(order) + 1)
        axes.axhline(1.0, color=palette.muted, lw=0.8, dashes=(4, 3))
        shown = np.unique(np.geomspace(1, len(order), _RANKS).astype(int)) - 1
        axes.plot(shown + 1, sensitivity[order[shown]], color=palette.accent, lw=1.4)
        axes.plot(rank[support], sensitivity[support], "o", color=palette.second, ms=4)
        axes.set(xlim=(0.8, len(order) * 1.05), xscale="log", ylim=(0, None))
        axes.set_xlabel("candidate position, best first")
        axes.set_ylabel("sensitivity, 1 at the optimum")
        axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: fixed(x, 0)))
        axes.xaxis.set_minor_formatter(NullFormatter())
        return figure

    return draw


def convergence(gaps: Array, final: float) -> Drawing:
    """Return the certified gap after each round of the solver, and that of the final design.

    Parameters
    ----------
    gaps : ndarray, (R,)
        As of `Design.gaps`; rounds without a positive finite gap have no dot.
    final : float
        Gap of the design, a dashed line where it is positive.
    """

    def draw(palette: Palette) -> Figure:
        figure, axes = _single(palette, 7.0, 2.4)
        shown = np.where(np.isfinite(gaps) & (gaps > 0), gaps, np.nan)
        axes.plot(np.arange(1, len(gaps) + 1), shown, "o-", color=palette.accent, ms=4, lw=1.3)
        if final > 0:
            axes.axhline(final, color=palette.second, lw=1.0, dashes=(4, 3))
        axes.set(yscale="log", xlim=(0.5, len(gaps) + 0.5), xlabel="round", ylabel="certified gap")
        axes.yaxis.set_major_locator(LogLocator(numticks=6))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda gap, _: significant(gap, 1)))
        axes.xaxis.set_major_locator(MaxNLocator(12, integer=True))
        return figure

    return draw


def costs_over_starts(costs: Mapping[str, Sequence[float]], best: Mapping[str, float]) -> Drawing:
    """Return each residual's costs over its best one, a dot per start."""

    def draw(palette: Palette) -> Figure:
        figure, axes = _single(palette, 7.0, 0.9 + 0.42 * len(costs))
        highest = 1.0
        for row, (residual, values) in enumerate(costs.items()):
            ratio = np.asarray(values) / best[residual]
            highest = max(highest, ratio.max())
            shift = np.linspace(-0.18, 0.18, len(ratio)) if len(ratio) > 1 else np.zeros(len(ratio))
            axes.plot(ratio, row + shift, "o", color=palette.accent, ms=5, alpha=0.75, mew=0)
        axes.axvline(1.0, color=palette.muted, lw=0.8, dashes=(4, 3))
        axes.set(ylim=(len(costs) - 0.5, -0.5), xscale="log")
        axes.set_yticks(range(len(costs)), [residual_label(r) for r in costs])
        axes.tick_params(axis="y", length=0)
        axes.set_xlim(0.97, max(1.05 * highest, 1.2))
        if highest < 8:
            axes.xaxis.set_major_locator(MaxNLocator(6))
        elif highest < 200:
            axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: significant(x, 3)))
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_xlabel("cost over the best cost of that estimator")
        axes.spines["left"].set_visible(False)
        return figure

    return draw


def over_expected(ratio: Array, marked: IntArray) -> Drawing:
    """Return a dot per position, (Q,), around one; those `marked` in another colour."""

    def draw(palette: Palette) -> Figure:
        figure, axes = _single(palette, 7.0, 2.2)
        number = np.arange(1, len(ratio) + 1)
        axes.axhline(1.0, color=palette.muted, lw=0.8, dashes=(4, 3))
        axes.vlines(number, 1.0, ratio, color=palette.rule, lw=1.2)
        axes.plot(number, ratio, "o", color=palette.accent, ms=5)
        axes.plot(number[marked], ratio[marked], "o", color=palette.second, ms=5)
        if len(ratio) <= 20:
            axes.set_xticks(number)
        else:
            axes.xaxis.set_major_locator(MaxNLocator(12, integer=True))
        axes.set(xlim=(0.4, len(ratio) + 0.6), xlabel="position", ylabel="over expected")
        return figure

    return draw


def calibration(levels: Array, coverages: Sequence[Array], labels: Sequence[str]) -> Drawing:
    """Return observed against nominal coverage, (L,) each, a curve per label."""

    def draw(palette: Palette) -> Figure:
        figure, axes = _single(palette, 4.2, 3.6)
        axes.plot([0, 100], [0, 100], color=palette.muted, lw=0.8, dashes=(4, 3))
        colours = (palette.accent, palette.second, palette.ink, palette.muted)
        for coverage, label, colour in zip(coverages, labels, colours, strict=False):
            axes.plot(100 * levels, 100 * coverage, color=colour, lw=1.4, label=label)
        axes.set(xlim=(0, 100), ylim=(0, 100), aspect="equal")
        axes.set(xlabel="nominal [%]", ylabel="observed [%]")
        axes.legend(loc="upper left")
        return figure

    return draw


def plain_logarithm(axis: Axis) -> None:
    """Write a logarithmic axis in plain figures, at 1, 2 and 5 of each decade."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _single(palette: Palette, width: float, height: float) -> tuple[Figure, Axes]:
    figure = NotebookFigure(figsize=(width, height), layout="constrained")
    axes = figure.add_subplot()
    axes.grid(True, axis="both")
    axes.set_axisbelow(True)
    return figure, axes
