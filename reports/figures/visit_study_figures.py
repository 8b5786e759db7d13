"""Figures of a study of visits: accuracy against minutes, and which motor shakes on which line."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from reports.figures.palette import Drawing, Palette
from reports.figures.ticks import plain_logarithm
from reports.text import significant
from robotmodels.common.arrays import Array, ComplexArray


def deviations_over_minutes(times: Array, std: Array, names: Sequence[str], ylabel: str) -> Drawing:
    """Return a line for each parameter, stiffnesses in another colour than all others.

    Parameters
    ----------
    times : ndarray, (T,), s
        Times of the plans.
    std : ndarray, (T, p)
        What is shown of each parameter.
    names : sequence of str
        The p parameters.
    ylabel : str
        What is shown.
    """

    def draw(palette: Palette) -> Figure:
        figure = Figure(figsize=(7.0, 3.0), layout="constrained")
        axes = figure.add_subplot()
        axes.grid(True)
        for name, values in zip(names, std.T, strict=True):
            colour = palette.accent if ".stiffness" in name else palette.second
            axes.plot(times / 60, values, color=colour, lw=1.0, marker="o", ms=3)
        axes.set(xscale="log", yscale="log", xlabel="robot time [min]", ylabel=ylabel)
        plain_logarithm(axes.yaxis, partial(significant, digits=1))
        plain_logarithm(axes.xaxis, partial(significant, digits=1))
        axes.set_xticks(times / 60, [significant(float(t) / 60, 2) for t in times])
        return figure

    return draw


def motors_on_lines(omega: Array, spectrum: ComplexArray, motors: Sequence[str]) -> Drawing:
    """Return the torque of each line, a row for each motor.

    Parameters
    ----------
    omega : ndarray, (F,), rad/s
        Lines.
    spectrum : ndarray of complex, (F, n, n), N^2 m^2
        Phi of a run.
    motors : sequence of str
        Names of the n motors.
    """
    torque = np.sqrt(np.maximum(np.einsum("fii->if", spectrum).real, 0.0))

    def draw(palette: Palette) -> Figure:
        figure = Figure(figsize=(7.0, 0.7 + 0.75 * len(motors)), layout="constrained")
        rows = figure.subplots(len(motors), sharex=True, squeeze=False)[:, 0]
        for axes, values, name in zip(rows, torque, motors, strict=True):
            axes.vlines(omega / (2 * np.pi), 0, values, color=palette.accent, lw=1.0)
            axes.set(ylim=(0, None), xscale="log")
            axes.set_ylabel(name, rotation=0, ha="right", va="center")
            plain_logarithm(axes.xaxis, partial(significant, digits=1))
        rows[-1].set_xlabel("frequency [Hz]")
        return figure

    return draw
