"""Figures of identified chains: poles and zeros under the FRF of each motor."""

from collections.abc import Callable
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from estimators.chains.modal_model import modal_response
from estimators.chains.modes import FittedModes
from reports.figures.frf_figures import decibels
from reports.figures.palette import Palette
from reports.figures.ticks import plain_logarithm, plain_ticks
from reports.text import fixed
from robotmodels.common.arrays import Array, ComplexArray

_COLUMNS = 3
_POINTS = 800  # of a model's curve
_FEW = 60  # measured points that larger dots show better


def pole_zero_panels(
    modes: FittedModes, omega: Array, response: ComplexArray
) -> Callable[[Palette], Figure]:
    """Return the diagonal FRF of each chain, measured and of the modes, with poles and zeros.

    Parameters
    ----------
    modes : FittedModes
        Modes that were fitted.
    omega : ndarray, (F,), rad/s
        Angular frequencies, those of omitted lines included.
    response : ndarray of complex, (F, M, M)
        Measured FRFs, those of omitted lines included.
    """
    dense = np.geomspace(omega[0], omega[-1], _POINTS)
    diagonal = np.diagonal(modal_response(modes.x, modes.layout, dense), axis1=1, axis2=2)
    fitted = decibels(np.abs(diagonal))

    def draw(palette: Palette) -> Figure:
        figure, panels = _canvas(response.shape[1])
        for i, axes in enumerate(panels[: response.shape[1]]):
            _curve(axes, omega, response[:, i, i], palette)
            axes.plot(dense / (2 * np.pi), fitted[:, i], color=palette.second, lw=0.7)
            low, high = axes.get_ylim()
            markers = (
                (modes.omega, "x", palette.ink, low + 0.10 * (high - low)),
                (modes.zeros[i], "o", palette.accent, low + 0.04 * (high - low)),
            )
            for where, marker, colour, height in markers:
                x = where / (2 * np.pi)
                (marks,) = axes.plot(
                    x, np.full(len(x), height), marker, color=colour, ms=4, mew=0.9
                )
                marks.set_markerfacecolor("none")
            axes.set_ylim(low, high)
            axes.set_title(f"chain {i + 1}")
        return figure

    return draw


def resonance_panels(
    omega: Array, response: ComplexArray, resonances: Array
) -> Callable[[Palette], Figure]:
    """Return the diagonal FRF of each chain with its resonances, (k,) [rad/s]."""

    def draw(palette: Palette) -> Figure:
        figure, panels = _canvas(response.shape[1])
        for i, axes in enumerate(panels[: response.shape[1]]):
            _curve(axes, omega, response[:, i, i], palette)
            for frequency in resonances / (2 * np.pi):
                axes.axvline(frequency, color=palette.second, lw=0.8, zorder=0)
            axes.set_title(f"chain {i + 1}")
        return figure

    return draw


def _canvas(chains: int) -> tuple[Figure, list[Axes]]:
    columns = min(chains, _COLUMNS)
    rows = -(-chains // columns)
    width = 6.2 if columns == 1 else 0.9 + (3.4 if columns == 2 else 2.9) * columns
    figure = Figure(figsize=(width, 0.5 + 2.3 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, sharex=True, squeeze=False)
    for axes in panels.flat[chains:]:
        axes.set_axis_off()
    figure.supxlabel("frequency [Hz]", size=9)
    figure.supylabel("dB of 1 rad/s² per N m", size=9)
    return figure, list(panels.flat)


def _curve(axes: Axes, omega: Array, response: ComplexArray, palette: Palette) -> None:
    axes.grid(True)
    axes.set_axisbelow(True)
    size = 3 if len(omega) > _FEW else 6
    axes.plot(
        omega / (2 * np.pi), decibels(np.abs(response)), ".", color=palette.accent, ms=size, mew=0
    )
    axes.set_xscale("log")
    plain_logarithm(axes.xaxis)
    axes.yaxis.set_major_locator(MaxNLocator(5))
    plain_ticks(axes.yaxis, partial(fixed, decimals=0))
