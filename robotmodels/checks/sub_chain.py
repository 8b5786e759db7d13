"""A part of a robot to move: what lies between two links, the other joints held, and followers."""

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from robotmodels.checks.proposed_drives import UrdfJoint
from robotmodels.common.errors import InvalidInput, check_word
from robotmodels.description.joint_drives import Coupling
from robotmodels.description.urdf_check import free_joints


@dataclass(frozen=True)
class SubChain:
    """Which joints of a model file are held rigid.

    Attributes
    ----------
    base : str or None
        Link from which joints move outwards; the root link where None.
    tip : str or None
        Link up to which joints move; all links beyond the base where None.
    lock : dict of str to (float or None), rad or m
        Further joints held, and where; None for zero, or the limit nearest to it.
    """

    base: str | None = None
    tip: str | None = None
    lock: dict[str, float | None] = field(default_factory=dict)


def locked_joints(
    joints: Sequence[UrdfJoint], checked: ET.Element, chain: SubChain
) -> dict[str, float]:
    """Return the moving joints that are held, and where [rad or m].

    Raises
    ------
    InvalidInput
        If there is no such link or joint, or the tip does not lie beyond the base.
    """
    links = [str(link.get("name")) for link in checked.findall("link")]
    free = free_joints(checked)
    names = [*(joint.name for joint in joints), *free]
    above = {
        str(j.find("child").get("link")): (str(j.get("name")), str(j.find("parent").get("link")))  # type: ignore[union-attr]
        for j in checked.findall("joint")
    }
    for option, link in (("--base", chain.base), ("--tip", chain.tip)):
        if link is not None:
            check_word(f"{option}:", link, links, "is not a link")
    for name in chain.lock:
        check_word("--lock:", name, names, "is not a moving joint")
    beyond = set(names)
    if chain.base is not None:
        beyond = {
            joint for link, (joint, _) in above.items() if chain.base in _ancestors(link, above)
        }
    if chain.tip is not None:
        if chain.base not in (None, *_ancestors(chain.tip, above)):
            raise InvalidInput(f"--tip: link {chain.tip!r} does not lie beyond {chain.base!r}")
        path = [chain.tip, *_ancestors(chain.tip, above)]
        beyond &= {above[link][0] for link in path if link in above}
    _check_held(free, beyond, chain)
    angles = dict.fromkeys(free, 0.0) | {joint.name: rest_angle(joint) for joint in joints}
    return {
        name: angle if (at := chain.lock.get(name)) is None else at
        for name, angle in angles.items()
        if name not in beyond or name in chain.lock
    }


def _check_held(free: dict[str, str], beyond: set[str], chain: SubChain) -> None:
    """Refuse free joints, with the links that they carry, that no option holds."""
    for name in sorted(beyond & free.keys() - chain.lock.keys()):
        raise InvalidInput(
            f"joint {name!r} leaves link {free[name]!r} free to move; to hold it where it is, say "
            f"--base {free[name]} or --lock {name}"
        )


def _ancestors(link: str, above: dict[str, tuple[str, str]]) -> Iterable[str]:
    ancestors = []
    while link in above:
        link = above[link][1]
        ancestors.append(link)
    return ancestors


def rest_angle(joint: UrdfJoint) -> float:
    """Return zero, or the limit nearest to it [rad or m]."""
    return min(max(0.0, joint.low), joint.high)


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
