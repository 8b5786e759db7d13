import numpy as np
import pytest
from collision_arm import arm
from scipy.spatial.transform import Rotation

from oed import TaskBox, gathered_candidates, task_space_positions
from robotmodels import InvalidInput, load_robot
from robotmodels.description.urdf import locate
from robotmodels.simulation.urdf_tree import read_tree

DOWN = (0.0, 0.0, -1.0)


def tool(robot, link, at, position):
    """Return point and axes of a link by plain kinematics."""
    tree = read_tree(locate(robot.file.urdf, robot.folder))
    angles = dict(zip(robot.motor_joints, position, strict=True))
    stack = [(tree.root, Rotation.identity(), np.zeros(3))]
    while stack:
        name, rotation, origin = stack.pop()
        if name == link:
            return origin + rotation.apply(at), rotation.as_matrix()
        for joint in tree.joints[name]:
            turn = Rotation.from_rotvec(angles.get(joint.name, 0.0) * joint.axis)
            there = origin + rotation.apply(joint.position)
            stack.append((joint.child, rotation * joint.rotation * turn, there))
    raise AssertionError(link)


def test_a_planar_arm_has_the_two_elbows_of_the_law_of_cosines(tmp_path):
    robot = arm(tmp_path)
    point, length = (0.5, 0.0, 0.25 + 0.3), np.hypot(0.5, 0.3)
    box = TaskBox("hand", point, point, (1, 1, 1), solutions=4, starts=30)
    found = task_space_positions(robot, box, np.random.default_rng(0))
    elbow = np.arccos((length**2 - 0.5**2 - 0.4**2) / (2 * 0.5 * 0.4))
    # The wrist does not move the hand's own frame and keeps its start.
    assert set(np.round(np.abs(found.positions[:, 1]), 5)) == {np.round(elbow, 5)}
    assert {1.0, -1.0} == set(np.sign(found.positions[:, 1]))


def test_a_ur10_reaches_a_box_pointing_down():
    robot = load_robot("ur10")
    at = (0.0, 0.0, 0.1)
    box = TaskBox("tool0", (0.4, -0.2, 0.2), (0.6, 0.2, 0.4), (2, 1, 1), DOWN, at, solutions=3)
    found = task_space_positions(robot, box, np.random.default_rng(2))
    assert len(found.targets) == 2
    assert not len(found.unreached)
    assert len(found.positions) >= 4
    for position, target in zip(found.positions, found.target, strict=True):
        point, axes = tool(robot, "tool0", at, position)
        np.testing.assert_allclose(point, found.targets[target], atol=2e-6)
        np.testing.assert_allclose(axes[:, 2], DOWN, atol=2e-6)
    low, high = robot.position_limits.T
    assert ((found.positions >= low) & (found.positions <= high)).all()


def test_joints_that_do_not_move_the_tool_keep_no_point_out_of_reach():
    robot = load_robot("ur10")  # the last joints turn about an axis through tool0
    box = TaskBox("tool0", (0.4, -0.3, 0.2), (0.8, 0.3, 0.6), (2, 1, 2))
    found = task_space_positions(robot, box, np.random.default_rng(0))
    assert not len(found.unreached)
    targets = found.targets[found.target]
    for position, target in zip(found.positions[::8], targets[::8], strict=True):
        at = tool(robot, "tool0", (0.0, 0.0, 0.0), position)[0]
        np.testing.assert_allclose(at, target, atol=2e-6)


def test_points_out_of_reach_are_counted(tmp_path):
    robot = arm(tmp_path)
    box = TaskBox("hand", (0.5, 0.0, 0.25), (2.5, 0.0, 0.25), (3, 1, 1), starts=4)
    found = task_space_positions(robot, box, np.random.default_rng(0))
    assert found.unreached.tolist() == [1, 2]
    result = gathered_candidates(robot, boxes=[box])
    assert result.notes[0] == "2 of 3 points of the task box on 'hand' are out of reach"
    far = TaskBox("hand", (5, 0, 0), (5, 0, 0), (1, 1, 1), starts=2)
    with pytest.raises(InvalidInput, match="none of its 1 points is within reach"):
        task_space_positions(robot, far, np.random.default_rng(0))
    unknown = TaskBox("hnd", (0.5, 0, 0.3), (0.5, 0, 0.3), (1, 1, 1))
    with pytest.raises(InvalidInput, match=r"tool: 'hnd' is not a link .*did you mean 'hand'"):
        task_space_positions(robot, unknown, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"low": (0, 0)}, r"task box on 'hand': low is \(0, 0\); three finite numbers"),
        ({"low": (0, 0, 2)}, "low .* is above high"),
        ({"points": (1, 0, 1)}, r"points \(1, 0, 1\); three whole numbers"),
        ({"direction": (0, 0, 0)}, "direction is zero"),
        ({"solutions": 0}, "solutions: 0; a whole number >= 1"),
    ],
)
def test_bad_boxes(entries, message):
    usual = {"low": (0, 0, 0), "high": (1, 1, 1), "points": (2, 2, 2)}
    with pytest.raises(InvalidInput, match=message):
        TaskBox("hand", **(usual | entries))
