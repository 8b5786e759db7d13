"""Which joints can have friction of their own."""

from collections.abc import Mapping

import pinocchio as pin

from robotmodels.common.errors import InvalidInput
from robotmodels.description.joint_drives import Coupling
from robotmodels.description.robot_file import RobotFile
from robotmodels.description.urdf import unknown_joint


def check_friction(file: RobotFile, rigid: pin.Model, couplings: Mapping[str, Coupling]) -> None:
    """Refuse friction of joints that have no coordinate of their own behind a spring.

    Raises
    ------
    InvalidInput
        Naming the friction, its joint and what to give instead.
    """
    joints, sprung = list(rigid.names)[1:], {s.joint for s in file.springs if s.axis == "drive"}
    motor_of = {motor.joint: motor.name for motor in file.motors}
    for item in file.friction:
        who = f"friction {item.name!r}"
        if item.joint not in joints:
            what = f"{who}: {item.joint!r}"
            raise InvalidInput(unknown_joint(what, item.joint, joints, file.lock))
        if item.joint in couplings:
            leader = couplings[item.joint].leader
            raise InvalidInput(f"{who}: joint {item.joint!r} follows {leader!r}; give it to that")
        if item.joint not in sprung:
            raise InvalidInput(
                f"{who}: joint {item.joint!r} is driven rigidly, so its friction is that of motor "
                f"{motor_of[item.joint]!r}: viscous over the gear ratio squared, coulomb over it"
            )
