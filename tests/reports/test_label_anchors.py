"""Numbers of visits in the viewer: none covers another, seen from where the camera starts."""

import numpy as np
import pytest

from reports.viewer.scene import label_anchors

EYE, TARGET = np.array([2.0, -1.5, 1.3]), np.array([0.0, 0.0, 0.4])
SIDE = {"left": (0.0, 1.0), "right": (-1.0, 0.0), "center": (-0.5, 0.5)}
UPRIGHT = {"top": (-1.0, 0.0), "bottom": (0.0, 1.0), "center": (-0.5, 0.5)}
PIXELS = 586.0  # of a radian, on a screen of 900 with viser's angle of view


def box(point, anchor):
    """Return left, right, lower and upper end [px] of a number of two digits, 22 by 17 pixels."""
    forward = (TARGET - EYE) / np.linalg.norm(TARGET - EYE)
    right = np.array([-forward[1], forward[0], 0.0])
    right /= -np.linalg.norm(right) * np.sign(np.cross(forward, right)[2])
    up = np.cross(right, forward)
    x, y = (PIXELS * (point - EYE) @ axis / ((point - EYE) @ forward) for axis in (right, up))
    (low, high), (below, above) = UPRIGHT[anchor.split("-")[0]], SIDE[anchor.split("-")[1]]
    return x + 22 * below, x + 22 * above, y + 17 * low, y + 17 * high


def overlaps(one, other):
    """Return whether two boxes share more than their edges."""
    return all(min(one[k + 1], other[k + 1]) - max(one[k], other[k]) > 1e-6 for k in (0, 2))


def covered(points, anchors):
    boxes = [box(p, a) for p, a in zip(points, anchors, strict=True)]
    return sum(overlaps(boxes[i], boxes[j]) for i in range(len(boxes)) for j in range(i))


def test_the_ends_of_the_axes_are_those_of_the_screen():
    left, right, low, high = box(TARGET, "top-left")
    assert (left, right, low, high) == pytest.approx((0.0, 22.0, -17.0, 0.0), abs=1e-9)
    assert box(TARGET + np.array([0.0, 0.0, 0.1]), "top-left")[3] > 1  # up is up
    assert box(TARGET + np.array([0.0, 0.1, 0.0]), "top-left")[0] > 1  # +y lies on the right


def test_numbers_do_not_cover_each_other():
    rng = np.random.default_rng(4)
    corners = np.array([[0.0, y, z] for y in (-0.5, 0.5) for z in (-0.4, 0.4)])
    for _ in range(20):
        places = TARGET + corners + rng.uniform(-0.1, 0.1, corners.shape)
        behind = EYE + 1.4 * (places - EYE)  # far from the others, but not on the screen
        points = np.concatenate([places, behind, places])
        anchors = label_anchors(points, EYE, TARGET)
        assert covered(points, anchors) == 0
        assert covered(points, ["top-left"] * len(points)) == 3 * len(corners)


def test_numbers_that_are_alone_have_the_same_corner():
    points = TARGET + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.5], [0.0, 0.6, 0.0]])
    assert label_anchors(points, EYE, TARGET) == ["top-left"] * 3
