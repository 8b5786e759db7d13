"""Numbers of a model file that look like wrong units, or like placeholders of a template."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator

import numpy as np

from robotmodels.description.model_files import ModelSource, read_model
from robotmodels.description.urdf import rigid_model
from robotmodels.description.urdf_check import checked_urdf, free_joints
from robotmodels.elastic.arm import motions

_FARTHEST, _HEAVIEST, _WIDEST = 30.0, 5000.0, 13.0
"""Of robots: a joint from the one before it [m], a link [kg], a limit of two turns [rad]."""


def doubts_about(source: ModelSource) -> tuple[str, ...]:
    """Return a sentence for each number of a model file that looks like a slip or a placeholder."""
    checked = checked_urdf(source)
    model = rigid_model(source, dict.fromkeys(free_joints(checked), 0.0))
    names = list(model.names)
    doubts = list(_placeholders(checked))
    for joint in range(1, model.njoints):
        far = float(np.linalg.norm(model.jointPlacements[joint].translation))
        if far > _FARTHEST:
            doubts.append(f"joint {names[joint]!r} is {far:g} m from the one before: in mm?")
        if (mass := float(model.inertias[joint].mass)) > _HEAVIEST:
            doubts.append(f"the body moved by joint {names[joint]!r} has {mass:g} kg: in g?")
    for j, motion in enumerate(motions(model), start=1):
        index = model.joints[j].idx_q
        ends = model.lowerPositionLimit[index], model.upperPositionLimit[index]
        widest = max(map(abs, ends))
        if motion[3:].any() and model.joints[j].nq == 1 and _WIDEST < widest < _UNLIMITED:
            doubts.append(
                f"joint {names[j]!r} has limits {ends[0]:g} to {ends[1]:g} rad: in degrees?"
            )
    return (*doubts, *_assumptions(read_model(source)))


def _assumptions(root: ET.Element) -> Iterator[str]:
    """Yield what the conversion of an MJCF took where a URDF has no words for the file's."""
    for joint in root.iterfind("joint"):
        limit = joint.find("limit[@assumed]")
        if limit is not None:
            ends = f"{float(limit.get('lower', '')):g} to {float(limit.get('upper', '')):g} m"
            yield f"joint {joint.get('name')!r} slides without limits: {ends} are taken"
    round_ = [str(link.get("name")) for link in root if link.find(_ELLIPSOID) is not None]
    if round_:
        yield f"links {', '.join(round_)}: boxes stand for ellipsoids, which hold less"


_ELLIPSOID = "collision/geometry/box[@around]"

_UNLIMITED = 1e3
"""Limit that stands for none [rad]."""

_ALIKE = 3
"""Links, one carrying the next, whose mass and inertia are alike in templates only."""


def _placeholders(checked: ET.Element) -> Iterator[str]:
    """Yield what is said of links with a unit inertia, or with that of those that carry them."""
    inertials = {
        str(link.get("name")): tuple(
            sorted(
                f"{key}={value}"
                for part in ("mass", "inertia")
                for key, value in _entries(link, part)
            )
        )
        for link in checked.iterfind("link")
        if link.find("inertial") is not None
    }
    for name, numbers in inertials.items():
        if {"ixx=1.0", "iyy=1.0", "izz=1.0", "ixy=0.0", "ixz=0.0", "iyz=0.0"} <= set(numbers):
            yield f"link {name!r} has an inertia of 1 kg m^2 about every axis: a placeholder?"
    carrier = {_end(joint, "child"): _end(joint, "parent") for joint in checked.iterfind("joint")}
    told: set[tuple[str, ...]] = set()
    for name, numbers in inertials.items():
        alike, link = [name], name
        while (link := carrier.get(link, "")) and inertials.get(link) in (None, numbers):
            alike += [link] if link in inertials else []
        if len(alike) >= _ALIKE and numbers not in told:
            told.add(numbers)
            names = ", ".join(alike[::-1])
            yield f"links {names} have the same mass and inertia: placeholders?"


def _entries(link: ET.Element, part: str) -> list[tuple[str, str]]:
    element = link.find(f"inertial/{part}")
    return [] if element is None else list(element.items())


def _end(joint: ET.Element, end: str) -> str:
    element = joint.find(end)
    return "" if element is None else element.get("link", "")
