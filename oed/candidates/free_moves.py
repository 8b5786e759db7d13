"""Which straight moves in joint space touch nothing on the way."""

import numpy as np

from robotmodels.collision.surroundings import Surroundings
from robotmodels.common.arrays import Array, BoolArray

_STEP = 0.05
"""Largest step of a joint between two positions that are compared [rad; m]."""


def free_moves(surroundings: Surroundings | None, start: Array, goals: Array) -> BoolArray:
    """Return whether the robot can go from `start` (n,) straight to each of `goals` (Q, n).

    Positions are compared at steps of 0.05 rad (m) of the joint that moves farthest; what lies
    between is left to the margin of the surroundings. Without surroundings every move is free.
    """
    goals = np.atleast_2d(goals)
    if surroundings is None:
        return np.ones(len(goals), dtype=bool)
    farthest = np.abs(goals - start).max(axis=1)
    counts = np.maximum(np.ceil(farthest / _STEP).astype(int), 1)
    move = np.repeat(np.arange(len(goals)), counts)
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])
    share = (np.arange(len(move)) - first[move] + 1) / counts[move]
    path = start + share[:, None] * (goals[move] - start)
    touching = surroundings.touching(path).any(axis=1)
    return np.asarray(np.bincount(move, touching, len(goals)) == 0)
