"""The collision shapes of a URDF drawn in a MuJoCo model: seen, but without mass or contact."""

from collections.abc import Callable
from typing import Any

import coal
import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from robotmodels.collision.shapes import Shape, robot_shapes
from robotmodels.elastic.robot import ElasticRobot

_GROUP = 1  # of what viewers show
_MOST_TRIANGLES = 20_000  # of a mesh that is drawn as it is; text of a megabyte
_PRIMITIVES: dict[type, tuple[str, Callable[[Any], Any]]] = {
    coal.Box: ("BOX", lambda box: box.halfSide),
    coal.Sphere: ("SPHERE", lambda ball: [ball.radius, 0, 0]),
    coal.Cylinder: ("CYLINDER", lambda rod: [rod.radius, rod.halfLength, 0]),
    coal.Capsule: ("CAPSULE", lambda rod: [rod.radius, rod.halfLength, 0]),
}


def add_shapes(spec: mujoco.MjSpec, robot: ElasticRobot) -> None:
    """Draw the collision shapes of a robot's links on the bodies of their names.

    Meshes go into the file itself, so that it can be moved; a fine one as its convex hull. A link
    that springs cut carries its shape on the part before the first of them. A URDF without shapes
    draws nothing.
    """
    shapes = robot_shapes(robot)
    bodies = {body.name: body for body in spec.bodies}
    ground = bodies["the root link"]
    for i, shape in enumerate(shapes.shapes if shapes.solid else ()):
        body = bodies.get(shape.link, ground)
        frame = robot.rigid.frames[robot.rigid.getFrameId(shape.link)].placement
        here = frame.actInv(shape.placement)
        geom = body.add_geom(
            name=f"shape {i} of {shape.link}",
            pos=here.translation,
            quat=Rotation.from_matrix(here.rotation).as_quat(scalar_first=True),
            contype=0,
            conaffinity=0,
            group=_GROUP,
            mass=0.0,
        )
        if type(shape.hull) in _PRIMITIVES and shape.mesh is None:
            kind, size = _PRIMITIVES[type(shape.hull)]
            geom.type, geom.size = getattr(mujoco.mjtGeom, f"mjGEOM_{kind}"), size(shape.hull)
        else:
            geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_MESH, f"mesh {i}"
            _add_mesh(spec, geom.meshname, shape)


def _add_mesh(spec: mujoco.MjSpec, name: str, shape: Shape) -> None:
    mesh = spec.add_mesh(name=name, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    surface = shape.mesh
    if surface is None or surface.num_tris > _MOST_TRIANGLES:
        mesh.uservert = np.asarray(shape.hull.points()).ravel()
        return
    triangles = (surface.tri_indices(i) for i in range(surface.num_tris))
    mesh.uservert = np.asarray(surface.vertices()).ravel()
    mesh.userface = np.array([[t[0], t[1], t[2]] for t in triangles]).ravel()
