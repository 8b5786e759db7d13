"""The design map: what candidates would add, and the plan, over two joint coordinates."""

from collections.abc import Sequence

import numpy as np

from reports.figures.panels import Area, Axis, Bubbles, Colour, Mark, Panel, Panels, cells
from robotmodels.common.arrays import Array, IntArray

_CELLS = 24  # along an axis, at most
_SHADES = 8
_ALPHAS = [0.06 + 0.9 * k / _SHADES for k in range(_SHADES)]
_LEGEND: Sequence[tuple[str, Colour]] = [("positions used, area by weight or visits", "second")]
_SCALE = "sensitivity over its maximum [–]"


def design_map(
    positions: Array, sensitivity: Array, weights: Array | IntArray, names: Sequence[str]
) -> Panels:
    """Return the largest sensitivity in each cell of two coordinates, and the positions used.

    Shades go from the smallest of the cells to the largest, as the scale beside the map says.

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
    indices = tuple(np.searchsorted(edges[k], positions[:, k]) - 1 for k in (1, 0))
    highest = np.full([len(edges[1]) - 1, len(edges[0]) - 1], -1.0)
    np.maximum.at(highest, indices, sensitivity / sensitivity.max())
    lowest = min(float(highest[highest >= 0].min()), 0.99)
    shares = np.floor(_SHADES * (highest - lowest) / (1 - lowest))
    shades = np.where(highest < 0, -1, np.minimum(shares, _SHADES - 1)).astype(np.int64)
    used = np.flatnonzero(weights > 0)
    shaded: list[Mark] = [
        Area(*cells(edges[0], edges[1], shades == k), "accent", _ALPHAS[k])
        for k in np.unique(shades[shades >= 0])
    ]
    sizes, (across, up) = 120 * weights[used] / weights.max(), positions[used].T
    marks = [*shaded, Bubbles(across, up, sizes, "second")]
    x, y = (
        Axis(name, (ends[0], ends[-1]), grid=False) for name, ends in zip(names, edges, strict=True)
    )
    ends = np.linspace(lowest, 1.0, _SHADES + 1)
    scale = [
        Area(*cells(np.array([0.0, 1.0]), ends[k : k + 2], np.ones((1, 1), bool)), "accent", alpha)
        for k, alpha in enumerate(_ALPHAS)
    ]
    bar = Panel(scale, Axis(names={}), Axis(_SCALE, (lowest, 1.0), grid=False))
    return Panels((6.2, 3.8), [[Panel(marks, x, y), bar]], widths=(16, 1), legend=_LEGEND)


def _edges(values: Array) -> Array:
    """Return edges around each value, or even ones where there are many."""
    distinct = np.unique(values.round(9))
    if len(distinct) > _CELLS or len(distinct) == 1:
        margin = 1e-6 + 1e-6 * np.ptp(values)
        return np.linspace(values.min() - margin, values.max() + margin, _CELLS + 1)
    between = (distinct[1:] + distinct[:-1]) / 2
    ends = 2 * distinct[[0, -1]] - between[[0, -1]]
    return np.concatenate([ends[:1], between, ends[1:]])
