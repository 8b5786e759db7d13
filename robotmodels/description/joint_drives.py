"""What a URDF says of the drives of its joints: ratios, friction, rotors, limits, couplings."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass

from robotmodels.common.errors import InvalidInput, nearest
from robotmodels.common.printing import decimal
from robotmodels.description.ranges import MOST_LIMIT
from robotmodels.description.urdf_elements import only_child, read_number
from robotmodels.description.xml_reader import XmlElement

_DYNAMICS = ("damping", "friction", "armature")
_LIMITS = ("effort", "velocity")
_REDUCTIONS = ("mechanicalReduction", "mechanical_reduction")
_MOST_RATIO, _LEAST_RATIO = 1e6, 1e-6
_UNLIMITED = ("inf", "+inf", "infinity")
_MOST = 1e9
"""Of friction and rotors [N m s/rad, N m, kg m^2]."""


@dataclass(frozen=True)
class JointDrive:
    """Numbers of a joint's drive; None where the file has none, or the 0 or 1 of a template.

    Attributes
    ----------
    gear_ratio : float or None
        Reduction of the transmission [-, or rad/m].
    damping, friction : float or None
        On the arm side [N m s/rad, N m; N s/m, N].
    armature : float or None
        Inertia of the rotor, on the arm side [kg m^2, kg].
    effort, velocity : float or None
        Limits on the arm side [N m, rad/s; N, m/s].
    """

    gear_ratio: float | None = None
    damping: float | None = None
    friction: float | None = None
    armature: float | None = None
    effort: float | None = None
    velocity: float | None = None


@dataclass(frozen=True)
class Coupling:
    """A joint that follows another: its angle is multiplier times the leader's, plus offset.

    Attributes
    ----------
    leader : str
        Joint that it follows.
    multiplier : float
        Of the leader's angle or distance.
    offset : float, rad or m
        Added to it.
    """

    leader: str
    multiplier: float
    offset: float


def add_drive(checked: ET.Element, joint: XmlElement, ratio: float | None, who: str) -> None:
    """Add to a checked joint a ``<drive>`` with all that the file says of its drive.

    Raises
    ------
    InvalidInput
        Naming what is not a number, or a friction or rotor below zero.
    """
    numbers = {} if ratio is None else {"gear_ratio": ratio}
    for tag, keys, most in (("dynamics", _DYNAMICS, _MOST), ("limit", _LIMITS, MOST_LIMIT)):
        part = only_child(joint, tag, who)
        if part is None:
            continue
        for key in (key for key in keys if key in part.attrib):
            unlimited = tag == "limit" and part.get(key, "").strip().lower() in _UNLIMITED
            value = 0.0 if unlimited else read_number(part, key, who, "0", most)
            if value < 0:
                raise InvalidInput(f"{who}: its {key} {value:g} is negative; 0 or more is needed")
            numbers[key] = value
    ET.SubElement(checked, "drive", {key: repr(value) for key, value in numbers.items()})


def add_mimic(checked: ET.Element, joint: ET.Element, who: str) -> None:
    """Add to a checked joint what couples it to another one.

    Raises
    ------
    InvalidInput
        Naming what is not a number.
    """
    mimic = only_child(joint, "mimic", who)
    if mimic is not None:
        numbers = {
            key: repr(read_number(mimic, key, who, default))
            for key, default in (("multiplier", "1"), ("offset", "0"))
        }
        ET.SubElement(checked, "mimic", {"joint": str(mimic.get("joint"))} | numbers)


def gear_ratios(robot: XmlElement) -> dict[str, float]:
    """Return the gear ratios of the transmissions that drive one joint each, by joint.

    Of a transmission of several joints, such as a differential, nothing is read.

    Raises
    ------
    InvalidInput
        If a reduction is not a number, or is zero.
    """
    ratios: dict[str, float] = {}
    for transmission in robot.iter("transmission"):
        joints = transmission.findall("joint")
        words = [e for key in _REDUCTIONS for e in transmission.iter(key)]
        if len(joints) != 1 or len(words) != 1 or not isinstance(words[0], XmlElement):
            continue
        name, text = str(joints[0].get("name")), words[0].read_text()
        ratio = decimal(text)
        if not _LEAST_RATIO <= abs(ratio) <= _MOST_RATIO:
            raise InvalidInput(
                f"joint {name!r}: its transmission has {words[0].tag} {text!r}; a number of size "
                f"{_LEAST_RATIO:g} to {_MOST_RATIO:g} is needed"
            )
        ratios[name] = ratio
    return ratios


def joint_drives(checked: ET.Element) -> dict[str, JointDrive]:
    """Return what a checked URDF says of the drive of each joint that moves."""
    return {
        name: JointDrive(**{k: v for k, v in numbers.items() if not _is_filler(k, v)})
        for name, numbers in _drive_numbers(checked)
    }


def drive_fillers(checked: ET.Element) -> dict[str, tuple[str, ...]]:
    """Return which numbers of each joint's drive are those of templates: 0, or a ratio of 1."""
    return {
        name: tuple(k for k, v in numbers.items() if _is_filler(k, v) and k not in _LIMITS)
        for name, numbers in _drive_numbers(checked)
    }


def _drive_numbers(checked: ET.Element) -> Iterator[tuple[str, dict[str, float]]]:
    for joint in checked.iter("joint"):
        if (part := joint.find("drive")) is not None:
            yield str(joint.get("name")), {key: float(value) for key, value in part.items()}


def _is_filler(key: str, value: float) -> bool:
    return abs(value) == 1 if key == "gear_ratio" else value == 0


def couplings(checked: ET.Element) -> dict[str, Coupling]:
    """Return which joints of a checked URDF follow which independent ones (``<mimic>``).

    Raises
    ------
    InvalidInput
        If a leader is not a moving joint, or joints follow each other in a circle.
    """
    direct = dict(_mimics(checked))
    moving = [str(j.get("name")) for j in checked.iter("joint") if j.find("drive") is not None]
    resolved = {}
    for name, coupling in direct.items():
        seen = {name}
        while coupling.leader in direct:
            if coupling.leader in seen:
                raise InvalidInput(f"joint {name!r} mimics itself, by way of {coupling.leader!r}")
            seen.add(coupling.leader)
            above = direct[coupling.leader]
            coupling = Coupling(
                above.leader,
                coupling.multiplier * above.multiplier,
                coupling.multiplier * above.offset + coupling.offset,
            )
        if coupling.leader not in moving:
            raise InvalidInput(
                f"joint {name!r} mimics {coupling.leader!r}, which is not a moving joint"
                f"{nearest(coupling.leader, moving)}"
            )
        resolved[name] = coupling
    return resolved


def _mimics(checked: ET.Element) -> Iterator[tuple[str, Coupling]]:
    for joint in checked.iter("joint"):
        if (mimic := joint.find("mimic")) is not None:
            multiplier, offset = (float(mimic.get(key, "0")) for key in ("multiplier", "offset"))
            yield str(joint.get("name")), Coupling(str(mimic.get("joint")), multiplier, offset)
