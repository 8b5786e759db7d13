import itertools
import json

import numpy as np
import pytest
from test_response_data import unpacked

import robotmodels
from reports.figures.map_data import MapData
from reports.sections.design_maps import rejection_words


@pytest.fixture(scope="module")
def content():
    turned = robotmodels.Box("<table>", (0.5, 0.0, 0.2), (0.4, 0.2, 0.1), (0.1, -0.4, 0.7))
    ball = robotmodels.Sphere("ball", (0.0, 1.0, 0.0), 0.25)
    floor = robotmodels.Plane("floor", (0.0, 0.0, 1.0), 0.0)
    rng = np.random.default_rng(0)
    candidates = rng.uniform(-180, 180, (7, 5))
    data = MapData(
        names=("m1 [°]", "m2 [°]", "tool x [m]", "tool y [m]", "tool z [m]"),
        candidates=candidates,
        sensitivity=rng.uniform(0, 1, 7),
        weights=np.array([0, 0.25, 0, 0, 0, 0.75, 0]),
        plan=candidates[:2],
        visits=("1 visit", "2 visits"),
        refused=candidates[2:5],
        reasons=("floor", "arm", "floor"),
        obstacles=(floor, turned, ball),
    )
    words = data.embedded()
    assert words.count("<") == 2  # the tags of the script
    return data, json.loads(words[words.index("{") : words.rindex("}") + 1])


def test_candidates_come_back(content):
    data, words = content
    candidates = unpacked(words["candidates"], data.candidates.shape)
    np.testing.assert_allclose(candidates, data.candidates, atol=5.001e-4)
    sensitivity = unpacked(words["sensitivity"], (7, 1))[:, 0]
    np.testing.assert_allclose(sensitivity, data.sensitivity, atol=2.501e-3)
    assert words["weights"] == {"1": 0.25, "5": 0.75}
    assert [words["reasons"][k] for k in words["reason"]] == list(data.reasons)


def test_obstacles_have_the_box_that_surrounds_them(content):
    data, words = content
    (name, low, high), ball = words["obstacles"]  # no planes
    assert name == "<table>"
    box = data.obstacles[1]
    corners = np.array(list(itertools.product((-1, 1), repeat=3))) * np.array(box.size) / 2
    roll, pitch, yaw = box.rpy
    for angle, (i, j) in ((roll, (1, 2)), (pitch, (2, 0)), (yaw, (0, 1))):  # about x, y, z
        a, b = corners[:, i].copy(), corners[:, j].copy()
        corners[:, i] = np.cos(angle) * a - np.sin(angle) * b
        corners[:, j] = np.sin(angle) * a + np.cos(angle) * b
    corners += box.center
    np.testing.assert_allclose([low, high], [corners.min(0), corners.max(0)], atol=5.001e-4)
    assert ball == ["ball", [-0.25, 0.75, -0.25], [0.25, 1.25, 0.25]]


def test_reasons_of_one_thing_are_together():
    given = "obstacle, 'a' and 'table'; obstacle, 'b' and 'table'; obstacle, 'b' and 'wall'"
    assert rejection_words(given) == "obstacle, a and b with table; obstacle, b with wall"
    assert rejection_words("holding torque, motor 'm1'") == "holding torque, motor m1"
