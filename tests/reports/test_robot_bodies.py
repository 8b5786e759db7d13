import json
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from collision_arm import SHAPES, arm, shape

from reports.figures.robot_bodies import MOST, bodies, robot_drawings
from robotmodels import load_robot
from robotmodels.collision.surfaces import link_surfaces
from robotmodels.elastic.elastic_pose import joint_placements
from robotmodels.elastic.rigid_pose import joint_origins, unloaded

MARKS = np.array([[0.1, 0.2, 0.3], [0.1, 0.2, 0.4], [0.1, 0.2, 0.3]])
POSITION = np.array([0.3, -1.2, 0.9, -0.4, 0.7, 0.2])


@pytest.fixture(scope="module")
def ur10():
    return load_robot("ur10")


def test_surfaces_of_links_lie_where_the_whole_ones_do(ur10):
    drawn = bodies(ur10)
    assert not drawn.note
    assert len(drawn.faces) <= MOST
    (placements,) = joint_placements(ur10, unloaded(ur10, POSITION[None]))
    points = drawn.placed(placements)
    for surface in link_surfaces(ur10):
        at = placements[surface.joint]
        whole = surface.vertices @ at[:3, :3].T + at[:3, 3]
        away = np.linalg.norm(points[:, None] - whole[::20], axis=2).min(axis=0)
        assert away.max() < 0.05  # a corner of what is drawn is near


def test_a_page_has_them_in_few_bytes(ur10):
    words = bodies(ur10).embedded()
    content = json.loads(words.split(">", 1)[1].rsplit("<", 1)[0])
    assert content["counts"] == [len(bodies(ur10).vertices), len(bodies(ur10).faces)]
    assert len(words) < 40_000


def test_pictures_carry_the_placements_of_their_joints(ur10):
    shown = robot_drawings(ur10, POSITION[None], ["the arm"], marks=[MARKS])
    root = ET.fromstring(shown.drawings[0])
    joints = np.array(json.loads(root.get("data-joints")))
    assert joints[1:, :, 3] == pytest.approx(joint_origins(ur10, POSITION)[1:-1], abs=1e-3)
    assert root.get("aria-label") == "the arm"
    assert [one.text for one in root if one.tag == "text"] == ["1, 3", "2", None]


def test_robots_without_shapes_are_lines_and_the_page_says_why():
    robot = load_robot("manutec_r3")
    shown = robot_drawings(robot, np.array([robot.position_limits.mean(axis=1)]), ["an arm"])
    assert "has no collision shapes" in shown.bodies.note
    assert not shown.bodies.embedded()
    assert ET.fromstring(shown.drawings[0]).get("data-joints") is None


@pytest.mark.parametrize(
    ("shapes", "said", "left"),
    [
        (SHAPES, "Some links are not drawn (meshes not found: gone.stl).", True),
        ({}, "Links are drawn as lines between joints (not found: gone.stl).", False),
    ],
)
def test_meshes_that_are_not_there_are_named(tmp_path, shapes, said, left):
    drawn = bodies(arm(tmp_path, shapes | {"hand": shape('<mesh filename="gone.stl"/>')}))
    assert (drawn.note, bool(len(drawn.faces))) == (said, left)


def test_meshes_that_cannot_be_read_leave_lines_with_the_reason(tmp_path):
    (tmp_path / "empty.stl").write_text("")
    drawn = bodies(arm(tmp_path, SHAPES | {"hand": shape('<mesh filename="empty.stl"/>')}))
    assert "empty.stl" in drawn.note
    assert not len(drawn.faces)
