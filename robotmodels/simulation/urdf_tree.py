"""A URDF as plain links and joints, read without any robotics library."""

import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from robotmodels.common.arrays import Array
from robotmodels.common.symmetric_matrices import symmetric_matrix
from robotmodels.description.joint_drives import Coupling, couplings
from robotmodels.description.model_files import ModelSource
from robotmodels.description.urdf_check import checked_urdf


@dataclass(frozen=True, eq=False)
class Inertial:
    """Mass [kg], centre of mass [m] and inertia about it [kg m^2], all in the link frame."""

    mass: float
    com: Array
    inertia: Array

    def minus(self, part: "Inertial") -> "Inertial":
        """Return the inertia of the body without `part` (parallel-axis theorem)."""
        mass = self.mass - part.mass
        com = (self.mass * self.com - part.mass * part.com) / mass
        remainder = self.about_origin() - part.about_origin()
        return Inertial(mass, com, remainder - _steiner(mass, com))

    def about_origin(self) -> Array:
        """Return the inertia about the origin of the link frame."""
        return np.asarray(self.inertia + _steiner(self.mass, self.com))


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint and its child link."""

    name: str
    kind: str
    child: str
    position: Array
    rotation: Rotation
    axis: Array


@dataclass(frozen=True, eq=False)
class Tree:
    """Links by name, the joints that each carries, and those that follow others."""

    root: str
    inertials: dict[str, Inertial | None]
    joints: dict[str, list[Joint]]
    couplings: dict[str, Coupling]


def read_tree(source: ModelSource) -> Tree:
    """Read kinematics and inertias of a model file; whatever is drawn or collides is skipped."""
    robot = checked_urdf(source)
    inertials = {str(link.get("name")): _inertial(link) for link in robot.findall("link")}
    joints: dict[str, list[Joint]] = {name: [] for name in inertials}
    children = set()
    for element in robot.findall("joint"):
        parent, child = (_part(element, end).get("link", "") for end in ("parent", "child"))
        position, rotation = _origin(element)
        axis = _numbers(element.find("axis"), "xyz", (1.0, 0.0, 0.0))
        joints[parent].append(
            Joint(
                element.get("name", ""),
                element.get("type", ""),
                child,
                position,
                rotation,
                axis / np.linalg.norm(axis),
            )
        )
        children.add(child)
    (root,) = set(inertials) - children
    return Tree(root, inertials, joints, couplings(robot))


def _part(element: ET.Element, name: str) -> ET.Element:
    part = element.find(name)
    # Pinocchio has read the file before and refuses one without.
    assert part is not None, f"{element.get('name')} has no {name}"
    return part


def _steiner(mass: float, com: Array) -> Array:
    return np.asarray(mass * (com @ com * np.eye(3) - np.outer(com, com)))


def _inertial(link: ET.Element) -> Inertial | None:
    element = link.find("inertial")
    if element is None:
        return None
    com, rotation = _origin(element)
    entries = _part(element, "inertia")
    names, R = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), rotation.as_matrix()
    inertia = R @ symmetric_matrix(float(entries.get(name, "0")) for name in names) @ R.T
    return Inertial(float(_part(element, "mass").get("value", "0")), com, inertia)


def _origin(element: ET.Element) -> tuple[Array, Rotation]:
    origin = element.find("origin")
    # Roll, pitch and yaw turn about fixed axes, in this order.
    rotation = Rotation.from_euler("xyz", _numbers(origin, "rpy", (0.0, 0.0, 0.0)))
    return _numbers(origin, "xyz", (0.0, 0.0, 0.0)), rotation


def _numbers(element: ET.Element | None, key: str, default: tuple[float, float, float]) -> Array:
    text = None if element is None else element.get(key)
    return np.array(default if text is None else [float(t) for t in text.split()])
