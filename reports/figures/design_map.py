"""The design map: what candidates would add, and the plan, over two joint coordinates."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from reports.figures.cells import shade_cells
from reports.figures.notebook_figure import NotebookFigure
from reports.figures.study_figures import Drawing
from reports.figures.svg import Palette
from robotmodels.common.arrays import Array, IntArray

_CELLS = 24  # along an axis, at most
_SHADES = 8


def design_map(
    positions: Array, sensitivity: Array, weights: Array | IntArray, names: Sequence[str]
) -> Drawing:
    """Return the largest sensitivity in each cell of two coordinates, and the positions used.

    Shades go from the least of the cells to the largest.

    Parameters
    ----------
    positions : ndarray, (Q, 2)
        Two coordinates of the candidates, as they are to be shown.
    sensitivity : ndarray, (Q,)
        1 at the optimum; none exceeds it there.
    weights : ndarray, (Q,)
        Weights or experiments; positive ones are dots, whose areas grow with them.
    names : sequence of str, (2,)
        Names of the coordinates with their units.
    """
    edges = [_edges(positions[:, k]) for k in (0, 1)]
    cells = tuple(np.searchsorted(edges[k], positions[:, k]) - 1 for k in (1, 0))
    highest = np.full([len(edges[1]) - 1, len(edges[0]) - 1], -1.0)
    np.maximum.at(highest, cells, sensitivity / sensitivity.max())
    lowest = min(float(highest[highest >= 0].min()), 0.99)
    shares = np.floor(_SHADES * (highest - lowest) / (1 - lowest))
    shades = np.where(highest < 0, -1, np.minimum(shares, _SHADES - 1)).astype(np.int64)
    used = np.flatnonzero(weights > 0)

    def draw(palette: Palette) -> Figure:
        figure = NotebookFigure(figsize=(5.4, 3.8), layout="constrained")
        axes = figure.add_subplot()
        styles = [(palette.accent, 0.06 + 0.9 * k / _SHADES) for k in range(_SHADES)]
        shade_cells(axes, edges[0], edges[1], shades, styles)
        area = 120 * weights[used] / weights.max()
        x, y = positions[used].T
        axes.scatter(x, y, area, color=palette.second, edgecolor=palette.ink, lw=0.6)
        axes.set(xlim=edges[0][[0, -1]], ylim=edges[1][[0, -1]], xlabel=names[0], ylabel=names[1])
        return figure

    return draw


def _edges(values: Array) -> Array:
    """Return edges around each value, or even ones where there are many."""
    distinct = np.unique(values.round(9))
    if len(distinct) > _CELLS or len(distinct) == 1:
        margin = 1e-6 + 1e-6 * np.ptp(values)
        return np.linspace(values.min() - margin, values.max() + margin, _CELLS + 1)
    between = (distinct[1:] + distinct[:-1]) / 2
    ends = 2 * distinct[[0, -1]] - between[[0, -1]]
    return np.concatenate([ends[:1], between, ends[1:]])
