"""Figures 2 to 5 of [HBH] drawn anew: direct and cross responses with what is read off them."""

from collections.abc import Callable, Sequence
from functools import partial
from itertools import combinations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from estimators.chains.modal_model import modal_response
from oed.chain_study.run_chain_study import ChainStudyResults, controlled_response
from reports.figures.frf_figures import decibels
from reports.figures.palette import Palette
from reports.figures.ticks import plain_logarithm, plain_ticks
from reports.text import fixed
from robotmodels.common.arrays import Array

_POINTS = 1200  # of a model's curve
_LOWEST = 0.15  # of the lowest anti-resonance: where the panels begin


def direct_panels(results: ChainStudyResults, chains: Sequence[int]) -> Callable[[Palette], Figure]:
    """Return each motor's acceleration per its torque, with poles, zeros, A_L and A_H."""
    modes, responses = results.measured.identification.modes, results.responses
    omega = modes.data.omega
    dense = np.geomspace(omega[0], omega[-1], _POINTS)
    model = np.abs(modal_response(modes.x, modes.layout, dense))

    def draw(palette: Palette) -> Figure:
        figure, panels = _panels(results, len(chains))
        for axes, i in zip(panels, chains, strict=True):
            held_lines = responses.omega < modes.zeros.min()
            axes.plot(
                responses.omega[held_lines],
                decibels(np.abs(responses.direct[held_lines, i])),
                "--",
                color=palette.ink,
                lw=0.9,
            )
            measured = decibels(np.abs(modes.data.response[:, i, i]))
            axes.plot(omega, measured, ".", color=palette.accent, ms=3, mew=0)
            axes.plot(dense, decibels(model[:, i, i]), color=palette.second, lw=0.7)
            _circle(axes, _first(results), responses.low[i], f"A{i + 1}L", palette)
            _circle(axes, omega[-1], responses.high[i], f"A{i + 1}H", palette)
            _marks(axes, modes.omega, modes.zeros[i], palette)
            axes.set_title(_title(i, i))
        return figure

    return draw


def cross_panels(
    results: ChainStudyResults, pairs: Sequence[tuple[int, int]]
) -> Callable[[Palette], Figure]:
    """Return accelerations of motor i per torque of motor j, the other chains locked, with A_C."""
    responses, count = results.responses, len(results.truth.masses)
    every = list(combinations(range(count), 2))
    dense = np.geomspace(responses.omega[0], responses.omega[-1], _POINTS)

    def draw(palette: Palette) -> Figure:
        figure, panels = _panels(results, len(pairs))
        for axes, pair in zip(panels, pairs, strict=True):
            k = every.index(pair)
            measured = decibels(np.abs(responses.cross[:, k]))
            axes.plot(responses.omega, measured, ".", color=palette.accent, ms=3, mew=0)
            model = controlled_response(results, dense, pair)[:, pair[0], pair[1]]
            axes.plot(dense, decibels(np.abs(model)), color=palette.second, lw=0.7)
            _circle(axes, _first(results), abs(responses.cross_low[k]), "AC", palette)
            axes.set_title(_title(*pair))
        return figure

    return draw


def _panels(results: ChainStudyResults, count: int) -> tuple[Figure, list[Axes]]:
    """Return a figure of so many panels, one below the other."""
    figure = Figure(figsize=(7.2, 0.5 + 2.7 * count), layout="constrained")
    panels = figure.subplots(count, 1, sharex=True, squeeze=False)
    for axes in panels.flat:
        axes.grid(True)
        axes.set_axisbelow(True)
        axes.set_xscale("log")
        axes.set_xlim(0.9 * _first(results), 1.12 * results.responses.omega[-1])
        plain_logarithm(axes.xaxis, subs=(1, 2, 3, 5))
        axes.yaxis.set_major_locator(MaxNLocator(6))
        plain_ticks(axes.yaxis, partial(fixed, decimals=0))
        axes.set_ylabel("dB of 1/kg", size=9)
    panels[-1, 0].set_xlabel("angular frequency [rad/s]", size=9)
    return figure, list(panels.flat)


def _first(results: ChainStudyResults) -> float:
    """Return the frequency at which the panels begin [rad/s]."""
    lowest = float(results.measured.identification.modes.zeros.min())
    return max(_LOWEST * lowest, float(results.responses.omega[0]))


def _circle(axes: Axes, omega: float, gain: float, name: str, palette: Palette) -> None:
    """Circle a gain, as the paper does, with its name above."""
    level = float(decibels(np.array([gain]))[0])
    axes.plot([omega], [level], "o", color=palette.ink, ms=9, mfc="none", mew=1.1, clip_on=False)
    offset = (10, 7) if omega < axes.get_xlim()[1] / 2 else (-10, 7)
    axes.annotate(
        name,
        (omega, level),
        xytext=offset,
        textcoords="offset points",
        ha="left" if offset[0] > 0 else "right",
        size=8,
        color=palette.ink,
    )


def _marks(axes: Axes, poles: Array, zeros: Array, palette: Palette) -> None:
    """Mark poles by crosses and zeros by circles along the lower edge."""
    low, high = axes.get_ylim()
    low -= 0.1 * (high - low)
    for values, marker, colour, height in (
        (poles, "x", palette.ink, 0.10),
        (zeros, "o", palette.accent, 0.04),
    ):
        level = np.full(len(values), low + height * (high - low))
        axes.plot(values, level, marker, color=colour, ms=4, mew=0.9, mfc="none", ls="")
    axes.set_ylim(low, high)


def _title(i: int, j: int) -> str:
    return f"from torque of motor {j + 1} to acceleration of motor {i + 1}"
