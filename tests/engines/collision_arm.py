"""An arm of plain shapes for the tests of collisions: three joints, their links drawn."""

from pathlib import Path

import numpy as np

from robotmodels import ElasticRobot
from robotmodels.collision.surfaces import LinkSurface
from robotmodels.description.robot_file import RobotFile

_INERTIAL = (
    '<inertial><origin xyz="0 0 0.2"/><mass value="2"/>'
    '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>'
)


def shape(geometry: str, xyz: str = "0 0 0") -> str:
    """Return a ``<collision>`` element."""
    return f'<collision><origin xyz="{xyz}"/><geometry>{geometry}</geometry></collision>'


SHAPES = {
    "base": shape('<box size="0.3 0.3 0.2"/>', "0 0 0.1"),
    "lower": shape('<cylinder radius="0.05" length="0.5"/>', "0 0 0.25"),
    "upper": shape('<cylinder radius="0.04" length="0.4"/>', "0 0 0.2"),
    "hand": shape('<sphere radius="0.08"/>', "0 0 0.15"),
}
ORIGINS = {"shoulder": 0.25, "elbow": 0.5, "wrist": 0.4}  # [m], along the link before


def urdf(shapes: dict[str, str], reach: float = 3) -> str:
    """Return the arm as a URDF; its joints turn about y, and all links point up at zero."""
    links = list(SHAPES)
    text = f'<robot name="arm"><link name="base">{shapes.get("base", "")}</link>'
    for link in links[1:]:
        text += f'<link name="{link}">{_INERTIAL}{shapes.get(link, "")}</link>'
    for (joint, z), parent, child in zip(ORIGINS.items(), links, links[1:], strict=False):
        text += (
            f'<joint name="{joint}" type="revolute"><parent link="{parent}"/>'
            f'<child link="{child}"/><origin xyz="0 0 {z}"/><axis xyz="0 1 0"/>'
            f'<limit lower="{-reach}" upper="{reach}" effort="0" velocity="0"/></joint>'
        )
    return text + "</robot>"


def arm(
    folder: Path, shapes: dict[str, str] = SHAPES, reach: float = 3, **entries: object
) -> ElasticRobot:
    """Return the robot, its URDF written to `folder`."""
    (folder / "arm.urdf").write_text(urdf(shapes, reach))
    joints = list(ORIGINS)
    content = {
        "schema": "robot/1",
        "name": "arm",
        "urdf": "arm.urdf",
        "motors": [
            {"name": f"m{i}", "joint": joint, "gear_ratio": 100, "inertia": 1e-4}
            for i, joint in enumerate(joints)
        ],
        "springs": [
            {"name": f"d{i}", "joint": joint, "axis": "drive", "stiffness": 1e5, "damping": 50}
            for i, joint in enumerate(joints)
        ],
    }
    return ElasticRobot(RobotFile.model_validate(content | entries), folder)


def volume(surface: LinkSurface) -> float:
    """Return the volume that triangles enclose, by Gauss; negative if they face inwards."""
    a, b, c = np.swapaxes(surface.vertices[surface.faces], 0, 1)
    return np.sum(a * np.cross(b, c)) / 6
