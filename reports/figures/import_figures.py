"""What was understood of a log: a panel of curves for each role."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure

from reports.figures.palette import Palette
from robotmodels.common.arrays import Array

_COLUMNS = 2
_LEGEND, _HANDLE, _LETTER = 480.0, 42.0, 5.0
"""Width of the legend's rows, of a line with its gaps, and of a letter [pt]."""


def signal_panels(
    time: Array, signals: Mapping[str, Array], units: Mapping[str, str], joints: Sequence[str]
) -> Callable[[Palette], Figure]:
    """Return signals over time, a panel per role, a curve per joint.

    Parameters
    ----------
    time : ndarray, (N,), s
        Times.
    signals : mapping of str to ndarray, (N, n)
        By role.
    units : mapping of str to str
        Units by role.
    joints : sequence of str
        Names of the joints, for the legend.
    """

    def draw(palette: Palette) -> Figure:
        rows = -(-len(signals) // _COLUMNS)
        drawing = Figure(figsize=(7.2, 0.5 + 1.8 * rows), layout="constrained")
        panels = drawing.subplots(rows, _COLUMNS, sharex=True, squeeze=False)
        for axes in panels.flat[len(signals) :]:
            axes.set_axis_off()
        colours = [palette.accent, palette.second, palette.ink, palette.muted]
        lines: dict[str, Artist] = {}
        for axes, (role, values) in zip(panels.flat, signals.items(), strict=False):
            for j, column in enumerate(values.T):
                if np.isfinite(column).any():
                    style = "-" if j < len(colours) else "--"
                    colour = colours[j % len(colours)]
                    (lines[joints[j]],) = axes.plot(time, column, style, color=colour, lw=0.8)
            axes.set_title(f"{role.replace('_', ' ')} [{units.get(role, '')}]")
            axes.grid(True)
        _legend(drawing, lines)
        drawing.supxlabel("time [s]", color=palette.muted, size=9)
        return drawing

    return draw


def _legend(drawing: Figure, lines: Mapping[str, Artist]) -> None:
    """Name the lines above all panels, in rows that are as wide as the figure at most."""
    longest = max(map(len, lines), default=1)
    in_a_row = max(1, int(_LEGEND / (_HANDLE + _LETTER * longest)))
    drawing.legend(lines.values(), lines, loc="outside upper center", ncols=in_a_row)
