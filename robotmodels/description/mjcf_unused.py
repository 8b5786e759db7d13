"""What of an MJCF file its conversion does not use, and why.

The file is taken as MuJoCo writes it again, includes and frames resolved; each attribute in it is
used, moves nothing, or has a reason.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

from robotmodels.description.mjcf_file import resolved_mjcf

_USED = {
    "body": "name pos quat",
    "body/inertial": "pos quat mass diaginertia fullinertia",
    "body/joint": "name type pos axis range limited ref damping armature frictionloss "
    "actuatorfrcrange actuatorfrclimited",
    "body/geom": "name type size pos quat fromto mesh contype conaffinity mass density "
    "shellinertia fitscale",
    "body/site": "name pos quat fromto",
    "equality/joint": "name joint1 joint2 polycoef active",
    "actuator": "name joint gear ctrlrange forcerange ctrllimited forcelimited",
    "option": "gravity",
    "mujoco": "model",
}
"""Attributes that the conversion uses, by element."""

_MOVE_NOTHING = {
    "body/geom": "class rgba material group",
    "body/site": "class rgba material group size type",
    "body/joint": "class group",
    "body": "childclass",
    "actuator": "class group",
    "equality/joint": "class",
    "option": "timestep integrator solver iterations tolerance ls_iterations ls_tolerance cone "
    "jacobian impratio noslip_iterations noslip_tolerance ccd_iterations ccd_tolerance "
    "sdf_iterations sdf_initpoints",
}
_SECTIONS_THAT_MOVE_NOTHING = (
    *("compiler", "size", "visual", "statistic", "asset", "body/camera", "body/light", "custom"),
    "extension",
)

_GROUNDS = ("plane", "hfield")
_SPRINGS = "springs stand in the robot file"
_CONTACT = "contact forces are no part of the model"
_SIMULATION = "settings of MuJoCo's simulation are no part of the model"
_CONTROL = "controllers stand in the experiment"
_REASONS = {
    "body/freejoint": "the body is held where it is",
    "body/joint@type": "the body is held where it is",
    "body/joint@stiffness": _SPRINGS,
    "body/joint@springref": _SPRINGS,
    "body/joint@springdamper": _SPRINGS,
    "body/joint@damping": "of damping only its linear part is used",
    "body/joint": _SIMULATION,
    "body/geom": _CONTACT,
    "body@gravcomp": "compensation of gravity is no part of the model",
    "body": "such elements are no rigid bodies",
    "contact": "pairs of links that may touch stand in the study, under 'ignored'",
    "equality": "couplings are exact",
    "tendon": "tendons are no part of the model",
    "actuator": _CONTROL,
    "sensor": "sensors stand in the robot file",
    "keyframe": "positions stand in the study",
    "option": "air, magnets and flags of MuJoCo are no part of the model",
    "deformable": "flexible bodies are no part of the model",
}
_UNKNOWN = "it is no part of an MJCF that is used here"


def unused_of_mjcf(path: Path) -> Iterator[tuple[str, str, str]]:
    """Yield each unused part of an MJCF file: its path, the name of its owner, the reason.

    Raises
    ------
    InvalidInput
        If MuJoCo refuses the file.
    """
    for section, element in _elements(ET.fromstring(resolved_mjcf(path))):
        if section.startswith(_SECTIONS_THAT_MOVE_NOTHING):
            continue
        name = element.get("name", "")
        if section not in _USED:
            yield section, name, _reason(section)
            continue
        if section == "body/geom" and element.get("type") in _GROUNDS:
            yield section, name, "a floor stands in the study, other surroundings do too"
            continue
        silent = f"{_USED.get(section, '')} {_MOVE_NOTHING.get(section, '')}".split()
        for key, value in element.items():
            free = section == "body/joint" and key == "type" and value == "free"
            part = f"{section}@{key}"
            if key not in silent or free or (key == "damping" and len(value.split()) > 1):
                yield part, name, _reason(part)


def _elements(root: ET.Element) -> Iterator[tuple[str, ET.Element]]:
    """Yield each element with where it stands: bodies nested, and defaults, count as such alone."""
    yield "mujoco", root
    for section in root:
        if section.tag == "worldbody":
            yield from _of_bodies(section)
        elif section.tag == "default":
            yield from _of_defaults(section)
        elif section.tag == "actuator":
            yield from (("actuator", element) for element in section)
        elif section.keys() or not len(section):
            yield section.tag, section
        else:
            yield from ((f"{section.tag}/{element.tag}", element) for element in section)


def _of_bodies(parent: ET.Element) -> Iterator[tuple[str, ET.Element]]:
    for element in parent:
        if element.tag in ("body", "frame"):
            yield "body", element
            yield from _of_bodies(element)
        else:
            yield f"body/{element.tag}", element


_IN_BODIES = ("joint", "geom", "site", "camera", "light")
_IN_ASSETS = ("mesh", "material")


def _of_defaults(default: ET.Element) -> Iterator[tuple[str, ET.Element]]:
    for element in default.iter():
        if element.tag in _IN_BODIES:
            yield f"body/{element.tag}", element
        elif element.tag == "equality":
            yield "equality/joint", element
        elif element.tag in ("pair", "tendon"):
            yield {"pair": "contact/pair"}.get(element.tag, element.tag), element
        elif element.tag != "default" and element.tag not in _IN_ASSETS:
            yield "actuator", element


def _reason(path: str) -> str:
    """Return the reason of the longest path that this one starts with."""
    above = [p for p in _REASONS if path == p or path.startswith((f"{p}/", f"{p}@"))]
    return _REASONS[max(above, key=len)] if above else _UNKNOWN
