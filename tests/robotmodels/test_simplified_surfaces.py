from dataclasses import replace

import coal
import numpy as np
import pinocchio as pin
import pytest
from collision_arm import volume

from robotmodels import load_robot
from robotmodels.collision.shapes import Shape
from robotmodels.collision.simplified_surfaces import simplified_surfaces
from robotmodels.collision.surfaces import _surface, link_surfaces


@pytest.fixture(scope="module")
def ball():
    return _surface(Shape("link", 1, pin.SE3.Identity(), coal.Sphere(0.2)))


@pytest.mark.parametrize(("most", "away"), [(3000, 0.02), (1500, 0.03), (800, 0.05)])
def test_links_keep_their_shapes_with_fewer_triangles(most, away):
    surfaces = link_surfaces(load_robot("ur10"))
    simple = simplified_surfaces(surfaces, most)
    assert sum(len(one.faces) for one in simple) <= most
    for one, other in zip(surfaces, simple, strict=True):
        assert (other.link, other.joint) == (one.link, one.joint)
        low, high = one.vertices.min(axis=0), one.vertices.max(axis=0)
        assert (low <= other.vertices + 1e-12).all()
        assert (other.vertices <= high + 1e-12).all()
        distance = np.linalg.norm(one.vertices[:, None] - other.vertices, axis=2).min(axis=1)
        assert distance.max() < away


def test_what_is_small_enough_stays_as_it_is(ball):
    (same,) = simplified_surfaces([ball], len(ball.faces))
    assert (same.vertices == ball.vertices).all()
    assert (same.faces == ball.faces).all()


def test_surfaces_inside_out_are_turned(ball):
    (turned,) = simplified_surfaces([replace(ball, faces=ball.faces[:, ::-1])], 10**6)
    assert volume(turned) == pytest.approx(volume(ball))


def test_no_limit_is_too_low_for_an_end(ball):
    (least,) = simplified_surfaces([ball], 0)
    assert 4 <= len(least.faces) < 100


def test_thin_plates_stay_solid():
    plate = _surface(Shape("link", 1, pin.SE3.Identity(), coal.Box(1.0, 1.0, 1e-3)))
    (same,) = simplified_surfaces([plate], 4)
    assert volume(same) == pytest.approx(1e-3)


def test_a_ball_keeps_its_volume(ball):
    (coarse,) = simplified_surfaces([ball], len(ball.faces) // 3)
    assert volume(coarse) == pytest.approx(volume(ball), rel=0.2)  # means of clusters lie inside
