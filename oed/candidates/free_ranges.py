"""Ranges of the joints in which few positions collide, before there is a grid of candidates."""

from dataclasses import replace

import numpy as np

from oed.candidates.screening import usable
from oed.candidates.sources import Workcell
from robotmodels.common.arrays import Array, BoolArray, read_only
from robotmodels.elastic.robot import ElasticRobot

_POSITIONS = 256
_SHARE = 0.6
"""Of the positions that a range should leave."""

_PEEL = 0.08
"""Part of the positions that one step takes off, as Friedman and Fisher (1999) advise."""

_FEWEST = 30
"""Positions that a share is judged by."""


def free_ranges(robot: ElasticRobot, ranges: Array, cell: Workcell) -> Array:
    """Return narrower ranges, (n, 2), most positions in which `robot` can take in its `cell`.

    Ranges most of which is free already are returned as they are, and so are those in which hardly
    any position is free. The ends of joints are peeled off one after the other, each time where
    most is gained (Friedman and Fisher, Bump hunting in high-dimensional data, 1999).

    Parameters
    ----------
    robot : ElasticRobot
        The robot.
    ranges : ndarray, (n, 2), rad or m
        Ranges within the joint limits; a range of one value locks its joint.
    cell : Workcell
        What is in the way.

    Raises
    ------
    InvalidInput
        As `Workcell.surroundings`.
    """
    positions = _drawn(ranges, _POSITIONS)
    free = usable(robot, positions, cell.surroundings(robot))
    return read_only(_peeled(positions, free, ranges))


def free_margin(
    robot: ElasticRobot, ranges: Array, cell: Workcell, margins: tuple[float, ...]
) -> float:
    """Return the first of the `margins` that leaves at least half of what none would leave [m].

    Links that lie close together in most positions by construction would otherwise remove those.

    Raises
    ------
    InvalidInput
        As `free_ranges`.
    """
    positions = _drawn(ranges, _POSITIONS // 4)

    def free(margin: float) -> int:
        surroundings = replace(cell, margin=margin).surroundings(robot)
        return int(usable(robot, positions, surroundings).sum())

    most = free(0.0)
    return next((margin for margin in margins if 2 * free(margin) >= most), 0.0)


def _drawn(ranges: Array, number: int) -> Array:
    """Return positions (number, n) in the ranges, the same at every call."""
    low, high = np.asarray(ranges, dtype=float).T
    return np.asarray(np.random.default_rng(0).uniform(low, high, (number, len(low))))


def _peeled(positions: Array, free: BoolArray, ranges: Array) -> Array:
    """Return ranges that hold the share of free positions, from those of all `positions`."""
    narrowed = np.array(ranges, dtype=float)
    inside = np.ones(len(positions), dtype=bool)
    while free[inside].mean() < _SHARE and (1 - _PEEL) * inside.sum() >= _FEWEST:
        peels = [
            (joint, end)
            for joint, (low, high) in enumerate(narrowed)
            for end in (0, 1)
            if low < high
        ]
        cuts = [
            float(np.quantile(positions[inside, joint], (_PEEL, 1 - _PEEL)[end]))
            for joint, end in peels
        ]
        remaining = [
            inside & ((positions[:, joint] <= cut) if end else (positions[:, joint] >= cut))
            for (joint, end), cut in zip(peels, cuts, strict=True)
        ]
        if not remaining or not free[inside].any():
            return np.array(ranges, dtype=float)
        best = int(np.argmax([free[subset].mean() for subset in remaining]))
        narrowed[peels[best]] = cuts[best]
        inside = remaining[best]
    return narrowed
