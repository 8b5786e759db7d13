"""Modes as movements of the joints' origins, for pictures of the robot."""

from dataclasses import dataclass

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.elastic.elastic_pose import frame_points, joint_placements
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.elastic.tool_response import tool_frame
from robotmodels.linear.modes import resonances
from robotmodels.linear.response import linearize

_COUNT = 4
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
    twists : ndarray, (k, joints, 6)
        Of the joints' frames: movement of the origin [m] and rotation [rad], in the root frame.
    """

    frequencies: Array
    movements: Array
    twists: Array


def mode_movements(
    robot: ElasticRobot, position: Array, parameters: Array | None = None
) -> ModeMovements:
    """Return the four lowest modes at `position` (n,) about the equilibrium, parameters (p,) [SI].

    Raises
    ------
    NoEquilibrium
        If a spring gives way.
    """
    (equilibrium,) = robot.equilibrium(position[None], parameters).coordinates
    modes = resonances(linearize(robot, position, parameters))
    shapes = modes.shapes[: len(equilibrium), :_COUNT].T
    coarse, _ = _differences(robot, equilibrium, shapes)
    reach = np.linalg.norm(coarse, axis=2).max(axis=1)
    scaled = shapes / np.where(reach > 0, reach, 1.0)[:, None]
    return ModeMovements(modes.frequencies[:_COUNT], *_differences(robot, equilibrium, scaled))


def _differences(robot: ElasticRobot, equilibrium: Array, shapes: Array) -> tuple[Array, Array]:
    """Return movements (k, j, 3) of points, twists (k, joints, 6) of joints by shapes (k, arm)."""
    ahead, behind = (
        joint_placements(robot, equilibrium + step * shapes) for step in (_STEP, -_STEP)
    )
    points = (_points(robot, ahead) - _points(robot, behind)) / (2 * _STEP)
    change, turned = (ahead - behind) / (2 * _STEP), (ahead + behind)[..., :3, :3] / 2
    spin = change[..., :3, :3] @ turned.swapaxes(-1, -2)
    rotation = np.stack([spin[..., 2, 1], spin[..., 0, 2], spin[..., 1, 0]], axis=-1)
    return points, np.concatenate([change[..., :3, 3], rotation], axis=-1)


def _points(robot: ElasticRobot, placements: Array) -> Array:
    """Return the joint origins from base to tool, (Q, j, 3) [m], of joints at `placements`."""
    chain = max(map(list, robot.rigid.supports), key=len)
    tool = frame_points(robot, tool_frame(robot), placements)
    return np.concatenate([placements[:, chain][..., :3, 3], tool[:, None]], axis=1)
