"""The section ``candidates`` of a study file: where the robot may be put, and what is in the way.

    candidates:
      per_joint: {elbow_joint: 5}                # grid: points per joint, one if not named
      limits: {elbow_joint: [-2.5, 2.5]}         # narrower ranges [rad; m]
      sobol: 2048                                # points that fill the ranges evenly
      boxes:                                     # points that a tool is to reach
        - {link: tool0, low: [0.4, -0.3, 0.2], high: [0.8, 0.3, 0.6], points: [3, 3, 3]}
      positions: [[0.0, -1.2, 0.4]]              # by hand
      files: [taught.csv]                        # lists of positions
      floor: 0.0                                 # height above the root link's origin [m]
      obstacles:                                 # in the root link's frame [m, rad]
        - {name: wall, normal: [1, 0, 0], offset: -0.8}
        - {name: table, center: [0.9, 0, 0.2], size: [0.6, 1.2, 0.4]}
        - {name: lamp, center: [0, 0.9, 1.2], radius: 0.2}
      self_collision: true                       # default where floor or obstacles are given
      link_radius: 0.08                          # of links without collision shapes [m]
      margin: 0.02                               # distance to keep [m]
      ignored: [[link1, link3]]                  # pairs of links that may touch
      torque: [9.0, 9.0, 9.0, 1.9, 2.0, 0.6]     # that may hold the arm, on the motor shafts [N m]

Without a source it is the usual joint grid.
"""

import math
from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, model_validator

from oed.experiment.workcell_settings import WorkcellChoice
from robotmodels.common.yaml_files import FileSection
from robotmodels.description.ranges import Coordinate, JointLimit, Positive, Vector

MOST_CANDIDATES = 10_000_000
"""Their positions stay in memory: 240 MB of six joints."""

Points = Annotated[int, Field(ge=1, le=MOST_CANDIDATES)]


class BoxChoice(FileSection):
    """Points in a box that a tool is to reach, see `oed.candidates.task_space.TaskBox`."""

    link: str
    low: Vector
    high: Vector
    points: tuple[Points, Points, Points]
    direction: Vector | None = None
    at: Vector = (0.0, 0.0, 0.0)
    axis: Vector = (0.0, 0.0, 1.0)
    solutions: Annotated[int, Field(ge=1, le=100)] = 4


class CandidatesChoice(WorkcellChoice):
    """Sources of candidate positions, and what the robot must not touch."""

    per_joint: Annotated[dict[str, Points], Field(min_length=1)] | None = None
    limits: dict[str, tuple[JointLimit, JointLimit]] = {}
    sobol: Points | None = None
    boxes: tuple[BoxChoice, ...] = ()
    positions: tuple[tuple[Coordinate, ...], ...] = ()
    files: tuple[Path, ...] = ()
    torque: Positive | tuple[Positive, ...] | None = None

    @model_validator(mode="after")
    def _not_too_many(self) -> Self:
        boxed = sum(math.prod(box.points) * box.solutions for box in self.boxes)
        grid = 0 if self.per_joint is None else math.prod(self.per_joint.values())
        number = grid + boxed + (self.sobol or 0)
        if number > MOST_CANDIDATES:
            key = "per_joint" if grid > MOST_CANDIDATES else "candidates"
            raise ValueError(f"{key}: {number} positions; at most {MOST_CANDIDATES} fit")
        return self
