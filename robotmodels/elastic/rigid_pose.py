"""The rigid robot in a position: its configuration, and what holds it against gravity."""

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from robotmodels.common.arrays import Array, real_numbers
from robotmodels.description.robot_file import Spring
from robotmodels.elastic.dynamics import gravity_torques
from robotmodels.elastic.robot import ElasticRobot


def configurations(robot: ElasticRobot, positions: Array) -> Array:
    """Return Pinocchio's configurations of the rigid model, (Q, nq), at `positions` (Q, n).

    Joints without a motor rest where their springs are unloaded.
    """
    rigid = robot.rigid
    q = np.tile(pin.neutral(rigid), (len(positions), 1))
    columns = np.asarray(positions, dtype=float).T
    angles = dict(zip(robot.motor_joints, columns, strict=True))
    for follower, coupling in robot.couplings.items():
        leader = angles.get(coupling.leader, np.zeros(len(positions)))
        angles[follower] = coupling.multiplier * leader + coupling.offset
    for name, values in angles.items():
        joint = rigid.joints[rigid.getJointId(name)]
        # A continuous joint stores cosine and sine.
        stored = [np.cos(values), np.sin(values)] if joint.nq == 2 else [values]
        q[:, joint.idx_q : joint.idx_q + joint.nq] = np.transpose(stored)
    return q


def joint_origins(robot: ElasticRobot, position: Array) -> Array:
    """Return the joint origins from base to tool, (k, 3) [m], at `position` (n,), springs unloaded.

    Where branches move, those of the longest chain; the tool is the last frame of its end.

    Raises
    ------
    InvalidInput
        If the position has a wrong shape or is outside the joint limits.
    """
    rigid, data = robot.rigid, _posed(robot, position)
    chain = max(map(list, rigid.supports), key=len)  # from the ground, joint 0
    tool = max(i for i, f in enumerate(rigid.frames) if f.parentJoint == chain[-1])
    origins = [data.oMi[joint].translation for joint in chain]
    return np.array([*origins, data.oMf[tool].translation])


def spring_origins(robot: ElasticRobot, springs: Sequence[Spring], position: Array) -> Array:
    """Return where springs of joints and links are, (s, 3) [m], at `position` (n,), all unloaded.

    Raises
    ------
    InvalidInput
        If the position has a wrong shape or is outside the joint limits.
    """
    data = _posed(robot, position)
    points = [_origin_of(robot, data, one.joint, one.link, one.at) for one in springs]
    return np.array(points).reshape(-1, 3)


def part_origins(robot: ElasticRobot, position: Array) -> dict[str, Array]:
    """Return where the parts of a robot file are, (3,) [m], at `position` (n,), springs unloaded.

    Springs by their names, motors by theirs at their joints, and ``payload`` at its centre of mass.

    Raises
    ------
    InvalidInput
        If the position has a wrong shape or is outside the joint limits.
    """
    file, data = robot.file, _posed(robot, position)
    points = {one.name: _origin_of(robot, data, one.joint, None, None) for one in file.motors}
    for spring in file.springs:
        points[spring.name] = _origin_of(robot, data, spring.joint, spring.link, spring.at)
    if file.payload is not None:
        points["payload"] = _origin_of(robot, data, None, file.payload.link, file.payload.com)
    return points


def _origin_of(
    robot: ElasticRobot,
    data: pin.Data,
    joint: str | None,
    link: str | None,
    at: Sequence[float] | None,
) -> Array:
    """Return the origin of a joint, or a point of a link, (3,) [m]."""
    if joint is not None:
        return np.array(data.oMi[robot.rigid.getJointId(joint)].translation)
    body = robot.rigid.getFrameId(link, pin.BODY)
    return np.asarray(data.oMf[body].act(np.array(at)))


def _posed(robot: ElasticRobot, position: Array) -> pin.Data:
    """Return where joints and frames are at `position` (n,), springs unloaded."""
    (q,) = configurations(robot, robot.checked_positions(real_numbers(position, "position")[None]))
    data = robot.rigid.createData()
    pin.framesForwardKinematics(robot.rigid, data, q)
    return data


def unloaded(robot: ElasticRobot, positions: Array) -> Array:
    """Return the elastic arm's coordinates, (Q, arm size), at `positions`, springs unloaded."""
    coordinates = np.zeros((len(positions), robot.layout.arm_size))
    coordinates[:, robot.layout.drives] = positions
    return coordinates


def holding_torques(robot: ElasticRobot, coordinates: Array) -> Array:
    """Return the torques on the motor shafts, (Q, n) [N m], that hold an arm against gravity.

    Parameters
    ----------
    robot : ElasticRobot
        The robot.
    coordinates : ndarray
        (Q, arm size) of its arm: at equilibrium, or those of `unloaded`, which change the torques
        by parts in a thousand.
    """
    shaft = np.array([motor.gear_ratio * motor.torque_gain for motor in robot.file.motors])
    return np.asarray(gravity_torques(robot.arm, coordinates)[:, robot.layout.drives] / shaft)
