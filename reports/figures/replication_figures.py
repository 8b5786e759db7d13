"""Figures 3 to 8 of [WM] from a study's models; each returns its drawing."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from oed.replication.six_estimators import (
    BEST_COUNT,
    REASONABLE_COST,
    REASONABLE_RANGE,
    REFERENCE,
    Evaluation,
)
from reports.figures.palette import Palette
from reports.figures.ticks import plain_logarithm, plain_ticks
from reports.text import fixed, significant
from robotmodels.common.arrays import Array, ComplexArray

Drawing = Callable[[Palette], Figure]

_LOWEST, _HIGHEST = 1e-2, 1e2
"""What figures of parameters show; beyond, a line runs along the edge."""
_MOST_COST = 1e3


def costs(evaluation: Evaluation, normalised: Array, label: str, limit: bool = False) -> Drawing:
    """Return the sorted costs of each estimator's models: figure 3, or figure 4.

    Parameters
    ----------
    normalised : ndarray, (E, N)
        Costs.
    label : str
        Label of the axis.
    limit : bool
        Whether to draw the cost below which a model is reasonable.
    """

    def draw(palette: Palette) -> Figure:
        figure, (axes, key) = _with_key(7.2, 3.4)
        number = np.arange(1, normalised.shape[1] + 1)
        top = 1.0
        for name, values in zip(evaluation.estimators, normalised, strict=True):
            ordered = np.sort(values)
            shown = np.where(np.isfinite(ordered), np.minimum(ordered, _MOST_COST), np.nan)
            top = max(top, float(np.nanmax(shown)))
            axes.plot(number, shown, label=name, **_style(name, palette))
        if limit:
            axes.axhline(REASONABLE_COST, color=palette.muted, lw=0.8, dashes=(1, 2))
        axes.set(yscale="log", xlim=(1, max(len(number), 2)), ylim=(0.9, 1.1 * top))
        axes.set_xlabel("optimisation, sorted by cost")
        axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))
        axes.set_ylabel(label)
        plain_logarithm(axes.yaxis, partial(significant, digits=2))
        _key(key, axes)
        return figure

    return draw


def parameters(
    evaluation: Evaluation, indices: Sequence[int], names: Sequence[str], rows: Sequence[str]
) -> Drawing:
    """Return parameters over those of the best model, a panel per estimator: figures 5, 6 and 7.

    Parameters
    ----------
    indices : sequence of int
        Indices of the parameters.
    names : sequence of str
        Names of the estimators.
    rows : sequence of str
        Labels of the parameters.
    """

    def draw(palette: Palette) -> Figure:
        columns = min(3, len(names))
        lines = -(-len(names) // columns)
        figure = Figure(figsize=(7.2, 1.5 + 1.55 * lines), layout="constrained")
        panels = np.atleast_1d(figure.subplots(lines, columns, sharex=True, sharey=True)).ravel()
        for axes, name in zip(panels, names, strict=True):
            _parameter_panel(axes, evaluation, evaluation.of(name), indices, rows, palette)
            axes.set_title(name, loc="left")
        figure.supxlabel("optimisation, sorted by the cost with user-defined weights", fontsize=9)
        figure.legend(
            *panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=len(indices)
        )
        return figure

    return draw


def best_responses(
    omega: Array, models: ComplexArray, measured: ComplexArray, element: tuple[int, int]
) -> Drawing:
    """Return one FRF element of the best models on top of each other: figure 8.

    Parameters
    ----------
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    models : ndarray of complex, (B, F, m, n)
        The best first.
    measured : ndarray of complex, (F, m, n)
        Measured.
    element : tuple of (int, int)
        Output and input, from 0.
    """
    i, j = element

    def draw(palette: Palette) -> Figure:
        figure, (axes, key) = _with_key(7.2, 3.0)
        hertz = omega / (2 * np.pi)
        level = 20 * np.log10(np.abs(models[:, :, i, j]))
        seen = 20 * np.log10(np.abs(measured[:, i, j]))
        axes.plot(hertz, seen, color=palette.accent, lw=0.9, label="measured")
        axes.plot(hertz, level[0], color=palette.rule, lw=4.5, label=f"best {REFERENCE}")
        for k, line in enumerate(level):
            label = f"best {len(level)}" if k == 0 else None
            axes.plot(hertz, line, color=palette.ink, lw=0.5, label=label)
        axes.set(xlabel="frequency [Hz]", ylabel="magnitude [dB]", xlim=(hertz[0], hertz[-1]))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: fixed(x, 0)))
        axes.yaxis.set_major_locator(MaxNLocator(6))
        _key(key, axes)
        return figure

    return draw


def best_count(evaluation: Evaluation) -> int:
    """Return how many models figure 8 and Table 1 look at."""
    return int(min(BEST_COUNT, evaluation.values.shape[1]))


def _parameter_panel(
    axes: Axes,
    evaluation: Evaluation,
    row: int,
    indices: Sequence[int],
    labels: Sequence[str],
    palette: Palette,
) -> None:
    number = np.arange(1, evaluation.values.shape[1] + 1)
    axes.grid(True)
    axes.set_axisbelow(True)
    for end in REASONABLE_RANGE:
        axes.axhline(end, color=palette.ink, lw=0.8)
    for k, (index, label) in enumerate(zip(indices, labels, strict=True)):
        values = np.clip(evaluation.relative[row, :, index], _LOWEST, _HIGHEST)
        axes.plot(number, values, label=label, **_line(k, palette))
    axes.set(yscale="log", ylim=(_LOWEST, _HIGHEST), xlim=(1, max(len(number), 2)))
    axes.xaxis.set_major_locator(MaxNLocator(4, integer=True))
    plain_ticks(axes.yaxis, partial(significant, digits=1))


def _style(name: str, palette: Palette) -> dict[str, Any]:
    """Return how an estimator's line looks: colour by residual, strokes by what it lacks."""
    colour = palette.second if name.startswith("NLS") else palette.accent
    if name.endswith("1U"):
        return {"color": palette.ink, "lw": 1.2}
    if name.startswith("LLSM"):
        return {"color": colour, "lw": 1.2, "dashes": (6, 2)}
    return {"color": colour, "lw": 1.6} | ({"dashes": (1.5, 1.2)} if name.endswith("O") else {})


def _line(k: int, palette: Palette) -> dict[str, Any]:
    """Return how the k-th of several parameters looks: three colours, solid before dashed."""
    colours = (palette.accent, palette.second, palette.ink)
    style: dict[str, Any] = {"color": colours[k % 3], "lw": 0.9}
    return style | ({"dashes": (3, 1.5)} if (k // 3) % 2 else {})


def _with_key(width: float, height: float) -> tuple[Figure, tuple[Axes, Axes]]:
    """Return a figure with a narrow column on the right for its key."""
    figure = Figure(figsize=(width, height), layout="constrained")
    axes, key = figure.subplots(1, 2, width_ratios=(6, 1))
    key.axis("off")
    axes.grid(True)
    axes.set_axisbelow(True)
    return figure, (axes, key)


def _key(key: Axes, axes: Axes) -> None:
    key.legend(*axes.get_legend_handles_labels(), loc="center left", borderpad=0)
