"""A URDF as plain links and joints, read without any robotics library."""

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation


@dataclass(frozen=True, eq=False)
class Inertial:
    """Mass [kg], centre of mass [m] and inertia about it [kg m^2], all in the link frame."""

    mass: float
    com: np.ndarray
    inertia: np.ndarray

    def minus(self, part: "Inertial") -> "Inertial":
        """Return what is left when `part` is taken away (parallel-axis theorem)."""
        mass = self.mass - part.mass
        com = (self.mass * self.com - part.mass * part.com) / mass
        left = self.about_origin() - part.about_origin()
        return Inertial(mass, com, left - _steiner(mass, com))

    def about_origin(self) -> np.ndarray:
        """Return the inertia about the origin of the link frame."""
        return self.inertia + _steiner(self.mass, self.com)


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint and its child link."""

    name: str
    kind: str
    child: str
    position: np.ndarray
    rotation: Rotation
    axis: np.ndarray


@dataclass(frozen=True, eq=False)
class Tree:
    """Links by name, and the joints that each carries."""

    root: str
    inertials: dict[str, Inertial | None]
    joints: dict[str, list[Joint]]


def read_tree(path: Path) -> Tree:
    """Read the kinematics and inertias of a URDF; whatever is drawn or collides is skipped."""
    robot = ET.parse(path).getroot()
    inertials = {str(link.get("name")): _inertial(link) for link in robot.findall("link")}
    joints: dict[str, list[Joint]] = {name: [] for name in inertials}
    children = set()
    for element in robot.findall("joint"):
        parent = str(element.find("parent").get("link"))
        child = str(element.find("child").get("link"))
        position, rotation = _origin(element)
        axis = _numbers(element.find("axis"), "xyz", (1.0, 0.0, 0.0))
        joints[parent].append(
            Joint(
                str(element.get("name")),
                str(element.get("type")),
                child,
                position,
                rotation,
                axis / np.linalg.norm(axis),
            )
        )
        children.add(child)
    (root,) = set(inertials) - children
    return Tree(root, inertials, joints)


def _steiner(mass: float, com: np.ndarray) -> np.ndarray:
    return mass * (com @ com * np.eye(3) - np.outer(com, com))


def _inertial(link: ET.Element) -> Inertial | None:
    element = link.find("inertial")
    if element is None:
        return None
    com, rotation = _origin(element)
    entries = element.find("inertia")
    xx, xy, xz, yy, yz, zz = (
        float(entries.get(k)) for k in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    R = rotation.as_matrix()
    inertia = R @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ R.T
    return Inertial(float(element.find("mass").get("value")), com, inertia)


def _origin(element: ET.Element) -> tuple[np.ndarray, Rotation]:
    origin = element.find("origin")
    # Roll, pitch and yaw turn about fixed axes, in this order.
    rotation = Rotation.from_euler("xyz", _numbers(origin, "rpy", (0.0, 0.0, 0.0)))
    return _numbers(origin, "xyz", (0.0, 0.0, 0.0)), rotation


def _numbers(
    element: ET.Element | None, key: str, default: tuple[float, float, float]
) -> np.ndarray:
    text = None if element is None else element.get(key)
    return np.array(default) if text is None else np.array([float(t) for t in text.split()])
