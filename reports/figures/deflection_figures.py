"""Deflections of gears over time, measured and fitted."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from estimators.deflection.axis_deflection import DeflectionHistory
from reports.figures.palette import Drawing, Palette
from robotmodels.common.arrays import Array

_MOST = 1500  # points of a curve


def deflections(histories: Sequence[DeflectionHistory]) -> Drawing:
    """Return link less motor angle of a gear, a row for each record, beside what was fitted."""

    def draw(palette: Palette) -> Figure:
        figure = Figure(figsize=(7.0, 0.6 + 1.8 * len(histories)), layout="constrained")
        for axes, one in zip(
            figure.subplots(len(histories), squeeze=False)[:, 0], histories, strict=True
        ):
            rows = np.unique(np.linspace(0, len(one.time) - 1, _MOST).astype(int))
            time = one.time[rows] - one.time[0]
            axes.grid(True)
            axes.plot(time, _shown(one.measured, one, rows), color=palette.accent, lw=0.9)
            axes.plot(time, _shown(one.fitted, one, rows), color=palette.second, lw=1.2)
            axes.set(xlim=(0, time[-1]), ylabel="deflection [mdeg]")
        axes.set_xlabel("time [s]")
        return figure

    return draw


def _shown(angle: Array, one: DeflectionHistory, rows: Array) -> Array:
    """Return angles [mdeg] with gaps where samples were left out."""
    return np.asarray(np.where(one.used, 1e3 * np.degrees(angle), np.nan)[rows])
