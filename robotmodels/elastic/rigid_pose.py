"""The rigid robot in a position: its configuration, and what holds it against gravity."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from robotmodels.arrays import Array
from robotmodels.elastic.dynamics import gravity_torques

if TYPE_CHECKING:
    from robotmodels.elastic.robot import ElasticRobot


def configurations(robot: ElasticRobot, positions: Array) -> Array:
    """Return Pinocchio's configurations of the rigid model, (Q, nq), at `positions` (Q, n).

    Joints without a motor rest where their springs are unloaded.
    """
    rigid = robot.rigid
    q = np.tile(pin.neutral(rigid), (len(positions), 1))
    for name, angles in zip(robot.motor_joints, np.asarray(positions, dtype=float).T, strict=True):
        joint = rigid.joints[rigid.getJointId(name)]
        # A continuous joint stores cosine and sine.
        values = [np.cos(angles), np.sin(angles)] if joint.nq == 2 else [angles]
        q[:, joint.idx_q : joint.idx_q + joint.nq] = np.transpose(values)
    return q


def unloaded(robot: ElasticRobot, positions: Array) -> Array:
    """Return the elastic arm's coordinates, (Q, arm size), at `positions`, springs unloaded."""
    coordinates = np.zeros((len(positions), robot.layout.arm_size))
    coordinates[:, robot.layout.drives] = positions
    return coordinates


def holding_torques(robot: ElasticRobot, coordinates: Array) -> Array:
    """Return the torques on the motor shafts, (Q, n) [N m], that hold an arm against gravity.

    Parameters
    ----------
    robot : the robot.
    coordinates : (Q, arm size) of its arm: at equilibrium, or those of `unloaded`, which change
        the torques by parts in a thousand.
    """
    shaft = np.array([motor.gear_ratio * motor.torque_gain for motor in robot.file.motors])
    return np.asarray(gravity_torques(robot.arm, coordinates)[:, robot.layout.drives] / shaft)
