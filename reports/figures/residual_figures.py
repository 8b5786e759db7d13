"""Figures of standardised residuals: where they are large, and whether noise has their law."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from reports.figures.cells import shade_cells
from reports.figures.notebook_figure import NotebookFigure
from reports.figures.study_figures import Drawing, plain_logarithm
from reports.figures.svg import Palette
from robotmodels.common.arrays import Array, IntArray

_COLUMNS = 40  # of a map, at most
_SHADES = np.array([0.5, 0.7, 0.85, 1.18, 1.4, 2.0, 3.0])  # mean squares between shades
_OPACITY = (0.9, 0.55, 0.25, 0.0, 0.25, 0.5, 0.75, 1.0)
_QUANTILES = 60
_BOUND = 3.29  # of an autocorrelation of white noise, in a thousandth of all cases


def residual_map(standardised: Array, omega: Array, held_out: Array | None = None) -> Drawing:
    """Return mean squared residuals by position and line, one where noise explains them.

    Parameters
    ----------
    standardised : ndarray, (parts, Q, F, k)
        As of `standardised_residuals`; neighbouring lines are taken together where there are many.
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    held_out : ndarray, (Q', F), optional
        Mean squared errors of positions that were not fitted, in rows below the others.
    """
    edges = np.unique(np.linspace(0, len(omega), min(len(omega), _COLUMNS) + 1).astype(int))
    fitted = _mean_squares(standardised, edges)
    cells = fitted if held_out is None else _with_rows(fitted, held_out, edges)
    hertz = omega / (2 * np.pi)
    between = np.sqrt(hertz[1:] * hertz[:-1])
    ends = np.concatenate([hertz[:1], between, hertz[-1:]])[edges]

    def draw(palette: Palette) -> Figure:
        rows = len(cells)
        figure = NotebookFigure(figsize=(7.0, 0.9 + 0.17 * rows), layout="constrained")
        axes = figure.add_subplot()
        colours = [palette.accent] * 4 + [palette.second] * 4
        styles = list(zip(colours, _OPACITY, strict=True))
        shade_cells(axes, ends, np.arange(rows + 1.0) + 0.5, np.digitize(cells, _SHADES), styles)
        axes.set(xlim=(ends[0], ends[-1]), ylim=(rows + 0.5, 0.5), xscale="log")
        axes.set(xlabel="frequency [Hz]", ylabel="position")
        plain_logarithm(axes.xaxis)
        _number_rows(axes, len(fitted), rows, palette)
        return figure

    return draw


def _with_rows(fitted: Array, held_out: Array, edges: IntArray) -> Array:
    """Return cells (Q, C), an empty row, and the means between edges of `held_out` (Q', F)."""
    below = np.add.reduceat(held_out, edges[:-1], axis=1) / np.diff(edges)
    return np.concatenate([fitted, np.ones((1, fitted.shape[1])), below])


def _number_rows(axes: Axes, fitted: int, rows: int, palette: Palette) -> None:
    """Label the rows of fitted positions, and divide them from those held out."""
    every = np.asarray(MaxNLocator(12, integer=True).tick_values(1, fitted))
    ticks = [float(tick) for tick in every if 1 <= tick <= fitted]
    labels = [f"{tick:.0f}" for tick in ticks]
    if rows > fitted:
        axes.axhline(fitted + 1, color=palette.muted, lw=0.8)
        ticks, labels = [*ticks, (fitted + 2 + rows) / 2], [*labels, "held out"]
    axes.set_yticks(ticks, labels)


def _mean_squares(standardised: Array, edges: IntArray) -> Array:
    """Return means over the lines between edges, (Q, C); one where no element is used."""
    used = np.isfinite(standardised)
    squares = np.square(np.where(used, standardised, 0.0)).sum(axis=(0, 3))
    number, total = (
        np.add.reduceat(values, edges[:-1], axis=1) for values in (used.sum(axis=(0, 3)), squares)
    )
    return np.asarray(np.where(number > 0, total / np.maximum(number, 1), 1.0))


def residual_laws(standardised: Array, autocorrelation: Array) -> Drawing:
    """Return quantiles of the residuals against those of noise, and their autocorrelation.

    Parameters
    ----------
    standardised : ndarray, (parts, Q, F, k)
        As of `standardised_residuals`.
    autocorrelation : ndarray, (L,)
        Over 1 to L neighbouring lines.
    """
    normal, quantile = _quantiles(standardised)
    bound = _BOUND / np.sqrt(np.isfinite(standardised).sum())

    def draw(palette: Palette) -> Figure:
        figure = NotebookFigure(figsize=(7.0, 2.9), layout="constrained")
        quantiles, lags = figure.subplots(1, 2)
        reach = max(4.0, float(np.abs(quantile).max()))
        quantiles.plot([-5, 5], [-5, 5], color=palette.muted, lw=0.8, dashes=(4, 3))
        quantiles.plot(normal, quantile, "o", color=palette.accent, ms=3)
        quantiles.set(xlim=(-4.6, 4.6), ylim=(-1.05 * reach, 1.05 * reach))
        quantiles.set(xlabel="standard normal quantile", ylabel="residual [std]")
        number = np.arange(1, len(autocorrelation) + 1)
        lags.axhspan(-bound, bound, color=palette.muted, alpha=0.25, lw=0)
        lags.axhline(0, color=palette.muted, lw=0.8)
        lags.vlines(number, 0, autocorrelation, color=palette.accent, lw=1.6)
        lags.plot(number, autocorrelation, "o", color=palette.accent, ms=4)
        highest = max(0.1, 1.2 * float(np.abs(autocorrelation).max()))
        lags.set(ylim=(-highest, highest), xticks=number)
        lags.set(xlabel="lines apart", ylabel="autocorrelation")
        return figure

    return draw


def _quantiles(standardised: Array) -> tuple[Array, Array]:
    """Return quantiles of the normal law and of the residuals, evenly along the former."""
    from scipy.special import ndtri

    values = np.sort(standardised[np.isfinite(standardised)])
    normal = ndtri((np.arange(len(values)) + 0.5) / len(values))
    at = np.unique(np.searchsorted(normal, np.linspace(-4.5, 4.5, _QUANTILES)))
    at = at[at < len(values)]
    return normal[at], values[at]
