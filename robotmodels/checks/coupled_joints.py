"""Joints of a model file that follow others: those of grippers, and those of main axes."""

from collections.abc import Mapping, Sequence

from robotmodels.checks.proposed_drives import UrdfJoint
from robotmodels.checks.sub_chain import rest_angle
from robotmodels.description.joint_drives import Coupling


def locked_couplings(
    joints: Sequence[UrdfJoint], couplings: Mapping[str, Coupling], locked: Mapping[str, float]
) -> dict[str, float]:
    """Return which joints are held, and where [rad or m]: `locked` ones, and what goes with them.

    A leader and its followers that carry no other joint are the fingers of a gripper, which are
    held. Followers of a leader that is held are held where it has them.
    """
    by_name = {joint.name: joint for joint in joints}
    angles = dict(locked)
    for leader in {c.leader for c in couplings.values()} - angles.keys():
        group = {leader, *(n for n, c in couplings.items() if c.leader == leader)}
        if not any(j.carrier in group and j.name not in group for j in joints):
            angles[leader] = rest_angle(by_name[leader])
    for name, coupling in couplings.items():
        if coupling.leader in angles and name not in locked:
            joint = by_name[name]
            angle = coupling.multiplier * angles[coupling.leader] + coupling.offset
            angles[name] = min(max(angle, joint.low), joint.high)
    free = [name for name in locked if name not in by_name]
    return {name: angles[name] for name in (*free, *by_name) if name in angles}
