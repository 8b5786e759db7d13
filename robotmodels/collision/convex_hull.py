"""Convex shapes that enclose the points of a mesh, with few enough faces to compare quickly."""

import coal
import numpy as np
import pinocchio as pin
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput
from robotmodels.description.ranges import MOST_LENGTH

MOST_VERTICES = 500
"""Of a hull that is used as it is."""

_MOST_NEIGHBOURS = 250
"""Of a vertex, as the tip of a cone has; Coal counts to 255."""

_DIRECTIONS = 128
"""Of the planes that enclose a finer one."""

_THINNEST = 1e-3
"""Of the bounding box of what is flat [m]."""


def enclosing_shape(
    points: Array, who: str
) -> tuple[coal.CollisionGeometry, pin.SE3 | None, str | None]:
    """Return a convex shape around the points of a mesh, on the safe side.

    The hull where it has few vertices; a polytope of planes that touch the hull where it has many;
    the bounding box where the points have no hull.

    Parameters
    ----------
    points : ndarray, (n, 3), m
        Vertices of the mesh.
    who : str
        Link and mesh, for errors.

    Returns
    -------
    tuple of (coal.CollisionGeometry, pin.SE3 or None, str or None)
        The shape; its placement in the frame of the mesh, None for the same frame; and what was
        simplified by a box, None for a hull.

    Raises
    ------
    InvalidInput
        If there are no points, or they are not finite numbers of at most 10 km.
    """
    if not (np.isfinite(points).all() and np.abs(points).max(initial=0.0) <= MOST_LENGTH):
        raise InvalidInput(f"{who}: its points are not finite numbers of at most {MOST_LENGTH:g} m")
    if not len(points):
        raise InvalidInput(f"{who}: it has no points")
    try:
        hull = _hull(points)
        neighbours = np.bincount(hull.simplices.ravel()).max()
        if len(hull.vertices) > MOST_VERTICES or neighbours > _MOST_NEIGHBOURS:
            hull = _hull(_enclosing_vertices(points[hull.vertices]))
        return _polytope(hull), None, None
    except (QhullError, ValueError):
        low, high = points.min(axis=0), points.max(axis=0)
        size = np.maximum(high - low, _THINNEST)
        at = pin.SE3(np.eye(3), (low + high) / 2)
        note = "its points lie in a plane or are too few for a hull; its bounding box is used"
        return coal.Box(*map(float, size)), at, note


def _hull(points: Array) -> ConvexHull:
    """Return the hull with triangular faces; points are moved by rounding where faces merge."""
    try:
        return ConvexHull(points, qhull_options="Qt")
    except QhullError:
        if np.linalg.matrix_rank(points - points[0], tol=1e-9 * np.ptp(points)) < 3:
            raise
        return ConvexHull(points, qhull_options="QJ")


def _enclosing_vertices(points: Array) -> Array:
    """Return the vertices of the planes that touch the points, in directions spread evenly.

    Directions are those of a Fibonacci lattice and of the axes (Gonzalez 2010).
    """
    k = np.arange(_DIRECTIONS) + 0.5
    z, angle = 1 - 2 * k / _DIRECTIONS, np.pi * (1 + np.sqrt(5)) * k
    radius = np.sqrt(1 - z**2)
    lattice = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])
    directions = np.vstack([lattice, np.eye(3), -np.eye(3)])
    scale = np.ptp(points, axis=0)  # a plate and a rod become as round as may be
    scaled = points / scale
    offsets = (scaled @ directions.T).max(axis=0)
    planes = np.column_stack([directions, -offsets])
    corners = HalfspaceIntersection(planes, scaled.mean(axis=0)).intersections
    return np.asarray(corners * scale)


def _polytope(hull: ConvexHull) -> coal.Convex:
    """Return a hull in Coal's form, its faces counterclockwise seen from outside."""
    number = np.full(len(hull.points), -1)
    number[hull.vertices] = np.arange(len(hull.vertices))
    corners = hull.points[hull.simplices]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inwards = np.sum(normals * hull.equations[:, :3], axis=1) < 0
    faces = np.where(inwards[:, None], hull.simplices[:, ::-1], hull.simplices)
    points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    points.extend(list(hull.points[hull.vertices]))
    for face in number[faces]:
        triangles.append(coal.Triangle(*map(int, face)))
    return coal.Convex(points, triangles)
