from pathlib import Path

import numpy as np
import pytest
import yaml
from command_line import oed

from oed import Workcell, candidate_positions
from oed.candidates.screening import usable
from oed.study.settings.study_file import load_study
from reports.commands.init_files import default_folder, starter_files, write_starter_files
from reports.commands.init_study import grid_points, noise_floor
from reports.commands.yaml_text import yaml_word
from robotmodels import InvalidInput, builtin_robots, load_robot
from robotmodels.checks.proposed_drives import idle_joints, moving_joints, propose_drives
from robotmodels.common.yaml_reader import read_document

URDF = """\
<robot name="arm">
  <link name="base"/>
  <link name="post"><inertial><origin xyz="0 0 0.2"/><mass value="8"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="beam"><inertial><origin xyz="0.5 0 0"/><mass value="4"/>
    <inertia ixx="0.01" iyy="0.3" izz="0.3" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="slide"><inertial><origin xyz="0 0 0"/><mass value="2"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="left"><inertial><origin xyz="0 0 0"/><mass value="0.1"/>
    <inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="right"><inertial><origin xyz="0 0 0"/><mass value="0.1"/>
    <inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="turn" type="continuous"><parent link="base"/><child link="post"/>
    <axis xyz="0 0 1"/></joint>
  <joint name="yes" type="revolute"><parent link="post"/><child link="beam"/>
    <origin xyz="0 0 0.4"/><axis xyz="0 1 0"/><limit lower="-1.2" upper="0.8"/></joint>
  <joint name="reach out" type="prismatic"><parent link="beam"/><child link="slide"/>
    <origin xyz="1 0 0"/><axis xyz="1 0 0"/><limit lower="0" upper="0.5"/></joint>
  <joint name="finger" type="prismatic"><parent link="slide"/><child link="left"/>
    <axis xyz="0 1 0"/><limit lower="0.01" upper="0.04"/></joint>
  <joint name="thumb" type="prismatic"><parent link="slide"/><child link="right"/>
    <axis xyz="0 1 0"/><limit lower="0" upper="0.04"/><mimic joint="finger"/></joint>
</robot>
"""


@pytest.fixture
def urdf(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(URDF, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "word", ["1e5", ".5", "0o17", "on", "Yes", "null", "2001-12-14", "a:b", "a b"]
)
def test_words_of_files_are_text_in_either_version_of_yaml(word):
    written = yaml_word(word)
    assert read_document(written).content == word
    assert yaml.safe_load(written) == word


def test_joints_of_a_urdf(urdf):
    turn, yes, reach, finger, thumb = moving_joints(urdf)
    assert (turn.low, turn.high, yes.low, yes.high) == pytest.approx(
        (-3.14159265, 3.14159265, -1.2, 0.8)
    )
    assert [j.prismatic for j in (turn, yes, reach, finger)] == [False, False, True, True]
    assert (turn.across, yes.across) == (("x", "y"), ("x", "z"))
    # The slide in the middle of its range, 1.25 m out, fingers 2.2 kg with it.
    about_y = 0.3 + 4 * 0.5**2 + 0.01 + 2e-4 + 2.2 * 1.25**2
    assert yes.load == pytest.approx(about_y, rel=1e-3)
    assert reach.load == pytest.approx(2.2)
    assert (finger.leader, thumb.leader) == (None, "finger")


def test_proposed_drives_resonate_where_robots_do(urdf):
    joints = moving_joints(urdf)[:3]
    for drive, hertz in zip(propose_drives(joints), (8, 14, 20), strict=True):
        load = drive.joint.load
        assert (drive.stiffness / load) ** 0.5 / 6.283185 == pytest.approx(hertz, rel=1e-6)
        assert drive.inertia * drive.gear_ratio**2 == pytest.approx(load)


def test_ranges_of_guesses_hold_the_springs_of_the_built_in_robots():
    offs = []
    for name in builtin_robots():
        robot = load_robot(name)
        springs = {s.joint: s for s in robot.file.springs if s.axis == "drive"}
        joints = [j for j in moving_joints(robot.model_file) if j.name in springs]
        for drive in propose_drives(joints):
            spring = springs[drive.joint.name]
            k = getattr(spring.stiffness, "low", spring.stiffness)
            offs.append(np.log(k / drive.stiffness) / drive.spread)
            offs.append(np.log(spring.damping / drive.damping) / drive.damping_spread)
    off = np.abs(offs)
    assert np.mean(off < 2) > 0.93
    assert np.mean(3 * off < 2) < 0.8  # ranges of a third would not do


def test_a_urdf_becomes_a_robot_and_a_study_that_load(urdf, tmp_path):
    code, out, err = oed("init", urdf, "-o", tmp_path / "new")
    assert (code, err) == (0, "")
    assert "oed check" in out
    robot = load_robot(tmp_path / "new" / "robot.yaml")
    assert robot.motor_joints == ("turn", "yes", "reach out")
    assert set(robot.file.lock) == {"finger", "thumb"}
    assert len(robot.parameters.names) == 6
    text = (tmp_path / "new" / "robot.yaml").read_text(encoding="utf-8")
    assert text.count("# GUESS") == 3 + 3 + 4
    code, out, _ = oed("check", tmp_path / "new" / "robot.yaml")
    assert code == 0
    assert "guesses: 6 lines of" in out
    assert load_study(tmp_path / "new" / "study.yaml").candidates is not None
    study = yaml.safe_load((tmp_path / "new" / "study.yaml").read_text(encoding="utf-8"))
    assert study["robot"] == "robot.yaml"
    low, high = study["candidates"]["limits"]["yes"]
    assert -1.2 < low < high < 0.8


def test_the_torsions_in_comments_can_be_used(urdf, tmp_path):
    starter = starter_files(str(urdf), tmp_path)
    path = tmp_path / "robot.yaml"
    path.write_text(starter.files["robot.yaml"].replace("  # - {", "  - {"), encoding="utf-8")
    assert len(load_robot(path).parameters.names) == 14


def test_a_study_of_a_robot_file_is_named_after_its_folder(tmp_path):
    assert default_folder("arms/my_arm.urdf") == Path("my_arm")
    assert default_folder("ur10") == Path("ur10")
    assert default_folder(str(tmp_path / "welder" / "robot.yaml")) == Path("welder")


def test_nothing_is_overwritten(urdf, tmp_path):
    (tmp_path / "study.yaml").write_text("mine", encoding="utf-8")
    code, out, err = oed("init", urdf, "-o", tmp_path)
    assert (code, out) == (2, "")
    assert "study.yaml is there already" in err
    assert (tmp_path / "study.yaml").read_text(encoding="utf-8") == "mine"
    assert not (tmp_path / "robot.yaml").exists()


@pytest.mark.parametrize("robot", ["moberg_axis1", "absent", "absent.urdf"])
def test_init_of_a_builtin_robot_and_of_none(robot, tmp_path):
    code, out, err = oed("init", robot, "-o", tmp_path / "new one")
    if robot == "moberg_axis1":
        assert code == 0
        assert [p.name for p in (tmp_path / "new one").iterdir()] == ["study.yaml"]
        assert "new one/study.yaml'" in out  # quoted for a shell
    else:
        assert (code, out) == (2, "")
        assert robot in err
        assert not (tmp_path / "new one").exists()


def test_a_file_in_the_way_of_the_folder(urdf, tmp_path):
    (tmp_path / "taken").write_text("", encoding="utf-8")
    with pytest.raises(InvalidInput, match="taken cannot be written to"):
        write_starter_files(starter_files(str(urdf), tmp_path / "taken"), tmp_path / "taken")


def test_grids_stay_small():
    assert grid_points([True]) == [15]
    assert grid_points([False, True]) == [1, 15]
    assert grid_points([False, True, True, True]) == [1, 9, 9, 9]
    assert grid_points([False]) == [1]
    for joints in range(2, 9):
        for first in (True, False):
            points = grid_points([first] + [True] * (joints - 1))
            assert (points[0] == 1) != first
            assert min(points[1:]) >= 2
            assert np.prod(points) <= 1500


def test_joints_that_no_response_depends_on_stay_where_they_are(urdf, tmp_path):
    assert idle_joints(load_robot("manutec_r3")) == ("joint1",)
    assert idle_joints(load_robot("xarm7")) == ()  # a torsion lies below its first joint
    starter = starter_files(str(urdf), tmp_path)
    path = tmp_path / "robot.yaml"
    path.write_text(starter.files["robot.yaml"], encoding="utf-8")
    assert idle_joints(load_robot(path)) == ("turn",)
    path.write_text(starter.files["robot.yaml"].replace("[0.0, 0.0, -9.81]", "[1.0, 0.0, -9.81]"))
    assert idle_joints(load_robot(path)) == ()


@pytest.fixture(scope="module")
def ur10_study(tmp_path_factory):
    path = tmp_path_factory.mktemp("ur10") / "study.yaml"
    path.write_text(starter_files("ur10", path.parent).files["study.yaml"], encoding="utf-8")
    return path


def test_most_positions_proposed_for_a_robot_on_the_floor_are_free_of_collisions(ur10_study):
    study = load_study(ur10_study)
    robot = load_robot("ur10")
    positions = candidate_positions(robot, study.candidates.per_joint, study.candidates.limits)
    cell = Workcell(floor=0.0, margin=study.candidates.margin)
    some = positions[np.random.default_rng(0).choice(len(positions), 100, replace=False)]
    free = usable(robot, some, cell.surroundings(robot)).mean()
    assert free * len(positions) > 500
    # The forearm is 2 cm from the second wrist link by construction, most of the shoulder's
    # turn leads below the floor: both are told.
    content = ur10_study.read_text(encoding="utf-8")
    assert study.candidates.margin < 0.02
    assert "at 0.02 links are too close" in content
    assert "narrower than the joints' own" in content
    whole = dict.fromkeys(robot.motor_joints, (-2.3, 2.3))
    wide = candidate_positions(robot, study.candidates.per_joint, whole)
    assert usable(robot, wide[::13], cell.surroundings(robot)).mean() < 0.7 * free


def test_the_floor_of_the_noise_does_not_bury_heavy_motors(urdf, tmp_path):
    assert noise_floor([4e-4, 4e-5]) == 0.01
    assert noise_floor([6e-3, 6e-6]) == pytest.approx(3e-4)
    content = starter_files(str(urdf), tmp_path).files["study.yaml"]
    assert ("very unlike" in content) == (yaml.safe_load(content)["noise"]["floor"] < 0.01)


def test_a_foundation_takes_several_angles_of_the_first_joint(ur10_study):
    study = yaml.safe_load(ur10_study.read_text(encoding="utf-8"))
    assert study["candidates"]["per_joint"]["shoulder_pan_joint"] >= 3


def test_grids_of_joints_that_turn_more_than_once_repeat_no_angle(ur10_study):
    study = yaml.safe_load(ur10_study.read_text(encoding="utf-8"))
    for joint, (low, high) in study["candidates"]["limits"].items():
        points = np.linspace(low, high, study["candidates"]["per_joint"][joint])
        apart = np.abs(np.exp(1j * points[:, None]) - np.exp(1j * points)) + 9 * np.eye(len(points))
        assert apart.min() > 0.5, joint
