from types import SimpleNamespace

import numpy as np
import pytest
from collision_arm import SHAPES, arm, shape

from oed import Workcell, gathered_candidates, screened_candidates
from oed.candidates.grids import repeated_positions
from oed.candidates.screening import reasons
from oed.study.settings.candidates_settings import CandidatesChoice
from oed.study.stage_cache import open_stages
from oed.study.stages.candidates import candidates, gather
from oed.study.stages.run import SimulatedRun
from robotmodels import InvalidInput, Sphere, load_robot, surroundings
from robotmodels.linear.noise import RelativeNoise


def test_counts_by_reason(tmp_path):
    robot = arm(tmp_path)
    positions = np.array(
        [
            [0.0, 0.0, 0.0],
            [0.0, 0.0, 1e-12],  # again
            [0.0, 3.5, 0.0],  # outside
            [-3.5, 0.0, 3.5],  # twice outside
            [np.pi / 2, 0.0, 0.0],  # horizontal: too heavy
            [0.0, 3.0, 0.0],  # folded
            [0.5, 0.5, 0.5],
        ]
    )
    # Held by hand: masses 2 kg, 0.2 m from each joint, links of 0.5 and 0.4 m.
    horizontal = 2 * 9.81 * (0.2 + 0.7 + 1.1) / 100
    result = screened_candidates(
        robot, positions, surroundings(robot), torque_limits=0.999 * horizontal
    )
    assert result.indices.tolist() == [0, 6]
    assert result.proposed == 7
    assert result.removed == {
        "duplicate": 1,
        "joint limits": 2,
        "holding torque": 1,
        "obstacle": 0,
        "self-collision": 1,
    }
    found = {(r.reason, r.what): r.count for r in result.removals}
    assert found["joint limits", "joint 'shoulder'"] == 1
    assert found["joint limits", "joint 'wrist'"] == 1
    assert found["joint limits", "joint 'elbow'"] == 1
    assert found["holding torque", "motor 'm0'"] == 1
    assert found["self-collision", "'lower' and 'hand'"] == 1
    assert str(result) == (
        "2 of 7 candidate positions are left; removed: 2 joint limits, 1 duplicate, "
        "1 holding torque, 1 self-collision"
    )
    more = screened_candidates(robot, positions, torque_limits=1.001 * horizontal)
    assert 4 in more.indices
    assert "collisions are not checked" in more.notes


def test_whole_turns_aside_positions_are_one(tmp_path):
    robot = arm(tmp_path, reach=4.0)
    assert robot.turning.all()
    around = np.array([[0.3, 3.0, -0.2], [0.3, 3.0 - 2 * np.pi, -0.2], [0.3, 3 + 2 * np.pi, -0.2]])
    assert screened_candidates(robot, around).indices.tolist() == [0]
    # Of two that are one, the one inside the limits stays.
    screened = screened_candidates(robot, around[::-1])
    assert screened.indices.tolist() == [1]
    assert screened.removed["joint limits"] == screened.removed["duplicate"] == 1
    rng = np.random.default_rng(0)
    for _ in range(20):
        one = rng.uniform(-np.pi, np.pi, (1, 3))
        turns = 2 * np.pi * rng.integers(-1, 2, (6, 3))
        positions = np.vstack([one, one + turns + rng.uniform(-1e-13, 1e-13, (6, 3))])
        assert repeated_positions(positions, np.ones(3, bool)).tolist() == [False] + 6 * [True]
        # A joint that slides has no turns.
        apart = repeated_positions(positions, np.array([True, True, False]))
        assert apart.sum() == 7 - len({tuple(row) for row in turns[:, 2:]} | {(0.0,)})


def test_a_grid_over_two_turns_is_one_position_for_each_configuration(tmp_path):
    robot = arm(tmp_path, reach=2 * np.pi)
    screened = gathered_candidates(robot, per_joint=3)
    assert (screened.proposed, len(screened), screened.removed["duplicate"]) == (27, 1, 26)
    five = gathered_candidates(robot, per_joint=5)
    assert (len(five), five.removed["duplicate"]) == (8, 117)


def test_degrees_for_radians_are_guessed(tmp_path):
    with pytest.raises(InvalidInput, match=r"joint 'elbow' \(1\); positions are in rad, or m$"):
        screened_candidates(arm(tmp_path), np.array([[0.0, 90.0, 0.0]]))


def test_nothing_left_says_why(tmp_path):
    robot = arm(tmp_path)
    lamp = Sphere("lamp", (0, 0, 0.5), 0.3)
    with pytest.raises(InvalidInput) as caught:
        gathered_candidates(robot, per_joint=3, workcell=Workcell(obstacles=[lamp]))
    assert str(caught.value) == (
        "0 of 27 candidate positions are left; removed: 27 obstacle; "
        "most often obstacle, 'lower' and 'lamp' (27)"
    )


@pytest.mark.parametrize(
    ("positions", "limits", "message"),
    [
        (np.empty((0, 3)), None, r"positions: an array of shape \(0, 3\); \(Q, 3\)"),
        (np.zeros((2, 2)), None, r"one column per motor: m0, m1, m2"),
        (np.full((2, 3), np.nan), None, "position 0 is not finite"),
        (
            np.zeros((1, 3)),
            [1.0, 2.0],
            r"torque_limits: shape \(2,\); one number, or one for each of 3",
        ),
        (np.zeros((1, 3)), [1.0, 0.0, 1.0], "torque_limits of motor 'm1': 0 N m; a positive"),
    ],
)
def test_bad_input(tmp_path, positions, limits, message):
    with pytest.raises(InvalidInput, match=message):
        screened_candidates(arm(tmp_path), positions, torque_limits=limits)


def test_all_sources_at_once(tmp_path):
    robot = arm(tmp_path)
    (tmp_path / "more.csv").write_text("0.1, 0.2, 0.3\n")
    result = gathered_candidates(
        robot, per_joint=2, sobol=5, files=[tmp_path / "more.csv"], workcell=None
    )
    assert len(result) == 8 + 5 + 1
    np.testing.assert_allclose(result.positions[-1], [0.1, 0.2, 0.3])
    default = gathered_candidates(robot)
    assert len(default) == 36  # the usual grid


def test_the_floor_and_the_usual_ur10():
    """A grid of a robot on a table holds positions below it."""
    seen = []
    robot = load_robot("ur10")
    result = gathered_candidates(
        robot,
        sobol=256,
        workcell=Workcell(floor=0.0),
        rng=np.random.default_rng(1),
        progress=lambda done, total: seen.append((done, total)),
    )
    assert result.removed["obstacle"] > 50
    assert result.removed["self-collision"] > 0
    assert seen == [(256, 256)]
    assert any("payload on 'wrist_3_link' has no shape" in note for note in result.notes)


def test_a_robot_without_shapes_or_obstacles_says_what_is_not_checked(tmp_path):
    result = gathered_candidates(arm(tmp_path, {}), per_joint=2, workcell=Workcell())
    assert len(result) == 8
    assert "self-collision is not checked" in result.notes[0]


def test_all_too_heavy_before_anything_is_compared(tmp_path):
    """Only the upright position needs no torque."""
    robot = arm(tmp_path)
    with pytest.raises(InvalidInput, match=r"removed: 2 holding torque; most often .*motor 'm0'"):
        screened_candidates(
            robot, np.array([[1.5, 0, 0], [-1.5, 0, 0]]), surroundings(robot), torque_limits=1e-3
        )


def test_candidates_of_a_study_follow_the_meshes_they_are_checked_with(tmp_path):
    """A taller hand meets the floor in more positions; without a floor nothing is asked of it."""
    hand = shape('<mesh filename="hand.obj"/>')
    robot = arm(tmp_path, SHAPES | {"hand": hand})
    box = "v 0 0 0\nv {0} 0 0\nv 0 {0} 0\nv 0 0 {0}\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"

    def found(size, floor):
        (tmp_path / "hand.obj").write_text(box.format(size))
        per_joint = {"shoulder": 9, "elbow": 5, "wrist": 3}
        choice = CandidatesChoice(per_joint=per_joint, floor=floor, self_collision=False)
        with open_stages(tmp_path / "stages") as stages:
            study, omega, noise = SimpleNamespace(), np.ones(1), RelativeNoise(0.03, 0.01)
            run = SimulatedRun(study, robot, stages, None, robot, choice, omega, noise)
            return candidates(run)

    short, again, tall = (found(size, 0.0) for size in (0.05, 0.05, 0.5))
    assert (short.loaded, again.loaded, tall.loaded) == (False, True, False)
    assert len(tall.value) < len(short.value)
    assert not found(0.5, None).loaded
    assert found(0.1, None).loaded


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"positions": [[0, 0]]}, r"candidates.positions\[0\]: 2 angles; 3 are needed"),
        ({"per_joint": {"elbo": 2}}, "candidates.per_joint: 'elbo' .* mean 'elbow'"),
        ({"limits": {"elbow": (0, 9)}}, "candidates.limits of joint 'elbow'"),
        ({"torque": [1, 2]}, r"candidates.torque: shape \(2,\); one number, or one for each of 3"),
        ({"floor": 0, "link_radius": 1}, "candidates.link_radius: arm.urdf has collision shapes"),
        ({"files": ["taught.csv"]}, "^taught.csv: no such file"),
        ({"torque": 1e-9}, "^0 of 36 candidate positions are left"),
    ],
)
def test_mistakes_in_a_study_name_the_key_of_its_section(given, message, tmp_path):
    with pytest.raises(InvalidInput, match=message):
        gather(CandidatesChoice.model_validate(given), arm(tmp_path))


def test_a_position_is_told_why_it_is_removed():
    robot = load_robot("ur10")
    around = surroundings(robot, floor=0.0)
    up, down = np.array([0, -1.57, 0, 0, 0, 0.0]), np.array([0, 0.6, 0, 0, 0, 0.0])
    assert reasons(robot, up, around) == ()
    with pytest.raises(InvalidInput):
        screened_candidates(robot, down[None], around)
    words = reasons(robot, down, around)
    assert "obstacle, 'forearm_link' and 'floor'" in words
    assert reasons(robot, up, torque_limits=1e-3)[0].startswith("holding torque, motor 'm")
