"""Where joints and points of links are when the springs give way, for pictures of the robot."""

import numpy as np
import pinocchio as pin

from robotmodels.common.arrays import Array
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.elastic.tool_response import Frame


def joint_placements(robot: ElasticRobot, coordinates: Array) -> Array:
    """Return the placements of the rigid model's joints in the root frame, (Q, joints, 4, 4).

    Parameters
    ----------
    robot : ElasticRobot
        The robot.
    coordinates : ndarray, (Q, arm size), rad or m
        Coordinates of its arm: of `equilibrium`, or `rigid_pose.unloaded`, deflected or not.
    """
    model = robot.arm.model
    data = model.createData()
    joints = [model.getJointId(name) for name in robot.rigid.names]
    placements = np.empty((len(coordinates), len(joints), 4, 4))
    for k, q in enumerate(robot.arm.joints(np.asarray(coordinates))):
        pin.forwardKinematics(model, data, q)
        placements[k] = [data.oMi[joint].homogeneous for joint in joints]
    return placements


def frame_points(robot: ElasticRobot, frame: Frame, placements: Array) -> Array:
    """Return where the point of a link is, (Q, 3) [m], with the joints at `placements`."""
    body = robot.rigid.frames[robot.rigid.getFrameId(frame.link, pin.BODY)]
    at = body.placement.act(np.array(frame.at))
    return np.asarray(placements[:, body.parentJoint] @ np.append(at, 1.0))[:, :3]
