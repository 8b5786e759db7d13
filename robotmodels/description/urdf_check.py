"""What of a URDF matters, and mistakes in it that a parser would skip or print to the console."""

import math
import xml.etree.ElementTree as ET
from collections import Counter
from pathlib import Path

from robotmodels.errors import InvalidInput, nearest
from robotmodels.files import reason

_SUPPORTED = ("revolute", "continuous", "prismatic", "fixed")


def checked_urdf(path: Path) -> str:
    """Return the links and joints of a URDF as XML, without what is drawn, collides or drives.

    Raises
    ------
    InvalidInput : naming the file and the link or joint at fault.
    """
    try:
        robot = ET.parse(path).getroot()
    except ET.ParseError as error:
        raise InvalidInput(f"{path}: not a well-formed URDF: {error}") from None
    except OSError as error:
        raise InvalidInput(f"{path}: cannot be read: {reason(error)}") from None
    if robot.tag != "robot":
        raise InvalidInput(f"{path}: not a URDF: its root is <{robot.tag}>, not <robot>")
    if any("xacro" in element.tag for element in robot.iter() if isinstance(element.tag, str)):
        raise InvalidInput(f"{path}: has xacro macros; a URDF in which they are expanded is needed")
    try:
        _check_tree(robot)
        for joint in robot.findall("joint"):
            _check_joint(joint)
        for link in robot.findall("link"):
            _check_link(link)
    except InvalidInput as error:
        raise InvalidInput(f"{path}: {error}") from None
    return ET.tostring(_bare(robot), encoding="unicode")


def mimics(path: Path) -> dict[str, str]:
    """Return which joints of a URDF follow which others (``<mimic>``)."""
    joints = ET.parse(path).getroot().findall("joint")
    found = ((str(j.get("name")), j.find("mimic")) for j in joints)
    return {name: str(mimic.get("joint")) for name, mimic in found if mimic is not None}


def _bare(robot: ET.Element) -> ET.Element:
    bare = ET.Element("robot", name=robot.get("name", "robot"))
    for link in robot.findall("link"):
        element = ET.SubElement(bare, "link", name=str(link.get("name")))
        element.extend(link.findall("inertial"))
    for joint in robot.findall("joint"):
        names = {"name": str(joint.get("name")), "type": str(joint.get("type"))}
        element = ET.SubElement(bare, "joint", names)
        for part in ("origin", "parent", "child", "axis"):
            element.extend(joint.findall(part))
        for limit in joint.findall("limit"):
            bounds = {key: limit.get(key, "0") for key in ("lower", "upper")}
            # The parser insists on effort and velocity, which nothing here needs.
            ET.SubElement(element, "limit", bounds | {"effort": "0", "velocity": "0"})
    return bare


def _check_tree(robot: ET.Element) -> None:
    links = [str(link.get("name")) for link in robot.findall("link")]
    joints = robot.findall("joint")
    if not links:
        raise InvalidInput("it has no <link>")
    for element in (*robot.findall("link"), *joints):
        if not element.get("name"):
            raise InvalidInput(f"a <{element.tag}> has no name")
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
    element = joint.find(end)
    if element is None:
        raise InvalidInput(f"joint {joint.get('name')!r} has no <{end}>")
    link = str(element.get("link"))
    if link not in links:
        raise InvalidInput(
            f"joint {joint.get('name')!r}: its {end} {link!r} is not a link{nearest(link, links)}"
        )
    return link


def _check_joint(joint: ET.Element) -> None:
    who, kind = f"joint {joint.get('name')!r}", joint.get("type")
    if kind not in _SUPPORTED:
        raise InvalidInput(
            f"{who} {f'is {kind!r}' if kind else 'has no type'}; "
            f"only {', '.join(_SUPPORTED)} joints are supported"
        )
    _check_origin(joint, who)
    axis = joint.find("axis")
    if kind != "fixed" and axis is not None and not any(_numbers(axis, "xyz", 3, who)):
        raise InvalidInput(f"{who}: its axis is zero; a direction is needed")
    if kind in ("revolute", "prismatic"):
        limit = joint.find("limit")
        if limit is None:
            raise InvalidInput(f"{who} has no <limit>; a {kind} joint needs lower and upper")
        low, high = (_number(limit, key, who, "0") for key in ("lower", "upper"))
        if low > high:
            raise InvalidInput(f"{who}: its lower limit {low:g} is above its upper one, {high:g}")


def _check_link(link: ET.Element) -> None:
    inertial = link.find("inertial")
    if inertial is None:
        return
    who = f"link {link.get('name')!r}"
    _check_origin(inertial, who)
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    if mass is None or inertia is None:
        raise InvalidInput(f"{who}: its <inertial> needs <mass> and <inertia>")
    if _number(mass, "value", who) < 0:
        raise InvalidInput(f"{who} has mass {mass.get('value')} kg; it must not be negative")
    for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"):
        _number(inertia, key, who)


def _check_origin(element: ET.Element, who: str) -> None:
    origin = element.find("origin")
    if origin is not None:
        for key in ("xyz", "rpy"):
            _numbers(origin, key, 3, who)


def _number(element: ET.Element, key: str, who: str, default: str = "") -> float:
    (value,) = _numbers(element, key, 1, who, default)
    return value


def _numbers(
    element: ET.Element, key: str, count: int, who: str, default: str = "0 0 0"
) -> list[float]:
    text = element.get(key, default)
    try:
        values = [float(part) for part in text.split()]
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)):
        raise InvalidInput(
            f"{who}: <{element.tag}> has {key}={text!r}; "
            f"{'a number is' if count == 1 else f'{count} numbers are'} needed"
        )
    return values
