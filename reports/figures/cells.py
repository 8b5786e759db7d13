"""Cells of a plane, shaded: one path for each shade, which is short."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from robotmodels.common.arrays import Array, IntArray

_CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1), (0, 0))


def shade_cells(
    axes: Axes, x: Array, y: Array, shades: IntArray, styles: list[tuple[str, float]]
) -> None:
    """Draw the cells between edges x (C + 1,) and y (R + 1,), each in the style of its shade.

    Parameters
    ----------
    shades : ndarray of int, (R, C)
        Index of the style; negative ones are left out.
    styles : list of tuple
        Colour and opacity.
    """
    for shade, (colour, opacity) in enumerate(styles):
        cells = np.argwhere(shades == shade)
        if opacity and len(cells):
            vertices = np.array([[(x[j + a], y[i + b]) for a, b in _CORNERS] for i, j in cells])
            codes = np.tile([Path.MOVETO, *[Path.LINETO] * 3, Path.CLOSEPOLY], len(cells))
            area = Path(vertices.reshape(-1, 2), codes)
            axes.add_patch(PathPatch(area, color=colour, alpha=opacity, lw=0))
