"""Convex shapes around meshes: they hold every point, and are not much larger."""

import coal
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from robotmodels import InvalidInput
from robotmodels.collision.convex_hull import MOST_VERTICES, enclosing_shape


def cone(facets):
    angle = 2 * np.pi * np.arange(facets) / facets
    rim = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(facets)])
    return np.vstack([rim, [[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]]])


def ball(count, size):
    points = np.random.default_rng(1).normal(size=(count, 3))
    return size * points / np.linalg.norm(points, axis=1)[:, None]


def distance(shape, point):
    """Distance of a point from a shape, by Coal itself; at most zero inside [m]."""
    sphere, at = coal.Sphere(1e-9), coal.Transform3s(np.eye(3), point)
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    return coal.distance(shape, coal.Transform3s(), sphere, at, request, result)


@pytest.mark.parametrize(
    ("points", "larger"),
    [
        (cone(300), 1.15),
        (cone(40), 1 + 1e-9),
        (ball(3000, np.array([1.0, 1.0, 1.0])), 1.1),
        (ball(3000, np.array([1.0, 0.02, 0.3])), 1.1),
    ],
    ids=["fine cone", "cone", "ball", "blade"],
)
def test_hulls_hold_all_points_and_little_more(points, larger):
    shape, moved, note = enclosing_shape(points, "mesh")
    assert (moved, note) == (None, None)
    assert shape.num_points <= MOST_VERTICES
    rng = np.random.default_rng(0)
    for point in points[rng.choice(len(points), 40, replace=False)]:
        assert distance(shape, point) < 1e-6
    vertices = np.array(shape.points())
    exact = ConvexHull(points).volume
    assert exact * (1 - 1e-9) <= ConvexHull(vertices).volume <= larger * exact
    # Negative control: what lies outside is outside.
    assert distance(shape, points.max(axis=0) + 0.5) > 0.4


def test_what_has_no_hull_gets_its_bounding_box():
    flat = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 2.0, 1.0]])
    shape, moved, note = enclosing_shape(flat, "mesh")
    assert "bounding box" in note
    assert np.allclose(moved.translation, [0.5, 1.0, 1.0])
    assert np.allclose(shape.halfSide, [0.5, 1.0, 5e-4])


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.full((4, 3), np.nan), 1e6 * cone(9)])
def test_points_that_no_mesh_has_are_refused(points):
    with pytest.raises(InvalidInput, match="link 'a': it"):
        enclosing_shape(points, "link 'a'")
