"""A first joint that turns the whole robot, and what on the ground is the same all around it."""

from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin

from robotmodels.collision.shapes import Shape
from robotmodels.common.arrays import Array

# Of directions [rad] and of points on an axis [m]: as rounding has it.
_PARALLEL = 1e-12
_ROOM = 1e-4
"""By how much cylinders are larger than what they enclose [m], far above Coal's tolerance."""


@dataclass(frozen=True, eq=False)
class Turntable:
    """The axis of a revolute first joint that carries everything that moves.

    Attributes
    ----------
    joint : int
        Number of the joint in the rigid model.
    axis : ndarray, (3,)
        Unit vector of the axis in the world.
    point : ndarray, (3,), m
        Point on the axis nearest to the origin.
    """

    joint: int
    axis: Array
    point: Array

    @classmethod
    def of(cls, rigid: pin.Model) -> "Turntable | None":
        """Return the first joint of a rigid model as a turntable; None where it is none."""
        first = [j for j in range(1, rigid.njoints) if rigid.parents[j] == 0]
        if len(first) != 1 or rigid.joints[first[0]].nv != 1:
            return None
        moved = pin.computeJointJacobians(rigid, rigid.createData(), pin.neutral(rigid))
        speed, turn = np.split(moved[:, rigid.joints[first[0]].idx_v], 2)
        if not turn.any():
            return None
        return cls(first[0], turn, np.cross(turn, speed))

    def keeps(self, shape: Shape) -> bool:
        """Return whether a shape on the ground is the same when turned: floors, and `cylinder`."""
        if shape.joint or not isinstance(shape.hull, coal.Halfspace | coal.Cylinder):
            return False
        at, floor = shape.placement, isinstance(shape.hull, coal.Halfspace)
        off_axis = np.zeros(3) if floor else np.cross(at.translation - self.point, self.axis)
        direction = at.rotation @ (shape.hull.n if floor else np.array([0.0, 0.0, 1.0]))
        return bool(np.abs([np.cross(direction, self.axis), off_axis]).max() <= _PARALLEL)

    def cylinder(self, shape: Shape) -> Shape | None:
        """Return a cylinder about the axis that encloses a shape on the ground, if it is finite.

        What does not touch it touches the shape at no angle of the joint.
        """
        shape.hull.computeLocalAABB()
        box = np.array([shape.hull.aabb_local.min_, shape.hull.aabb_local.max_])
        # Half spaces have boxes that are infinite, or as large as numbers get.
        if not np.abs(box).max() < 1e6:
            return None
        corners = np.array(np.meshgrid(*box.T)).reshape(3, -1).T
        corners = corners @ shape.placement.rotation.T + shape.placement.translation - self.point
        heights = corners @ self.axis
        radius = np.linalg.norm(corners - np.outer(heights, self.axis), axis=1).max() + _ROOM
        low, high = heights.min() - _ROOM, heights.max() + _ROOM
        upright = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), self.axis).matrix()
        at = pin.SE3(upright, self.point + 0.5 * (low + high) * self.axis)
        return Shape(shape.link, 0, at, coal.Cylinder(float(radius), float(high - low)))
