"""Surfaces of a robot's links as triangles: those that collisions are checked with."""

from dataclasses import dataclass

import coal
import numpy as np
from scipy.spatial import ConvexHull

from robotmodels.collision.shapes import Shape, robot_shapes
from robotmodels.common.arrays import Array, IntArray
from robotmodels.elastic.rigid_pose import joint_origins
from robotmodels.elastic.robot import ElasticRobot

_SLENDERNESS = 0.02
"""Radius of links without shapes, over the length of the chain of joints."""
_SIDES = 24  # of a circle


@dataclass(frozen=True, eq=False)
class LinkSurface:
    """Triangles of one shape of a link.

    Attributes
    ----------
    link : str
        Name of the link.
    joint : int
        Number of the rigid model's joint that moves it, 0 for the ground.
    vertices : ndarray, (v, 3), m
        Corners, in the frame of that joint.
    faces : ndarray of int, (f, 3)
        Corners of each triangle, counter-clockwise from outside.
    """

    link: str
    joint: int
    vertices: Array
    faces: IntArray


def link_surfaces(robot: ElasticRobot) -> tuple[LinkSurface, ...]:
    """Return the surfaces of the links; capsules between the joints where the URDF has no shapes.

    Raises
    ------
    InvalidInput
        If a shape of the URDF cannot be read.
    """
    shapes = robot_shapes(robot)
    if not shapes.solid:
        origins = joint_origins(robot, robot.position_limits.mean(axis=1))
        length = float(np.linalg.norm(np.diff(origins, axis=0), axis=1).sum())
        shapes = robot_shapes(robot, _SLENDERNESS * max(length, 0.1))
    return tuple(_surface(shape) for shape in shapes.shapes)


def _surface(shape: Shape) -> LinkSurface:
    vertices, faces = _mesh(shape.mesh) if shape.mesh is not None else _convex(shape.hull)
    placed = vertices @ shape.placement.rotation.T + shape.placement.translation
    return LinkSurface(shape.link, shape.joint, placed, faces)


def _mesh(mesh: coal.BVHModelBase) -> tuple[Array, IntArray]:
    triangles = (mesh.tri_indices(i) for i in range(mesh.num_tris))
    return np.array(mesh.vertices()), np.array([[t[0], t[1], t[2]] for t in triangles])


def _convex(hull: coal.CollisionGeometry) -> tuple[Array, IntArray]:
    points = _outline(hull)
    convex = ConvexHull(points)
    a, b, c = np.swapaxes(points[convex.simplices], 0, 1)
    inward = np.sum(np.cross(b - a, c - a) * convex.equations[:, :3], axis=1) < 0
    return points, np.where(inward[:, None], convex.simplices[:, ::-1], convex.simplices)


def _outline(hull: coal.CollisionGeometry) -> Array:
    """Return points whose convex hull is the shape, circles taken for polygons."""
    angle = 2 * np.pi * np.arange(_SIDES) / _SIDES
    circle = np.stack([np.cos(angle), np.sin(angle), np.zeros(_SIDES)], axis=1)
    along = np.array([0.0, 0.0, 1.0])
    if isinstance(hull, coal.Box):
        signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
        return np.asarray(signs * hull.halfSide)
    if isinstance(hull, coal.Cylinder):
        rings = [hull.radius * circle + end * hull.halfLength * along for end in (-1, 1)]
        return np.concatenate(rings)
    if isinstance(hull, coal.Sphere | coal.Capsule):
        latitude = np.linspace(-np.pi / 2, np.pi / 2, _SIDES // 2 + 1)
        half = getattr(hull, "halfLength", 0.0)
        rings = [
            hull.radius * (np.cos(u) * circle + np.sin(u) * along) + end * half * along
            for u in latitude
            for end in (-1, 1)
        ]
        return np.unique(np.concatenate(rings).round(9), axis=0)
    return np.array(hull.points())
