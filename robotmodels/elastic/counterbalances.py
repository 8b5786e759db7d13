"""Torques of counterbalances over the angles of their joints, with exact slopes.

Between a point on either side of a turning joint, length^2 = a0 + a1 cos q + a2 sin q; the torque
of a tension T is -T d length / dq.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput
from robotmodels.description.counterbalances import (
    Counterbalance,
    GasSpring,
    Point,
    Sinusoid,
    Table,
    TensionSpring,
)
from robotmodels.description.urdf import unknown_joint
from robotmodels.elastic.segments import link_frame

TorqueLaw = Callable[[Array], tuple[Array, Array]]
"""Torque on a joint, and its slope, over the joint's angle."""


@dataclass(frozen=True, eq=False)
class JointTorque:
    """A counterbalance on the joint of one column of Pinocchio's model."""

    column: int
    law: TorqueLaw


def joint_torque(
    balance: Counterbalance, rigid: pin.Model, column: int, turns: bool
) -> JointTorque:
    """Return a counterbalance on a joint of the rigid model, `column` of the arm's.

    Raises
    ------
    InvalidInput
        If its joint slides, its points are not on the two sides of the joint, or its table ends
        within the joint's limits.
    """
    if balance.table is not None:
        _check_range(balance, balance.table, rigid)
        return JointTorque(column, table_law(balance.table))
    if not turns:
        raise InvalidInput(
            f"counterbalance {balance.name!r}: joint {balance.joint!r} slides; a table is needed"
        )
    if balance.sinusoid is not None:
        return JointTorque(column, sinusoid_law(balance.sinusoid))
    law = balance.spring or balance.gas
    assert law is not None  # the file's schema asks for one of the four
    return JointTorque(column, _Between(*_length_terms(balance, law.points, rigid), law))


def check_counterbalance(
    balance: Counterbalance, rigid: pin.Model, lock: Mapping[str, float]
) -> None:
    """Refuse a counterbalance on a joint that does not exist or is locked.

    Raises
    ------
    InvalidInput
        Naming it and the joints there are.
    """
    joints = list(rigid.names)[1:]
    if balance.joint not in joints:
        what = f"counterbalance {balance.name!r}: {balance.joint!r}"
        raise InvalidInput(unknown_joint(what, balance.joint, joints, lock))


def sinusoid_law(law: Sinusoid) -> TorqueLaw:
    """Return the torque amplitude sin(q + phase) and its slope."""

    def torque(q: Array) -> tuple[Array, Array]:
        return law.amplitude * np.sin(q + law.phase), law.amplitude * np.cos(q + law.phase)

    return torque


def table_law(table: Table) -> TorqueLaw:
    """Return the spline through a table, and its slope."""
    from scipy.interpolate import CubicSpline  # takes a tenth of a second to load

    spline = CubicSpline(table.angles, table.torques)
    slope = spline.derivative()
    return lambda q: (spline(q), slope(q))


def osculating(law: TorqueLaw, angle: float) -> Sinusoid:
    """Return the sinusoid with a law's torque and slope at one angle."""
    torque, slope = (float(x) for x in law(np.array(angle)))
    amplitude = max(float(np.hypot(torque, slope)), 1e-9)
    return Sinusoid(amplitude=amplitude, phase=float(np.arctan2(torque, slope)) - angle)


@dataclass(frozen=True, eq=False)
class _Between:
    """The torque of a spring between two points; `a0`, `a1`, `a2` [m^2] make its length."""

    a0: float
    a1: float
    a2: float
    spring: TensionSpring | GasSpring

    def __call__(self, q: Array) -> tuple[Array, Array]:
        sin, cos = np.sin(q), np.cos(q)
        length = np.sqrt(self.a0 + self.a1 * cos + self.a2 * sin)
        first = (self.a2 * cos - self.a1 * sin) / (2 * length)
        second = (-(self.a1 * cos + self.a2 * sin) / 2 - first**2) / length
        tension, stiffness = _tension(self.spring, length)
        return -tension * first, -stiffness * first**2 - tension * second


def _tension(spring: TensionSpring | GasSpring, length: Array) -> tuple[Array, Array]:
    """Return the pull of a spring [N] and its derivative by the length [N/m]."""
    if isinstance(spring, TensionSpring):
        pull = spring.preload + spring.stiffness * (length - spring.rest_length)
        return pull, np.full_like(pull, spring.stiffness)
    side = np.sign(spring.force)
    column = spring.column - side * (length - spring.length)
    pull = spring.force * (spring.column / column) ** spring.exponent
    return pull, side * spring.exponent * pull / column


def _length_terms(
    balance: Counterbalance, points: tuple[Point, Point], rigid: pin.Model
) -> tuple[float, float, float]:
    """Return a0, a1 and a2 of the squared distance over the joint's angle."""
    joint = rigid.getJointId(balance.joint)
    placed = {}
    for point in points:
        frame = rigid.frames[link_frame(rigid, point.link, f"counterbalance {balance.name!r}")]
        placed[frame.parentJoint] = frame.placement.act(np.array(point.at))
    if set(placed) != {joint, rigid.parents[joint]}:
        links = " and ".join(repr(point.link) for point in points)
        raise InvalidInput(
            f"counterbalance {balance.name!r}: links {links} are not on the two sides of joint "
            f"{balance.joint!r}, with no other joint between them"
        )
    moving = placed[joint]
    ground = rigid.jointPlacements[joint].actInv(placed[rigid.parents[joint]])
    axis = _axis(rigid, joint)
    along = (ground @ axis) * (moving @ axis)
    cosine, sine = ground @ moving - along, ground @ np.cross(axis, moving)
    if np.hypot(cosine, sine) < 1e-9:
        raise InvalidInput(f"counterbalance {balance.name!r}: a point is on the joint's axis")
    return float(ground @ ground + moving @ moving - 2 * along), -2 * cosine, -2 * sine


def _axis(rigid: pin.Model, joint: int) -> Array:
    data = rigid.createData()
    pin.computeJointJacobians(rigid, data, pin.neutral(rigid))
    jacobian = pin.getJointJacobian(rigid, data, joint, pin.LOCAL).reshape(6, -1)
    return np.asarray(jacobian[3:, rigid.joints[joint].idx_v])


def _check_range(balance: Counterbalance, table: Table, rigid: pin.Model) -> None:
    joint = rigid.joints[rigid.getJointId(balance.joint)]
    low, high = (
        (-np.pi, np.pi)
        if joint.nq == 2
        else (rigid.lowerPositionLimit[joint.idx_q], rigid.upperPositionLimit[joint.idx_q])
    )
    if table.angles[0] > low + 1e-6 or table.angles[-1] < high - 1e-6:
        raise InvalidInput(
            f"counterbalance {balance.name!r}: its table covers {table.angles[0]:.4g} to "
            f"{table.angles[-1]:.4g}, the joint moves from {low:.4g} to {high:.4g}"
        )
