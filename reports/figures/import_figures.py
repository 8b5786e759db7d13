"""What was understood of a log: a panel of curves for each role."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from reports.figures.svg import Palette
from robotmodels.common.arrays import Array

_COLUMNS = 2


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
        for axes, (role, values) in zip(panels.flat, signals.items(), strict=False):
            for j, column in enumerate(values.T):
                if np.isfinite(column).any():
                    style = "-" if j < len(colours) else "--"
                    colour = colours[j % len(colours)]
                    axes.plot(time, column, style, color=colour, lw=0.8, label=joints[j])
            axes.set_title(f"{role.replace('_', ' ')} [{units.get(role, '')}]")
            axes.grid(True)
        panels[0, 0].legend(fontsize=6, ncols=2)
        drawing.supxlabel("time [s]", color=palette.muted, size=9)
        return drawing

    return draw
