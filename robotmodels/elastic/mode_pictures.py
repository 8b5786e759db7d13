"""Modes as movements of the joints' origins, for pictures of the robot."""

from dataclasses import dataclass

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.elastic.elastic_pose import frame_points, joint_placements
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.elastic.tool_response import tool_frame
from robotmodels.linear.modes import resonances
from robotmodels.linear.response import linearize

_STEP = 1e-5  # of a mode shape that moves the farthest point by 1 m


@dataclass(frozen=True, eq=False)
class ModeMovements:
    """How modes move the joints of a robot in one position.

    Attributes
    ----------
    frequencies : ndarray, (k,), rad/s
        Undamped resonances with free motors, lowest first.
    movements : ndarray, (k, j, 3)
        Movements of the points of `rigid_pose.joint_origins`, of which the farthest is 1 [m].
    """

    frequencies: Array
    movements: Array


def mode_movements(
    robot: ElasticRobot, position: Array, parameters: Array | None = None, count: int = 4
) -> ModeMovements:
    """Return the lowest modes at `position` (n,), about the equilibrium, at parameters (p,) [SI].

    Raises
    ------
    NoEquilibrium
        If a spring gives way.
    """
    (equilibrium,) = robot.equilibrium(position[None], parameters).coordinates
    modes = resonances(linearize(robot, position, parameters))
    shapes = modes.shapes[: len(equilibrium), :count].T
    coarse = _points(robot, equilibrium + _STEP * shapes) - _points(
        robot, equilibrium - _STEP * shapes
    )
    reach = np.linalg.norm(coarse, axis=2).max(axis=1) / (2 * _STEP)
    scaled = shapes / np.where(reach > 0, reach, 1.0)[:, None]
    movements = _points(robot, equilibrium + _STEP * scaled) - _points(
        robot, equilibrium - _STEP * scaled
    )
    return ModeMovements(modes.frequencies[:count], movements / (2 * _STEP))


def _points(robot: ElasticRobot, coordinates: Array) -> Array:
    """Return the joint origins from base to tool, (Q, j, 3) [m]."""
    placements = joint_placements(robot, coordinates)
    chain = max(map(list, robot.rigid.supports), key=len)
    tool = frame_points(robot, tool_frame(robot), placements)
    return np.concatenate([placements[:, chain][..., :3, 3], tool[:, None]], axis=1)
