"""What of a URDF matters, and mistakes in it that a parser would skip or print to the console.

All that reads a URDF reads it through this module, which writes every number anew: Pinocchio, Coal
and MuJoCo are handed what was checked, whatever their own readers make of other spellings.
"""

import math
import xml.etree.ElementTree as ET
from collections import Counter
from pathlib import Path

from scipy.spatial.transform import Rotation

from robotmodels.common.errors import InvalidInput, check_word
from robotmodels.common.printing import unprintable
from robotmodels.description.joint_drives import add_drive, add_mimic, couplings, gear_ratios
from robotmodels.description.model_files import ModelSource, path_of, read_model
from robotmodels.description.ranges import (
    LEAST_DIRECTION,
    MOST_INERTIA,
    MOST_LIMIT,
    MOST_MASS,
)
from robotmodels.description.urdf_elements import (
    add_origin,
    elements,
    number_text,
    only_child,
    read_number,
    read_numbers,
)
from robotmodels.description.xml_reader import XmlElement

MOST_LINKS = 500
"""Links of a URDF."""

GROUND = "universe"
"""Pinocchio's name for what does not move: no joint's."""

_SUPPORTED = ("revolute", "continuous", "prismatic", "fixed")
_FREE = ("floating", "planar")
_SHAPES = {
    "box": ("size", 3),
    "capsule": ("radius", 1),
    "cylinder": ("radius", 1),
    "sphere": ("radius", 1),
}
_LONG = ("capsule", "cylinder")


def checked_urdf(source: ModelSource, *, shapes: bool = False) -> ET.Element:
    """Return the links and joints of a model file as URDF, their numbers written anew.

    Each joint that moves has a ``<drive>`` besides, see `joint_drives`. A floating or planar joint
    is fixed, and says so, see `free_joints`.

    Parameters
    ----------
    source : Path or ModelFile
        A URDF, xacro or MJCF file.
    shapes : bool
        Whether the links' collision shapes are read too.

    Raises
    ------
    InvalidInput
        Naming the file and the link or joint at fault.
    """
    return check_robot(read_model(source), path_of(source), shapes=shapes)


def check_robot(robot: XmlElement, path: Path, *, shapes: bool) -> ET.Element:
    """Return `checked_urdf` of a ``<robot>`` that was read from `path`.

    Raises
    ------
    InvalidInput
        As `checked_urdf`.
    """
    checked = ET.Element("robot", name="robot")
    try:
        _check_tree(robot)
        ratios = gear_ratios(robot)
        joints = [_joint(joint, ratios) for joint in elements(robot, "joint")]
        checked.extend([*(_link(link, shapes) for link in robot.findall("link")), *joints])
        _check_free(checked)
        couplings(checked)
    except InvalidInput as error:
        raise InvalidInput(f"{path}: {error}") from None
    return checked


def _check_tree(robot: ET.Element) -> None:
    links = [str(link.get("name")) for link in robot.findall("link")]
    joints = robot.findall("joint")
    if not links:
        raise InvalidInput("it has no <link>")
    if len(links) > MOST_LINKS:
        raise InvalidInput(f"it has {len(links)} links; at most {MOST_LINKS} are read")
    for element in (*robot.findall("link"), *joints):
        name = element.get("name")
        if not name:
            raise InvalidInput(f"a <{element.tag}> has no name")
        if unprintable(name) or "\n" in name:
            raise InvalidInput(f"{element.tag} {name!a}: a name has printable characters only")
    for kind, names in (("link", links), ("joint", [str(j.get("name")) for j in joints])):
        for name, count in Counter(names).items():
            if count > 1:
                raise InvalidInput(f"{kind} {name!r} is there {count} times; names are unique")
    parents: dict[str, str] = {}
    for joint in joints:
        parent, child = (_end(joint, end, links) for end in ("parent", "child"))
        if child in parents:
            raise InvalidInput(f"link {child!r} has two parents; a tree of links is needed")
        parents[child] = parent
    roots = [link for link in links if link not in parents]
    if len(roots) > 1:
        raise InvalidInput(f"links without a parent: {', '.join(roots)}; one root link is needed")
    for start in links:
        link, steps = start, 0
        while link in parents:
            link, steps = parents[link], steps + 1
            if steps > len(links):
                raise InvalidInput(f"link {start!r} is its own ancestor; a tree of links is needed")


def _end(joint: ET.Element, end: str, links: list[str]) -> str:
    who = f"joint {joint.get('name')!r}"
    if joint.get("name") == GROUND:
        raise InvalidInput(f"joint {GROUND!r} has Pinocchio's name for the ground; rename it")
    element = only_child(joint, end, who)
    if element is None:
        raise InvalidInput(f"{who} has no <{end}>")
    link = str(element.get("link"))
    check_word(f"{who}: its {end}", link, links, "is not a link")
    return link


def _joint(joint: XmlElement, ratios: dict[str, float]) -> ET.Element:
    """Return what of a joint matters."""
    who, kind = f"joint {joint.get('name')!r}", joint.get("type")
    free = kind if kind in _FREE else None
    kind = "fixed" if free else kind
    if kind not in _SUPPORTED:
        raise InvalidInput(
            f"{who} {f'is {kind!r}' if kind else 'has no type'}; "
            f"only {', '.join(_SUPPORTED)} joints are supported"
        )
    checked = ET.Element("joint", name=str(joint.get("name")), type=kind)
    if free:
        checked.set("free", free)
    add_origin(checked, joint, who)
    for end in ("parent", "child"):
        ET.SubElement(checked, end, link=str(joint.find(end).get("link")))  # type: ignore[union-attr]
    axis = only_child(joint, "axis", who)
    if kind != "fixed" and axis is not None:
        direction = read_numbers(axis, "xyz", 3, who)
        if math.hypot(*direction) < LEAST_DIRECTION:
            raise InvalidInput(f"{who}: its axis is zero; a direction is needed")
        ET.SubElement(checked, "axis", xyz=number_text(direction))
    if kind in ("revolute", "prismatic"):
        _add_limit(checked, joint, who, kind)
    if kind != "fixed":
        add_drive(checked, joint, ratios.get(str(joint.get("name"))), who)
        add_mimic(checked, joint, who)
    return checked


def free_joints(checked: ET.Element) -> dict[str, str]:
    """Return the floating and planar joints of a checked URDF, and the link that each carries."""
    joints = checked.iterfind("joint[@free]")
    return {str(joint.get("name")): _ends(joint)[1] for joint in joints}


def _check_free(checked: ET.Element) -> None:
    """Refuse floating and planar joints that a moving joint carries."""
    above = {_ends(joint)[1]: joint for joint in checked.iterfind("joint")}
    for joint in checked.iterfind("joint[@free]"):
        carrier = above.get(_ends(joint)[0])
        while carrier is not None:
            if carrier.find("drive") is not None:
                raise InvalidInput(
                    f"joint {joint.get('name')!r} is {joint.get('free')!r} and carried by joint "
                    f"{carrier.get('name')!r}; free joints in the middle are not supported, only "
                    "those of a base, which is held"
                )
            carrier = above.get(_ends(carrier)[0])


def _ends(joint: ET.Element) -> tuple[str, str]:
    parent, child = (str(joint.find(end).get("link")) for end in ("parent", "child"))  # type: ignore[union-attr]
    return parent, child


def _add_limit(checked: ET.Element, joint: ET.Element, who: str, kind: str) -> None:
    limit = only_child(joint, "limit", who)
    if limit is None:
        raise InvalidInput(f"{who} has no <limit>; a {kind} joint needs lower and upper")
    low, high = (read_number(limit, key, who, "0", MOST_LIMIT) for key in ("lower", "upper"))
    if low > high:
        raise InvalidInput(f"{who}: its lower limit {low:g} is above its upper one, {high:g}")
    # Parsers insist on effort and velocity.
    ends = {"lower": repr(low), "upper": repr(high)}
    ET.SubElement(checked, "limit", ends | {"effort": "0", "velocity": "0"})


def _link(link: ET.Element, shapes: bool) -> ET.Element:
    """Return what of a link matters."""
    who = f"link {link.get('name')!r}"
    checked = ET.Element("link", name=str(link.get("name")))
    inertial = only_child(link, "inertial", who)
    if inertial is not None:
        part = ET.SubElement(checked, "inertial")
        add_origin(part, inertial, who)
        mass, inertia = only_child(inertial, "mass", who), only_child(inertial, "inertia", who)
        if mass is None or inertia is None:
            raise InvalidInput(f"{who}: its <inertial> needs <mass> and <inertia>")
        value = read_number(mass, "value", who, most=MOST_MASS)
        if value < 0:
            raise InvalidInput(f"{who} has mass {mass.get('value')} kg; it must not be negative")
        ET.SubElement(part, "mass", value=repr(value))
        entries = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        moments = {key: repr(read_number(inertia, key, who, most=MOST_INERTIA)) for key in entries}
        ET.SubElement(part, "inertia", moments)
    for number, collision in enumerate(link.findall("collision") if shapes else (), start=1):
        shape = _collision(collision, f"{who}: collision shape {number}")
        checked.extend([shape] if shape.find("geometry/capsule") is None else _parts(shape))
    return checked


def _parts(collision: ET.Element) -> list[ET.Element]:
    """Return the cylinder and the two spheres whose union a capsule is; few readers know it."""
    (capsule,) = collision.findall("geometry/capsule")
    radius, length = capsule.get("radius", ""), float(capsule.get("length", ""))
    rotation = Rotation.from_euler("xyz", _triple(collision, "rpy"))
    parts = []
    for tag, offset in (("cylinder", 0.0), ("sphere", length / 2), ("sphere", -length / 2)):
        center = _triple(collision, "xyz") + rotation.apply([0.0, 0.0, offset])
        part = ET.Element("collision")
        entries = {
            "xyz": number_text(center.tolist()),
            "rpy": number_text(_triple(collision, "rpy")),
        }
        ET.SubElement(part, "origin", entries)
        shape = ET.SubElement(ET.SubElement(part, "geometry"), tag, radius=radius)
        if tag == "cylinder":
            shape.set("length", repr(length))
        parts.append(part)
    return parts


def _triple(collision: ET.Element, key: str) -> list[float]:
    origin = collision.find("origin")
    return [0.0] * 3 if origin is None else [float(x) for x in origin.get(key, "").split()]


def _collision(collision: ET.Element, who: str) -> ET.Element:
    checked = ET.Element("collision")
    add_origin(checked, collision, who)
    geometry = only_child(collision, "geometry", who)
    drawn = [] if geometry is None else list(geometry)
    if len(drawn) != 1 or drawn[0].tag not in (*_SHAPES, "mesh"):
        raise InvalidInput(
            f"{who}: <geometry> with a box, cylinder, capsule, sphere or mesh is needed"
        )
    (shape,) = drawn
    part = ET.SubElement(ET.SubElement(checked, "geometry"), shape.tag)
    if shape.tag == "mesh":
        part.set("filename", shape.get("filename", ""))
        part.set("scale", number_text(read_numbers(shape, "scale", 3, who, "1 1 1")))
        return checked
    key, count = _SHAPES[shape.tag]
    for name, size in ((key, count), ("length", 1 if shape.tag in _LONG else 0)):
        lengths = read_numbers(shape, name, size, who, "") if size else []
        if any(length <= 0 for length in lengths):
            raise InvalidInput(f"{who}: <{shape.tag}> has {name}={shape.get(name)!r}; not positive")
        if lengths:
            part.set(name, number_text(lengths))
    return checked
