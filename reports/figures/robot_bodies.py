"""Pictures of a robot with its links' surfaces, which the page's script draws; lines without."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from markupsafe import Markup

from reports.figures import robot_pictures
from reports.figures.packed_numbers import packed
from robotmodels.collision.shapes import mesh_files, robot_shapes
from robotmodels.collision.simplified_surfaces import simplified_surfaces
from robotmodels.collision.surfaces import link_surfaces
from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.errors import InvalidInput
from robotmodels.elastic.elastic_pose import joint_placements
from robotmodels.elastic.mode_pictures import ModeMovements
from robotmodels.elastic.rigid_pose import joint_origins, unloaded
from robotmodels.elastic.robot import ElasticRobot

MOST = 2000
"""Triangles of a robot on a page; a dozen pictures move together."""

_STEP = 5e-4  # of corners [m]


@dataclass(frozen=True, eq=False)
class Bodies:
    """Surfaces of a robot's links.

    Attributes
    ----------
    vertices : ndarray, (v, 3), m
        Corners of all links, in the frames of their joints.
    joints : ndarray of int, (v,)
        Joint that moves each corner, 0 for the ground.
    faces : ndarray of int, (f, 3)
        Corners of each triangle, counter-clockwise from outside.
    note : str
        What is not drawn and why; empty if all is.
    """

    vertices: Array
    joints: IntArray
    faces: IntArray
    note: str

    def placed(self, placements: Array) -> Array:
        """Return the corners (v, 3) [m] with the joints at placements (joints, 4, 4)."""
        turned = placements[self.joints]
        points = np.einsum("vab,vb->va", turned[:, :3, :3], self.vertices) + turned[:, :3, 3]
        return np.asarray(points)

    def embedded(self) -> Markup:
        """Return the surfaces for a page; nothing where there are none."""
        if not len(self.faces):
            return Markup()
        content = {
            "vertices": packed(self.vertices[None], _STEP, 1),
            "joints": packed(self.joints[None].astype(float), 1.0, 1),
            "faces": packed(self.faces[None].astype(float), 1.0, 1),
            "counts": [len(self.vertices), len(self.faces)],
        }
        words = json.dumps(content, separators=(",", ":"))
        return Markup(f'<script type="application/json" id="robot-bodies">{words}</script>')


@dataclass(frozen=True, eq=False)
class RobotDrawings:
    """Pictures of a robot, one a position, and the surfaces that they share."""

    drawings: list[Markup]
    bodies: Bodies


@lru_cache(maxsize=2)
def bodies(robot: ElasticRobot) -> Bodies:
    """Return the surfaces that collisions are checked with, simplified; or why there are none."""
    try:
        missing = [name for name, file in mesh_files(robot).items() if file is None]
        solid = robot_shapes(robot).solid
        surfaces = simplified_surfaces(link_surfaces(robot), MOST) if solid else ()
        note = f"{robot.model_file.path.name} has no collision shapes" if not missing else ""
    except InvalidInput as error:
        missing, surfaces, note = [], (), str(error)
    if missing:
        note = f"not found: {', '.join(missing)}"
    if not surfaces:
        none = np.zeros((0, 3))
        lines = f"Links are drawn as lines between joints ({note})."
        return Bodies(none, none[:, 0].astype(int), none.astype(int), lines)
    sizes = [len(one.vertices) for one in surfaces]
    first = np.cumsum([0, *sizes[:-1]])
    return Bodies(
        np.concatenate([one.vertices for one in surfaces]),
        np.repeat([one.joint for one in surfaces], sizes),
        np.concatenate([one.faces + k for one, k in zip(surfaces, first, strict=True)]),
        f"Some links are not drawn (meshes {note})." if missing else "",
    )


def robot_drawings(
    robot: ElasticRobot,
    positions: Array,
    alts: Sequence[str],
    *,
    modes: Sequence[ModeMovements] | None = None,
    marks: Sequence[Array] | None = None,
) -> RobotDrawings:
    """Return pictures of the robot in positions (Q, n) [rad or m], springs unloaded.

    Parameters
    ----------
    alts : sequence of str, (Q,)
        What is to be seen.
    modes : sequence of ModeMovements, (Q,), optional
        What can move the pictures.
    marks : sequence of ndarray, (r, 3), m, optional
        Points of each picture to number.
    """
    drawn, positions = bodies(robot), np.asarray(positions)
    skeletons = [joint_origins(robot, position) for position in positions]
    placements = joint_placements(robot, unloaded(robot, positions))
    corners = [drawn.placed(one) for one in placements]
    scene = robot_pictures.scene_of([*skeletons, *corners])
    drawings = [
        robot_pictures.stick_figure(
            skeleton,
            scene,
            alts[q],
            None if marks is None else marks[q],
            None if modes is None else modes[q],
            placements[q] if len(drawn.faces) else None,
        )
        for q, skeleton in enumerate(skeletons)
    ]
    return RobotDrawings(drawings, drawn)
