import json
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from reports.figures.robot_pictures import scene_of, seen, stick_figure

ARM = np.array([[0.0, 0, 0], [0, 0, 0.5], [0.8, 0, 1.1], [0.8, 0.4, 1.1]])
FOLDED = ARM * [0.3, 0.3, 1.0]


def points(path):
    return np.array([float(v) for v in re.findall(r"-?\d+\.\d+", path)]).reshape(-1, 2)


def test_the_camera_is_a_rotation_that_drops_depth():
    axes = seen(np.eye(3))
    assert axes.T @ axes == pytest.approx(np.eye(2))
    assert axes[2, 1] < 0  # up is up: SVG counts downwards
    assert axes[2, 0] == pytest.approx(0)


def test_pictures_share_a_scene_that_holds_all_of_them():
    scene = scene_of([ARM, FOLDED])
    for skeleton in (ARM, FOLDED):
        root = ET.fromstring(stick_figure(skeleton, scene, "an arm"))
        left, top, width, height = map(float, root.get("viewBox").split())
        for path in root:
            x, y = points(path.get("d")).T
            assert left <= x.min()
            assert x.max() <= left + width
            assert top <= y.min()
            assert y.max() <= top + height
    assert scene.radius > np.hypot(0.8, 0.4)


def test_a_picture_holds_what_turns_it_and_names_what_is_seen():
    root = ET.fromstring(stick_figure(ARM, scene_of([ARM]), 'position "1" <a>'))
    assert root.get("aria-label") == 'position "1" <a>'
    assert json.loads(root.get("data-robot")) == ARM.tolist()
    assert {path.get("class") for path in root} >= {"floor", "shadow", "links", "tool"}
    assert len(str(stick_figure(ARM, scene_of([ARM]), ""))) < 5000


def test_a_robot_that_stands_on_a_point_has_a_floor():
    assert scene_of([np.zeros((2, 3))]).width > 0


def test_an_upright_robot_has_a_picture_that_is_not_much_taller_than_wide():
    upright = np.array([[0.0, 0, 0], [0, 0, 1.0], [0, 0, 2.0]])
    scene = scene_of([upright])
    assert 1.0 < scene.height / scene.width < 1.3
    assert scene.x_min + scene.width / 2 == pytest.approx(0.0, abs=0.01)  # in the middle
