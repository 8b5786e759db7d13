"""Candidate positions that bring a tool to points of a box in space."""

from dataclasses import dataclass

import numpy as np

from robotmodels.common.arrays import (
    Array,
    IntArray,
    cartesian_grid,
    check_count,
    is_count,
    read_only,
    real_numbers,
)
from robotmodels.common.errors import InvalidInput
from robotmodels.common.progress import Progress, tell
from robotmodels.elastic.inverse_kinematics import Tool, inverse_kinematics
from robotmodels.elastic.robot import ElasticRobot

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class TaskBox:
    """Points in a box that a tool is to reach.

    Attributes
    ----------
    link : str
        Link that carries the tool.
    low, high : Vector, m
        Opposite corners in the root link's frame; equal ones give one point.
    points : tuple of (int, int, int)
        Points along x, y and z, ends included; one lies in the middle.
    direction : Vector or None, (3,)
        Direction of the tool's axis at every point; None leaves it free.
    at, axis : Vector
        The tool's point [m] and axis in the link's frame.
    solutions : int
        Most positions for each point (elbow up and down, wrist turned).
    starts : int
        Random starts of the search for them.

    Raises
    ------
    InvalidInput
        Naming the key that does not fit.
    """

    link: str
    low: Vector
    high: Vector
    points: tuple[int, int, int]
    direction: Vector | None = None
    at: Vector = (0.0, 0.0, 0.0)
    axis: Vector = (0.0, 0.0, 1.0)
    solutions: int = 4
    starts: int = 16

    def __post_init__(self) -> None:
        who = f"task box on {self.link!r}"
        for key in ("low", "high", "direction", "at", "axis"):
            value = getattr(self, key)
            if value is None:
                continue
            array = real_numbers(value, f"{who}: {key}")
            if array.shape != (3,) or not np.isfinite(array).all():
                raise InvalidInput(f"{who}: {key} is {value!r}; three finite numbers are needed")
            if key in ("direction", "axis") and not array.any():
                raise InvalidInput(f"{who}: {key} is zero; a direction is needed")
        if np.any(np.asarray(self.low) > np.asarray(self.high)):
            raise InvalidInput(f"{who}: low {list(self.low)} is above high {list(self.high)}")
        if len(self.points) != 3 or not all(map(is_count, self.points)):
            raise InvalidInput(f"{who}: points {self.points!r}; three whole numbers >= 1 needed")
        for key in ("solutions", "starts"):
            check_count(getattr(self, key), f"{who}: {key}")

    def targets(self) -> Array:
        """Return the points, (T, 3) [m]; z runs fastest."""
        axes = [
            np.linspace(low, high, count) if count > 1 else np.array([(low + high) / 2])
            for low, high, count in zip(self.low, self.high, self.points, strict=True)
        ]
        return cartesian_grid(axes)


@dataclass(frozen=True, eq=False)
class TaskPositions:
    """Positions that reach the points of a box.

    Attributes
    ----------
    positions : ndarray, (Q, n), rad or m
        Positions.
    targets : ndarray, (T, 3), m
        Points asked for.
    target : ndarray of int, (Q,)
        The point that each position reaches.
    unreached : ndarray of int
        Points that no position reaches.
    """

    positions: Array
    targets: Array
    target: IntArray
    unreached: IntArray


def task_space_positions(
    robot: ElasticRobot,
    box: TaskBox,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> TaskPositions:
    """Return positions that bring the tool to the points of a box, at the rigid pose.

    A point counts as out of reach if no search from `box.starts` random positions gets there.

    Parameters
    ----------
    robot : ElasticRobot
        The robot.
    box : TaskBox
        Tool and points.
    rng : Generator
        Draws the starts of the searches.
    progress : Progress, optional
        Called with the number of points done and their total.

    Raises
    ------
    InvalidInput
        If the link is not there, or no point at all is reached.
    """
    tool, targets = Tool(box.link, box.at, box.axis), box.targets()
    direction = None if box.direction is None else np.asarray(box.direction, dtype=float)
    solutions = []
    for i, target in enumerate(targets):
        solutions.append(
            inverse_kinematics(
                robot,
                tool,
                target,
                direction,
                solutions=box.solutions,
                starts=box.starts,
                rng=rng,
            )
        )
        tell(progress, i + 1, len(targets))
    counts = np.array([len(positions) for positions in solutions])
    if not counts.any():
        raise InvalidInput(
            f"task box on {box.link!r}: none of its {len(targets)} points is within reach; "
            f"low {list(box.low)}, high {list(box.high)} m, in the root link's frame"
        )
    return TaskPositions(
        positions=read_only(np.concatenate(solutions)),
        targets=read_only(targets),
        target=read_only(np.repeat(np.arange(len(targets)), counts)),
        unreached=read_only(np.flatnonzero(counts == 0)),
    )
