"""Plans made without any information matrix: at random, evenly spread, or a grid by hand."""

import math
from collections.abc import Mapping

import numpy as np

from robotmodels.common.arrays import Array, IntArray, cartesian_grid
from robotmodels.common.errors import InvalidInput, check_word


def random_plan(n_candidates: int, n_experiments: int, rng: np.random.Generator) -> IntArray:
    """Return experiments (Q,) in candidates drawn at random, each once where there are enough.

    Raises
    ------
    InvalidInput
        If there is no candidate or no experiment.
    """
    _check(n_candidates, n_experiments)
    whole, remainder = divmod(n_experiments, n_candidates)
    counts = np.full(n_candidates, whole, dtype=np.int64)
    counts[rng.choice(n_candidates, remainder, replace=False)] += 1
    return counts


def even_plan(positions: Array, n_experiments: int) -> IntArray:
    """Return experiments (Q,) spread evenly over the joints' ranges, as a careful designer would.

    The first is in the candidate nearest the middle of all ranges; each further one in the
    candidate farthest from all before, in units of the ranges (Kennard and Stone 1969). Where
    there are more experiments than candidates, all are used again.

    Parameters
    ----------
    positions : ndarray, (Q, n), rad or m
        Candidates.
    n_experiments : int
        N experiments of the plan.

    Raises
    ------
    InvalidInput
        If there is no candidate or no experiment.
    """
    _check(len(positions), n_experiments)
    scaled = _in_ranges(positions)
    whole, remainder = divmod(n_experiments, len(scaled))
    counts = np.full(len(scaled), whole, dtype=np.int64)
    away = np.full(len(scaled), np.inf)
    farthest = int(np.argmin(_squares(scaled, np.full(scaled.shape[1], 0.5))))
    for _ in range(remainder):
        counts[farthest] += 1
        away = np.minimum(away, _squares(scaled, scaled[farthest]))
        farthest = int(np.argmax(away))
    return counts


def grid_plan(
    positions: Array, n_experiments: int, per_joint: Mapping[str, int], joints: tuple[str, ...]
) -> IntArray:
    """Return experiments (Q,) in the candidates closest to the points of a designer's grid.

    Points lie evenly over the candidates' ranges, ends included; a joint with one point, as every
    joint that is not named, stays in the middle. Experiments beyond the points repeat them in
    order.

    Parameters
    ----------
    positions : ndarray, (Q, n), rad or m
        Candidates.
    n_experiments : int
        N experiments of the plan.
    per_joint : mapping of str to int
        Points of the joints, by name.
    joints : tuple of str
        Names of the n joints.

    Raises
    ------
    InvalidInput
        For an unknown joint, a number of points below 1, or more points than experiments.
    """
    _check(len(positions), n_experiments)
    levels = grid_levels(n_experiments, per_joint, joints)
    points = cartesian_grid(levels)
    number = len(points)
    scaled = _in_ranges(positions)
    candidates = [int(np.argmin(_squares(scaled, point))) for point in points]
    times = np.full(number, n_experiments // number)
    times[: n_experiments % number] += 1
    return np.bincount(candidates, weights=times, minlength=len(scaled)).astype(np.int64)


def grid_levels(
    n_experiments: int | None, per_joint: Mapping[str, int], joints: tuple[str, ...]
) -> list[Array]:
    """Return a grid's points of each joint as parts of its range; arguments of `grid_plan`.

    Raises
    ------
    InvalidInput
        As `grid_plan`; where the number of experiments is None, any number will do.
    """
    for joint, count in per_joint.items():
        check_word("grid:", joint, joints, "is not a driven joint")
        if count < 1:
            raise InvalidInput(f"grid: {count} points of {joint!r}; at least 1 is needed")
    counts = [per_joint.get(joint, 1) for joint in joints]
    number = math.prod(counts)
    if n_experiments is not None and number > n_experiments:
        raise InvalidInput(f"grid: {number} points for {n_experiments} experiments; fewer points")
    return [np.linspace(0, 1, n) if n > 1 else np.array([0.5]) for n in counts]


def _check(n_candidates: int, n_experiments: int) -> None:
    if n_candidates < 1 or n_experiments < 1:
        raise InvalidInput(
            f"plan: {n_experiments} experiments in {n_candidates} candidates; "
            "at least one of each is needed"
        )


def _in_ranges(positions: Array) -> Array:
    """Return positions from 0 to 1 over their ranges, 0.5 where there is none."""
    array = np.asarray(positions, dtype=float)
    low, width = array.min(axis=0), np.ptp(array, axis=0)
    scaled = (array - low) / np.where(width > 0, width, 1.0)
    return np.where(width > 0, scaled, 0.5)


def _squares(scaled: Array, point: Array) -> Array:
    return np.asarray(np.sum((scaled - point) ** 2, axis=1))
