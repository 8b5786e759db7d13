"""Figures of standardised residuals: where they are large, and whether noise has their law."""

from collections.abc import Sequence

import numpy as np
from matplotlib.ticker import MaxNLocator

from reports.figures.panels import DASHES, Area, Axis, Curve, Panel, Panels, Rule, bars, cells
from robotmodels.common.arrays import Array, IntArray

_COLUMNS = 40  # of a map, at most
_SHADES = np.array([0.5, 0.7, 0.85, 1.18, 1.4, 2.0, 3.0])  # mean squares between shades
_OPACITY = (0.9, 0.55, 0.25, 0.0, 0.25, 0.5, 0.75, 1.0)
_QUANTILES = 60
_BOUND = 3.29  # of an autocorrelation of white noise, in a thousandth of all cases


def residual_map(
    standardised: Array,
    omega: Array,
    held_out: Array | None = None,
    visits: Sequence[str] = (),
) -> Panels:
    """Return mean squared residuals by position and line, one where noise explains them.

    Parameters
    ----------
    standardised : ndarray, (parts, Q, F, k)
        As of `standardised_residuals`; neighbouring lines are taken together where there are many.
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    held_out : ndarray, (Q', F), optional
        Mean squared errors of positions that were not fitted, in rows below the others.
    visits : sequence of str, (Q,), optional
        Names of rows that are visits, of which a position can have several.
    """
    edges = np.unique(np.linspace(0, len(omega), min(len(omega), _COLUMNS) + 1).astype(int))
    fitted = _mean_squares(standardised, edges)
    squares = fitted if held_out is None else _with_rows(fitted, held_out, edges)
    hertz = omega / (2 * np.pi)
    between = np.sqrt(hertz[1:] * hertz[:-1])
    ends = np.concatenate([hertz[:1], between, hertz[-1:]])[edges]

    shades, rows = np.digitize(squares, _SHADES), len(squares)
    edges_y = np.arange(rows + 1.0) + 0.5
    areas = [
        Area(*cells(ends, edges_y, shades == k), "accent" if k < 4 else "second", opacity)
        for k, opacity in enumerate(_OPACITY)
        if opacity and (shades == k).any()
    ]
    divided = [Rule(len(fitted) + 1.0, "muted")] if rows > len(fitted) else []
    x = Axis("frequency [Hz]", (ends[0], ends[-1]), log=True, grid=False, count=8)
    names = _names(len(fitted), rows, visits)
    y = Axis("position", (rows + 0.5, 0.5), names=names, grid=False)
    return Panels((7.0, 0.9 + 0.17 * rows), [[Panel([*areas, *divided], x, y)]])


def _with_rows(fitted: Array, held_out: Array, edges: IntArray) -> Array:
    """Return cells (Q, C), an empty row, and the means between edges of `held_out` (Q', F)."""
    below = np.add.reduceat(held_out, edges[:-1], axis=1) / np.diff(edges)
    return np.concatenate([fitted, np.ones((1, fitted.shape[1])), below])


def _names(fitted: int, rows: int, visits: Sequence[str]) -> dict[float, str]:
    """Return the words of rows: fitted positions or visits, and where others are held out."""
    every = np.asarray(MaxNLocator(12, integer=True).tick_values(1, fitted))
    shown = [int(tick) for tick in every if 1 <= tick <= fitted]
    names = {float(row): visits[row - 1] if visits else str(row) for row in shown}
    return names | ({(fitted + 2 + rows) / 2: "held out"} if rows > fitted else {})


def _mean_squares(standardised: Array, edges: IntArray) -> Array:
    """Return means over the lines between edges, (Q, C); one where no element is used."""
    used = np.isfinite(standardised)
    squares = np.square(np.where(used, standardised, 0.0)).sum(axis=(0, 3))
    number, total = (
        np.add.reduceat(values, edges[:-1], axis=1) for values in (used.sum(axis=(0, 3)), squares)
    )
    return np.asarray(np.where(number > 0, total / np.maximum(number, 1), 1.0))


def residual_laws(standardised: Array, autocorrelation: Array) -> Panels:
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

    reach = max(4.0, float(np.abs(quantile).max()))
    line = np.array([-5.0, 5.0])
    quantiles = Panel(
        [
            Curve(line, line, "muted", 0.8, dashes=DASHES),
            Curve(normal, quantile, "accent", 0.0, 3.0),
        ],
        Axis("standard normal quantile", (-4.6, 4.6), grid=False),
        Axis("residual [std]", (-1.05 * reach, 1.05 * reach), grid=False),
    )
    number = np.arange(1.0, len(autocorrelation) + 1)
    ends = (0.5, len(number) + 0.5)
    highest = max(0.1, 1.2 * float(np.abs(autocorrelation).max()))
    lags = Panel(
        [
            Area(np.repeat(ends, 2), bound * np.array([-1.0, 1.0, 1.0, -1.0]), "muted", 0.25),
            Rule(0.0, "muted"),
            Curve(*bars(number, np.zeros(len(number)), autocorrelation), "accent", 1.6),
            Curve(number, autocorrelation, "accent", 0.0, 4.0),
        ],
        Axis("lines apart", ends, integer=True, grid=False),
        Axis("autocorrelation", (-highest, highest), grid=False),
    )
    return Panels((7.0, 2.9), [[quantiles, lags]])


def _quantiles(standardised: Array) -> tuple[Array, Array]:
    """Return quantiles of the normal distribution and of the residuals, evenly along the former."""
    from scipy.special import ndtri

    values = np.sort(standardised[np.isfinite(standardised)])
    normal = ndtri((np.arange(len(values)) + 0.5) / len(values))
    at = np.unique(np.searchsorted(normal, np.linspace(-4.5, 4.5, _QUANTILES)))
    at = at[at < len(values)]
    return normal[at], values[at]
