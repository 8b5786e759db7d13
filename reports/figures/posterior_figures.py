"""Figures of chains: traces and ranks of the least certain parameters."""

from collections.abc import Sequence
from itertools import cycle

import numpy as np

from reports.figures.panels import DASHES, SERIES, Axis, Curve, Panel, Panels, Rule
from robotmodels.common.arrays import Array

_POINTS = 40  # of a trace, at most
_BINS = 12  # of ranks
_LABELS = ("part of the chain", "rank among all draws")


def traces(names: Sequence[str], chains: Array) -> Panels:
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

    rows = []
    for i, name in enumerate(names):
        last = i == len(names) - 1
        walks = [
            Curve(along, mean[:, i], colour, 0.9)
            for mean, colour in zip(means, cycle(SERIES), strict=False)
        ]
        steps = [
            Curve(*_outline(share[:, i]), colour, 0.9)
            for share, colour in zip(shares, cycle(SERIES), strict=False)
        ]
        x = [
            Axis(words if last else "", (0.0, 1.0), numbered=last, grid=False) for words in _LABELS
        ]
        y = Axis(limits=(0.5, 1.5), count=3, grid=False)
        even = Rule(1.0, "muted", 0.8, DASHES)
        rows.append(
            [Panel(walks, x[0], Axis(count=4, grid=False), name), Panel([even, *steps], x[1], y)]
        )
    size = (7.6, 0.6 + 0.85 * len(names))
    return Panels(size, rows, widths=(2, 1), up="mean deviation [%]")


def _outline(shares: Array) -> tuple[Array, Array]:
    """Return a histogram of shares over its mean as a line of steps."""
    counts, ends = np.histogram(shares, _BINS, (0, 1))
    return np.repeat(ends, 2)[1:-1], np.repeat(counts / counts.mean(), 2)


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
