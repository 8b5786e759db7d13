"""Figures of chains: traces and ranks of the least certain parameters."""

from collections.abc import Sequence
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from reports.figures.notebook_figure import NotebookFigure
from reports.figures.study_figures import Drawing
from reports.figures.svg import Palette
from robotmodels.common.arrays import Array

_POINTS = 40  # of a trace, at most
_BINS = 12  # of ranks


def traces(names: Sequence[str], chains: Array) -> Drawing:
    """Return means of each ensemble along its steps, and ranks of its draws among all.

    Ranks spread evenly where the ensembles agree (Vehtari et al. 2021).

    Parameters
    ----------
    names : sequence of str, (k,)
        Parameters.
    chains : ndarray, (ensembles, snapshots, walkers, k)
        ln theta less its estimate, times 100, that is in per cent.
    """
    along, means = _means(chains)
    shares = _ranks(chains)

    def draw(palette: Palette) -> Figure:
        figure, grid = _panels(len(names))
        colours = (palette.accent, palette.second, palette.ink, palette.muted)
        for i, name in enumerate(names):
            trace, ranks = grid[i]
            ranks.axhline(1, color=palette.muted, lw=0.8, dashes=(4, 3))
            for mean, share, colour in zip(means, shares, cycle(colours), strict=False):
                trace.plot(along, mean[:, i], color=colour, lw=0.9)
                counts, ends = np.histogram(share[:, i], _BINS, (0, 1))
                ranks.stairs(counts / counts.mean(), ends, color=colour, lw=0.9)
            trace.set_title(name, loc="left")
            ranks.set(ylim=(0.5, 1.5), yticks=[0.5, 1, 1.5])
        grid[-1, 0].set(xlim=(0, 1), xlabel="part of the chain")
        grid[-1, 1].set(xlim=(0, 1), xlabel="rank among all draws")
        figure.supylabel("mean deviation from the estimate [%]", color=palette.muted, size=9)
        return figure

    return draw


def _panels(rows: int) -> tuple[Figure, Any]:
    """Return a figure and its axes, (rows, 2); by hand: matplotlib's layouts double its time."""
    height = 0.6 + 0.85 * rows
    margins = {"left": 0.1, "right": 0.99, "wspace": 0.12, "hspace": 0.45}
    margins |= {"bottom": 0.42 / height, "top": 1 - 0.22 / height}
    figure = NotebookFigure(figsize=(7.6, height))
    return figure, figure.subplots(
        rows, 2, squeeze=False, sharex="col", width_ratios=[2, 1], gridspec_kw=margins
    )


def _means(chains: Array) -> tuple[Array, Array]:
    """Return parts of the chain, (S,), and means of each ensemble there, (ensembles, S, k)."""
    snapshots = chains.shape[1]
    edges = np.unique(np.linspace(0, snapshots, min(snapshots, _POINTS) + 1).astype(int))
    sums = np.add.reduceat(chains.mean(axis=2), edges[:-1], axis=1)
    return edges[:-1] / snapshots, sums / np.diff(edges)[:, None]


def _ranks(chains: Array) -> Array:
    """Return the rank of each draw among all, from 0 to 1, (ensembles, draws, k)."""
    draws = chains.reshape(-1, chains.shape[-1])
    order = draws.argsort(axis=0, kind="stable").argsort(axis=0)
    return np.asarray(order.reshape(len(chains), -1, chains.shape[-1]) / max(len(draws) - 1, 1))
