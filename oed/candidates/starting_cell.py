"""A workcell for a robot of which no more is known than its URDF: one that leaves it positions."""

from dataclasses import dataclass, replace

import numpy as np

from oed.candidates.sources import Workcell
from robotmodels.collision.shapes import lowest_of_base
from robotmodels.common.arrays import Array
from robotmodels.elastic.robot import ElasticRobot

_LEAST_FREE = 0.1
"""Part of the positions that floor and pairs of links have to leave."""

_DROPS = (0.0, 0.03, 0.1)
"""Of the floor below the base, where the first link always touches it [m]."""


@dataclass(frozen=True)
class StartingCell:
    """A workcell, and what it leaves out.

    Attributes
    ----------
    cell : Workcell
        With the floor that the base stands on, and the pairs that touch by design in `ignored`.
    below : tuple of str
        Links that would be below the floor in so many positions that there is none.
    """

    cell: Workcell
    below: tuple[str, ...] = ()

    @property
    def ignored(self) -> tuple[tuple[str, str], ...]:
        """Pairs of links that are not compared."""
        return tuple(self.cell.ignored)


def starting_cell(robot: ElasticRobot, positions: Array, cell: Workcell) -> StartingCell:
    """Return `cell` with a floor under the base and without pairs that leave no position.

    The floor is left out where nine of ten positions are below it, as for a robot on legs. Links
    that touch at zero angles are built so; of the others, those that touch most often are ignored
    until a tenth of the positions is free.

    Parameters
    ----------
    robot : ElasticRobot
        The robot.
    positions : ndarray, (Q, n), rad or m
        Positions to judge by.
    cell : Workcell
        Its floor is lowered to the lowest point of the base.

    Raises
    ------
    InvalidInput
        As `Workcell.surroundings`.
    """
    floor, below = _floor(robot, positions, cell)
    cell = replace(cell, floor=floor)
    around = cell.surroundings(robot)
    if around is None:
        return StartingCell(cell, below)
    home = np.clip(0.0, *robot.position_limits.T)
    touching = around.touching(np.vstack([home, positions]))
    linked = np.array([not pair.obstacle for pair in around.pairs], dtype=bool)
    ignored = linked & touching[0]
    while touching[1:, ~ignored].any(axis=1).mean() > 1 - _LEAST_FREE:
        counts = np.where(linked & ~ignored, touching[1:].sum(axis=0), 0)
        if not counts.any():
            break
        ignored[np.argmax(counts)] = True
    pairs = [(p.first, p.second) for p, skip in zip(around.pairs, ignored, strict=True) if skip]
    return StartingCell(replace(cell, ignored=[*cell.ignored, *pairs]), below)


def _floor(
    robot: ElasticRobot, positions: Array, cell: Workcell
) -> tuple[float | None, tuple[str, ...]]:
    """Return the height of the floor; None, and the links below it, where it removes too much."""
    if cell.floor is None:
        return None, ()
    base = min(cell.floor, float(np.floor(1e3 * lowest_of_base(robot)) / 1e3))
    for drop in _DROPS:
        floored = replace(cell, floor=base - drop, self_collision=False).surroundings(robot)
        if floored is None:
            break
        touching = floored.touching(positions)
        if touching.any(axis=1).mean() <= 1 - _LEAST_FREE:
            return base - drop, ()
    pairs = zip(floored.pairs, touching.mean(axis=0) > 0.5, strict=True) if floored else ()
    return None, tuple(pair.first for pair, often in pairs if often)
