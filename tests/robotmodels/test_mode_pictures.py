from pathlib import Path

import numpy as np
import pytest

import robotmodels
from robotmodels import tool_frame
from robotmodels.elastic.elastic_pose import frame_points, joint_placements
from robotmodels.elastic.mode_pictures import mode_movements
from robotmodels.elastic.rigid_pose import joint_origins


@pytest.fixture(scope="module")
def robot():
    return robotmodels.load_robot(Path(__file__).parents[1] / "engines" / "two_joints.yaml")


POSITION = np.array([-1.2, 0.9])


def test_movements_fit_the_picture_and_the_farthest_is_a_metre(robot):
    modes = mode_movements(robot, POSITION)
    skeleton = joint_origins(robot, POSITION)
    assert modes.movements.shape == (len(modes.frequencies), *skeleton.shape)
    assert np.linalg.norm(modes.movements, axis=2).max(axis=1) == pytest.approx(1, rel=1e-6)
    assert (np.diff(modes.frequencies) >= 0).all()


def test_links_neither_stretch_nor_leave_the_plane_of_two_parallel_joints(robot):
    modes = mode_movements(robot, POSITION)
    skeleton = joint_origins(robot, POSITION)
    bones, changes = np.diff(skeleton, axis=0), np.diff(modes.movements, axis=1)
    stretch = np.einsum("ja,kja->kj", bones, changes)
    assert np.abs(stretch).max() < 2e-3  # the skeleton is drawn with unloaded springs
    axis = np.linalg.svd(modes.movements.reshape(-1, 3))[2][2]
    assert np.abs(modes.movements @ axis).max() < 1e-6


def test_stiffer_springs_raise_the_frequencies(robot):
    values = robot.parameters.values
    stiffer = np.where(["stiffness" in name for name in robot.parameters.names], 4.0, 1.0) * values
    slow, fast = (mode_movements(robot, POSITION, v).frequencies for v in (values, stiffer))
    assert (fast > 1.5 * slow).all()


def test_twists_of_joints_move_their_origins_and_all_beyond_them_alike(robot):
    """The tool is on the last joint, which moves it by its own movement and rotation x arm."""
    modes = mode_movements(robot, POSITION)
    placements = joint_placements(robot, robot.equilibrium(POSITION[None]).coordinates)
    (tool,) = frame_points(robot, tool_frame(robot), placements)
    shifts, turns = modes.twists[:, -1, :3], modes.twists[:, -1, 3:]
    assert shifts == pytest.approx(modes.movements[:, -2], abs=1e-9)
    moved = shifts + np.cross(turns, tool - placements[0, -1, :3, 3])
    assert moved == pytest.approx(modes.movements[:, -1], abs=1e-7)
    assert np.abs(turns).max() > 0.1
