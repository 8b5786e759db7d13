"""Figures of a campaign: accuracies over minutes, and which motor is shaken on which line."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from reports.figures.palette import Drawing, Palette
from reports.figures.ticks import plain_logarithm
from reports.figures.uncertainty_figures import parameter_groups
from reports.text import significant
from robotmodels.common.arrays import Array

_HEIGHT = 0.8
"""Of the largest amplitude of a motor, in rows."""


def accuracies(names: Sequence[str], minutes: Array, ratios: Array) -> Drawing:
    """Return standard deviations over their targets, (K, p), after so many minutes (K,).

    Parameters without a target are not finite and left out.
    """

    def draw(palette: Palette) -> Figure:
        figure = Figure(figsize=(7.0, 3.0), layout="constrained")
        axes = figure.add_subplot()
        axes.axhline(1.0, color=palette.muted, lw=0.8, dashes=(4, 3))
        asked = np.any(ratios > 0, axis=0).tolist()
        colours = {"Springs": palette.accent, "Dampers": palette.second}
        for kind, group in parameter_groups(names).items():
            colour = colours.get(kind, palette.ink)
            for k, i in enumerate(i for i in group if asked[i]):
                (curve,) = axes.plot(minutes, ratios[:, i], ".-", color=colour, lw=1.0, ms=5)
                curve.set_label("_" if k else kind)
        axes.set(yscale="log", xlim=(0, 1.05 * float(minutes[-1])))
        plain_logarithm(axes.yaxis, partial(significant, digits=1))
        axes.set(xlabel="robot time [min]", ylabel="standard deviation over target")
        axes.grid(True, axis="y")
        figure.legend(loc="outside upper right", ncols=3)
        return figure

    return draw


def torque_spectra(omega: Array, torques: Array, motors: Sequence[str]) -> Drawing:
    """Return magnitudes of the motors' torques on each line, (F, n), a row for each motor."""

    def draw(palette: Palette) -> Figure:
        figure = Figure(figsize=(7.0, 0.8 + 0.36 * len(motors)), layout="constrained")
        axes = figure.add_subplot()
        heights = _HEIGHT * torques / np.maximum(torques.max(axis=0), np.finfo(float).tiny)
        for i, height in enumerate(heights.T):
            row = len(motors) - 1 - i
            axes.axhline(row, color=palette.rule, lw=0.6)
            axes.vlines(omega / (2 * np.pi), row, row + height, color=palette.accent, lw=1.2)
        largest = torques.max(axis=0).tolist()
        labels = [f"{m}  {significant(t, 2)}" for m, t in zip(motors, largest, strict=True)]
        axes.set_yticks(np.arange(len(motors))[::-1] + 0.4, labels)
        axes.tick_params(axis="y", length=0)
        axes.set(ylim=(-0.1, len(motors)), xlabel="frequency [Hz]")
        axes.spines["left"].set_visible(False)
        return figure

    return draw
