"""Whether a robot file and the joints of its model file fit each other, friction included."""

from collections.abc import Mapping

import pinocchio as pin

from robotmodels.common.errors import InvalidInput
from robotmodels.description.joint_drives import Coupling
from robotmodels.description.robot_file import RobotFile
from robotmodels.description.urdf import unknown_joint


def check_joints(file: RobotFile, joints: list[str], couplings: Mapping[str, Coupling]) -> None:
    """Refuse motors and outputs of joints that do not move, and joints that nothing supports.

    Parameters
    ----------
    joints : list of str
        Joints that move.
    couplings : mapping
        Followers among all joints.

    Raises
    ------
    InvalidInput
        Naming the joint.
    """
    named = [(f"motor {motor.name!r}", motor.joint) for motor in file.motors]
    named += [(output.who, output.of) for output in file.outputs if output.kind == "joint"]
    for who, joint in named:
        if joint not in joints:
            raise InvalidInput(unknown_joint(f"{who}: {joint!r}", joint, joints, file.lock))
    supported = {m.joint for m in file.motors}
    supported |= {str(s.joint) for s in file.springs if s.axis == "drive"}
    followers = {name: coupling for name, coupling in couplings.items() if name in joints}
    for name in sorted(supported & set(followers)):
        raise InvalidInput(
            f"joint {name!r} follows {followers[name].leader!r} (mimic) and has neither "
            "motor nor drive spring of its own"
        )
    loose = [j for j in joints if j not in supported and j not in followers]
    if loose:
        raise InvalidInput(
            f"joints without motor or drive spring: {', '.join(loose)}; "
            "give each a motor or hold it under 'lock'"
        )
    for name, coupling in followers.items():
        if coupling.leader not in joints:
            angle = coupling.multiplier * file.lock.get(coupling.leader, 0.0) + coupling.offset
            raise InvalidInput(
                f"joint {name!r} follows {coupling.leader!r}, which is locked; lock it as "
                f"well, at {angle:.6g}"
            )


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
