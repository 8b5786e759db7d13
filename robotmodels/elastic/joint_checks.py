"""Whether a robot file and the joints of its model file fit each other."""

from collections.abc import Mapping

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
