"""What sensors on links see of the arm's coordinates: accelerometers, gyroscopes, force and torque.

All are in the frame of their link, so that gravity tilts with it. The force and the torque with
which a link carries the payload are those of an accelerometer in its centre of mass.
"""

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from robotmodels.common.arrays import Array
from robotmodels.description.outputs import Output
from robotmodels.description.robot_file import Payload, RobotFile
from robotmodels.elastic.arm import Arm


def link_sensors(arm: Arm, file: RobotFile, outputs: Sequence[Output], coordinates: Array) -> Array:
    """Return C0, C1 and C2 of sensors on links, (3, Q, sensors, arm size).

    Parameters
    ----------
    outputs : sequence of Output
        Sensors on links; their frames have the names of the outputs in the arm's model.
    coordinates : ndarray, (Q, arm size), rad or m
        Where.
    """
    model, reduction = arm.model, arm.coordinate_map
    data = model.createData()
    joints = coordinates if reduction is None else reduction.joints(coordinates)
    rows = np.zeros((3, len(coordinates), len(outputs), model.nv))
    for i, q in enumerate(joints):
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        for j, output in enumerate(outputs):
            frame = model.getFrameId(output.label, pin.OP_FRAME)
            jacobian = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
            axis = np.array(output.direction) / np.linalg.norm(output.direction or 0.0)
            rotation = data.oMf[frame].rotation
            rows[:, i, j] = _row(output, axis, rotation, jacobian, model.gravity.linear, file)
    return rows if reduction is None else np.asarray(rows @ reduction.matrix)


def _row(
    output: Output, axis: Array, rotation: Array, jacobian: Array, gravity: Array, file: RobotFile
) -> Array:
    """Return C0, C1 and C2 of one sensor, (3, joints), by the Jacobian (6, joints) of its place."""
    row = np.zeros((3, jacobian.shape[1]))
    if output.quantity == "angular_velocity":
        row[1] = (rotation @ axis) @ jacobian[3:]
    elif output.quantity == "acceleration":
        row[0], row[2] = _specific_force(rotation @ axis, jacobian, gravity)
    else:
        row[0], row[2] = _load(output, axis, rotation, jacobian, gravity, file.payload)
    return row


def _specific_force(u: Array, jacobian: Array, gravity: Array) -> tuple[Array, Array]:
    """Return what u . (a - g) takes from positions and accelerations, u turning with the body.

    The point's acceleration, and gravity as u tilts: du . (-g) = -(u x g) . (rotation).
    """
    return np.asarray(-np.cross(u, gravity) @ jacobian[3:]), np.asarray(u @ jacobian[:3])


def _load(
    output: Output,
    axis: Array,
    rotation: Array,
    jacobian: Array,
    gravity: Array,
    payload: Payload | None,
) -> tuple[Array, Array]:
    """Return the rows of the force or the torque about the sensor's place on the payload."""
    assert payload is not None
    arm = np.array(payload.com) - np.array(output.point)
    at_centre = jacobian.copy()
    at_centre[:3] -= pin.skew(rotation @ arm) @ jacobian[3:]
    u = axis if output.quantity == "force" else np.cross(axis, arm)
    tilt, acceleration = _specific_force(payload.mass * rotation @ u, at_centre, gravity)
    if output.quantity == "torque":
        turned = rotation @ payload.inertia_matrix @ axis
        acceleration = acceleration + turned @ jacobian[3:]
    return tilt, acceleration
