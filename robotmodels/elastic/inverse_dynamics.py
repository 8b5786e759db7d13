"""Torques behind a measured movement, split by what they move."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from robotmodels.common.arrays import Array
from robotmodels.description.robot_file import Payload
from robotmodels.elastic.arm import Arm
from robotmodels.elastic.dynamics import gravity_torques
from robotmodels.elastic.rigid_pose import unloaded
from robotmodels.elastic.robot import ElasticRobot


@dataclass(frozen=True, eq=False)
class MovementTorques:
    """Torques at the motors' joints behind the gears, (N, n) [N m or N], rotors left out.

    Attributes
    ----------
    links : ndarray, (N, n)
        What moves the robot's links and its payload's moments of inertia, and holds them.
    payload : ndarray, (N, n)
        The same for each kg of the payload; zero without one.
    payload_weight : ndarray, (N, n)
        Gravity's part of that.
    counterbalances : ndarray, (N, n)
        What the counterbalances add to the torque that gears must give.
    friction : ndarray, (N, n)
        Friction of the joints behind the gears, as the robot file has it.
    """

    links: Array
    payload: Array
    payload_weight: Array
    counterbalances: Array
    friction: Array


def movement_torques(
    robot: ElasticRobot, positions: Array, velocities: Array, accelerations: Array
) -> MovementTorques:
    """Return the torques behind a movement of the joints, each of the arrays (N, n)."""
    payload, drives = robot.file.payload, robot.layout.drives
    movement = [unloaded(robot, part) for part in (positions, velocities, accelerations)]
    joints = [_joints(robot.arm, part, i == 0) for i, part in enumerate(movement)]
    total, balance = _torques(robot.arm, joints), _balance(robot.arm, joints[0])
    friction = _friction(robot, movement[1], total + balance)
    per_kg, weight = np.zeros((2, *total.shape))
    if payload is not None:
        heavier = _with_mass(robot, payload, payload.mass + 1.0)
        per_kg = _torques(heavier, joints) - total
        total = total - payload.mass * per_kg
        weight = gravity_torques(heavier, movement[0]) - gravity_torques(robot.arm, movement[0])
    parts = (part[:, drives] for part in (total, per_kg, weight, balance, friction))
    return MovementTorques(*parts)


def _with_mass(robot: ElasticRobot, payload: Payload, mass: float) -> Arm:
    heavier = payload.model_copy(update={"mass": mass})
    return ElasticRobot(robot.file.model_copy(update={"payload": heavier}), robot.folder).arm


def _joints(arm: Arm, coordinates: Array, angles: bool) -> Array:
    if (reduction := arm.coordinate_map) is None:
        return coordinates
    return reduction.joints(coordinates) if angles else coordinates @ reduction.matrix.T


def _torques(arm: Arm, joints: list[Array]) -> Array:
    """Return the torques on the arm's coordinates, (N, d), without counterbalances."""
    data = arm.model.createData()
    torques = np.array([pin.rnea(arm.model, data, *now) for now in zip(*joints, strict=True)])
    return torques if arm.coordinate_map is None else torques @ arm.coordinate_map.matrix


def _friction(robot: ElasticRobot, speeds: Array, load: Array) -> Array:
    """Return the friction of the joints, (N, d), by speeds and what they bear, both (N, d)."""
    torques = np.zeros_like(speeds)
    for item in robot.file.friction:
        c = robot.arm.coordinate[item.joint]
        level = item.coulomb + item.load * np.abs(load[:, c])
        smooth = np.tanh(speeds[:, c] / item.coulomb_width)
        torques[:, c] = item.viscous * speeds[:, c] + level * smooth
    return torques


def _balance(arm: Arm, angles: Array) -> Array:
    balance = np.zeros_like(angles)
    for item in arm.counterbalances:
        balance[:, item.column] -= item.law(angles[:, item.column])[0]
    return balance if arm.coordinate_map is None else balance @ arm.coordinate_map.matrix
