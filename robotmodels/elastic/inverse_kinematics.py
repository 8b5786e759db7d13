"""Positions of the motors that bring a point of a link to a point in space."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from robotmodels.common.arrays import Array, BoolArray
from robotmodels.common.errors import InvalidInput
from robotmodels.elastic.rigid_pose import configurations
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.elastic.segments import link_frame

_ACCURACY = 1e-6  # [m], and [rad] of the direction
_ITERATIONS = 60
_SAME_SOLUTION = 0.1  # [rad] or [m]: closer solutions are one
# Joints that do not move the tool leave the normal matrix without an inverse but for the damping.
_LEAST_DAMPING = 1e-8


@dataclass(frozen=True, eq=False)
class Tool:
    """What is to be brought somewhere.

    Attributes
    ----------
    link : str
        Its link.
    at : sequence of float, (3,), m
        The point, in the link frame.
    axis : sequence of float, (3,)
        The direction that is to be turned, in the link frame.

    Raises
    ------
    InvalidInput
        If the axis is zero.
    """

    link: str
    at: Sequence[float] = (0.0, 0.0, 0.0)
    axis: Sequence[float] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        if not np.any(self.axis):
            raise InvalidInput(f"tool on link {self.link!r}: its axis is zero")


def inverse_kinematics(
    robot: ElasticRobot,
    tool: Tool,
    point: Array,
    direction: Array | None = None,
    *,
    solutions: int,
    starts: int,
    rng: np.random.Generator,
) -> Array:
    """Return up to `solutions` different positions (s, n) with the tool at `point`, rigid pose.

    Damped Gauss-Newton steps (Levenberg and Marquardt) from `starts` random positions, kept
    inside the joint limits; several starts end in several elbow and wrist configurations. A
    revolute joint is turned back by whole turns to within half a turn of zero.

    Parameters
    ----------
    robot : ElasticRobot
        The robot.
    tool : Tool
        Point and axis on a link.
    point : ndarray, (3,), m
        Point in the root link's frame.
    direction : ndarray, (3,), optional
        Direction of the tool's axis there; None leaves it free.
    solutions, starts : int
        How many to return, and to try.
    rng : Generator
        Draws the starts.

    Raises
    ------
    InvalidInput
        If the link is not there.
    """
    reach = _Reach(robot, tool)
    low, high = robot.position_limits.T
    unit = None if direction is None else np.asarray(direction) / np.linalg.norm(direction)
    distinct: list[Array] = []
    for start in low + rng.random((starts, len(low))) * (high - low):
        position = _search(reach, start, np.asarray(point, dtype=float), unit, low, high)
        if position is None:
            continue
        position = _turned_back(position, robot.turning, low, high)
        if all(np.abs(position - other).max() > _SAME_SOLUTION for other in distinct):
            distinct.append(position)
        if len(distinct) == solutions:
            break
    return np.array(distinct).reshape(-1, len(low))


def nearest_position(robot: ElasticRobot, tool: Tool, point: Array, start: Array) -> Array | None:
    """Return a position (n,) near `start` with the tool at `point`; None where none is reached.

    One search of `inverse_kinematics` from `start` (n,), with the direction free: its damped steps
    turn the joints as little as brings the tool there.

    Raises
    ------
    InvalidInput
        If the link is not there.
    """
    low, high = robot.position_limits.T
    at, begin = np.asarray(point, dtype=float), np.clip(start, low, high)
    return _search(_Reach(robot, tool), begin, at, None, low, high)


class _Reach:
    """Where a tool is, and how it moves with the motors."""

    def __init__(self, robot: ElasticRobot, tool: Tool) -> None:
        self.robot, self.model = robot, robot.rigid
        self.data = self.model.createData()
        self.frame = link_frame(self.model, tool.link, "tool")
        self.at = np.asarray(tool.at, dtype=float)
        self.axis = np.asarray(tool.axis, dtype=float) / np.linalg.norm(tool.axis)
        # How all joints turn with the motors, those that follow others included.
        self.turned = np.zeros((self.model.nv, len(robot.motor_joints)))
        for j, joint in enumerate(robot.motor_joints):
            self.turned[self._column(joint), j] = 1.0
            for follower, coupling in robot.couplings.items():
                if coupling.leader == joint:
                    self.turned[self._column(follower), j] = coupling.multiplier

    def _column(self, joint: str) -> int:
        return int(self.model.joints[self.model.getJointId(joint)].idx_v)

    def __call__(self, position: Array) -> tuple[Array, Array, Array, Array]:
        """Return point, axis, and their derivatives (3, n) by the position (n,)."""
        (q,) = configurations(self.robot, position[None])
        jacobian = (
            pin.computeFrameJacobian(self.model, self.data, q, self.frame, pin.LOCAL_WORLD_ALIGNED)
            @ self.turned
        )
        pin.updateFramePlacement(self.model, self.data, self.frame)
        placement = self.data.oMf[self.frame]
        arm, axis = placement.rotation @ self.at, placement.rotation @ self.axis
        turning = jacobian[3:]
        moved = jacobian[:3] + np.cross(turning, arm, axis=0)
        return placement.translation + arm, axis, moved, np.cross(turning, axis, axis=0)


def _search(
    reach: _Reach, position: Array, point: Array, direction: Array | None, low: Array, high: Array
) -> Array | None:
    """Return a position within the limits that reaches the point, or None."""
    damping, smallest = 1e-2, np.inf
    best = position
    error, jacobian = np.empty(0), np.empty((0, len(position)))
    for _ in range(_ITERATIONS):
        at, axis, moved, turned = reach(position)
        new = at - point if direction is None else np.concatenate([at - point, axis - direction])
        size = float(np.linalg.norm(new))
        if size < _ACCURACY:
            return position
        if size < smallest:
            best, smallest, damping = position, size, max(0.2 * damping, _LEAST_DAMPING)
            error = new
            jacobian = moved if direction is None else np.concatenate([moved, turned])
        else:
            damping *= 5
        if damping > 1e6:
            return None
        normal = jacobian.T @ jacobian + damping * np.eye(len(position))
        position = np.clip(best - np.linalg.solve(normal, jacobian.T @ error), low, high)
    return None


def _turned_back(position: Array, turns: BoolArray, low: Array, high: Array) -> Array:
    """Return the position with whole turns taken out where the limits allow it."""
    back = position - 2 * np.pi * np.round(position / (2 * np.pi))
    allowed = turns & (back >= low) & (back <= high)
    return np.where(allowed, back, position)
