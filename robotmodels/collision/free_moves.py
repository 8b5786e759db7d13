"""Which straight moves in joint space touch nothing on the way, and whether a robot may swing."""

from itertools import product

import numpy as np

from robotmodels.collision.surroundings import Pair, Surroundings
from robotmodels.common.arrays import Array, BoolArray

_STEP = 0.05
"""Largest step of a joint between two positions that are compared [rad; m]."""


def contacts(surroundings: Surroundings | None, start: Array, goals: Array) -> list[Pair | None]:
    """Return what touches on straight moves from `start` (n,) to each of `goals` (Q, n).

    Positions are compared at steps of 0.05 rad (m) of the joint that moves farthest; what lies
    between is left to the margin of the surroundings. None where nothing touches, as everywhere
    without surroundings.
    """
    goals = np.atleast_2d(goals)
    if surroundings is None:
        return [None] * len(goals)
    farthest = np.abs(goals - start).max(axis=1)
    counts = np.maximum(np.ceil(farthest / _STEP).astype(int), 1)
    move = np.repeat(np.arange(len(goals)), counts)
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])
    share = (np.arange(len(move)) - first[move] + 1) / counts[move]
    path = start + share[:, None] * (goals[move] - start)
    touching = np.logical_or.reduceat(surroundings.touching(path), first, axis=0)
    return [surroundings.pairs[int(row.argmax())] if row.any() else None for row in touching]


def free_moves(surroundings: Surroundings | None, start: Array, goals: Array) -> BoolArray:
    """Return whether nothing touches on each of these moves, (Q,), see `contacts`."""
    return np.array([pair is None for pair in contacts(surroundings, start, goals)])


def swing_contact(
    surroundings: Surroundings | None, position: Array, low: Array, high: Array
) -> Pair | None:
    """Return what touches while motors swing around a position; None where nothing does.

    The ways to all corners of the box are compared.

    Parameters
    ----------
    position, low, high : ndarray, (n,), rad
        The position, and the lowest and highest deviations from it.
    """
    if surroundings is None:
        return None
    corners = np.array(list(product(*zip(low, high, strict=True))))
    inside = np.clip(position + corners, *surroundings.robot.position_limits.T)
    pairs = contacts(surroundings, position, inside)
    return next((pair for pair in pairs if pair is not None), None)
