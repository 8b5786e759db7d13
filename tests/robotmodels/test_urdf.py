"""URDF files that cannot be used, each refused in one line that names what is at fault."""

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from robots import CRANE, HERE, PANDA, PENDULUM, WALL, built, changed, refusal

from robotmodels import InvalidInput, load_robot
from robotmodels.description.robot_file import RobotFile
from robotmodels.description.urdf import locate, rigid_model
from robotmodels.description.urdf_check import checked_urdf
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.simulation.plant_model import build_plant
from robotmodels.simulation.urdf_tree import read_tree

LAMP = 'ixx="0.02" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.03"'
LOOP = '<joint name="l" type="fixed"><parent link="hand"/><child link="floor"/></joint>'
SECOND = '<joint name="l" type="fixed"><parent link="floor"/><child link="hand"/></joint>'


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("</robot>", "", "edited.urdf: not a well-formed URDF: no element found: line 127"),
        ('type="continuous"', 'type="ball"', "joint 'turn' is 'ball'; only revolute, cont"),
        ('type="continuous"', 'type="planar"', "joint 'turn' leaves link 'column' free to move"),
        ('"nod" type="revolute"', '"nod" type="floating"', "joint 'nod' is 'floating' and carried"),
        ('type="continuous"', "", "joint 'turn' has no type"),
        ('joint name="turn"', "joint", "a <joint> has no name"),
        ('link name="lamp"', "link", "a <link> has no name"),
        ('<parent link="floor"/>', "", "joint 'turn' has no <parent>"),
        (
            'k="floor"/>',
            'k="flor"/>',
            "joint 'turn': its parent 'flor' is not a link (did you mean",
        ),
        (
            '<link name="floor">',
            '<link name="o"/><link name="floor">',
            "without a parent: o, floor;",
        ),
        ('<link name="floor">', LOOP + '<link name="floor">', "link 'floor' is its own ancestor"),
        ('<link name="floor">', SECOND + '<link name="floor">', "link 'hand' has two parents"),
        ('joint name="slide"', 'joint name="turn"', "joint 'turn' is there 2 times"),
        ('link name="lamp"', 'link name="hand"', "link 'hand' is there 2 times"),
        ('<limit effort="100" lower="-2" upper="2.5" velocity="3"/>', "", "'lean' has no <limit>"),
        ('lower="-2"', 'lower="3"', "joint 'lean': its lower limit 3 is above its upper one, 2.5"),
        ('lower="-2"', 'lower="low"', "joint 'lean': <limit> has lower='low'; a number is needed"),
        ('"0 3 4"', '"0 0 0"', "joint 'lean': its axis is zero"),
        ('"0 3 4"', '"0 3"', "joint 'lean': <axis> has xyz='0 3'; 3 numbers are needed"),
        ('rpy="-0.4 0 1.5"', 'rpy="-0.4 0 x"', "joint 'lean': <origin> has rpy='-0.4 0 x'"),
        ('<mass value="8"/>', '<mass value="eight"/>', "link 'boom': <mass> has value='eight'"),
        ('<mass value="8"/>', '<mass value="nan"/>', "link 'boom': <mass> has value='nan'"),
        ('<mass value="8"/>', "", "link 'boom': its <inertial> needs <mass> and <inertia>"),
        ('<mass value="1.5"/>', '<mass value="-1.5"/>', "link 'bracket' has mass -1.5 kg"),
        ('<mass value="3"/>', '<mass value="0"/>', "body moved by joint 'nod' has mass 0 kg; a po"),
        (
            LAMP,
            LAMP.replace("0.03", "0.3", 1),
            "joint 'nod' is not physically consistent: its prin",
        ),
        (
            LAMP,
            LAMP.replace('"0.02"', '"-1"'),
            "joint 'nod' is not physically consistent: its prin",
        ),
        (LAMP, LAMP.replace('ixx="0.02"', ""), "link 'lamp': <inertia> has ixx=''; a number"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, old: str, new: str, message: str) -> None:
    text = (HERE / "crane.urdf").read_text()
    assert old in text
    (tmp_path / "edited.urdf").write_text(text.replace(old, new, 1))
    line = refusal(changed(CRANE, urdf="edited.urdf"), tmp_path)
    assert message in line
    assert "edited.urdf" in line


@pytest.mark.parametrize(
    "spelling", ["8_0", "８", "٨", "8\u00a0", "\u20098", "0x8", "8d0", "8f", "1e999", "inf"]
)
@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('<mass value="8"/>', '<mass value="{}"/>'),
        ('lower="-2"', 'lower="{}"'),
        ('"0 3 4"', '"0 {} 4"'),
        ('ixx="0.02"', 'ixx="{}"'),
        ('rpy="-0.4 0 1.5"', 'rpy="-0.4 {} 1.5"'),
    ],
)
def test_numbers_that_readers_take_differently_are_refused(
    tmp_path: Path, old: str, new: str, spelling: str
) -> None:
    text = (HERE / "crane.urdf").read_text()
    assert old in text
    (tmp_path / "arm.urdf").write_text(text.replace(old, new.format(spelling), 1), encoding="utf-8")
    line = refusal(changed(CRANE, urdf="arm.urdf"), tmp_path)
    assert "needed" in line
    assert spelling in line or ascii(spelling)[1:-1] in line


def test_every_reader_is_handed_the_numbers_that_were_checked(tmp_path: Path) -> None:
    """Spellings that are numbers everywhere: same robot, same plant, same shapes."""
    text = (HERE / "crane.urdf").read_text()
    odd = text.replace('<mass value="8"/>', '<mass value=" +.8E+1\t"/>').replace(
        'rpy="-0.4 0 1.5"', 'rpy="\n -4.e-1   0.0 1.50"'
    )
    assert odd != text
    (tmp_path / "arm.urdf").write_text(odd, encoding="utf-8")
    plain, other = (
        checked_urdf(p, shapes=True) for p in (HERE / "crane.urdf", tmp_path / "arm.urdf")
    )
    assert ET.tostring(plain) == ET.tostring(other)
    for element in other.iter():
        for key, value in element.attrib.items():
            if key not in ("name", "type", "link", "filename"):
                assert [repr(float(part)) for part in value.split(" ")] == value.split(
                    " "
                ) or key in (
                    "effort",
                    "velocity",
                )


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("<robot", '<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><robot', "a <!DOCTYPE>"),
        ("<robot", '<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]><robot', "a <!DOCTYPE>"),
        ("<robot", '<!DOCTYPE r SYSTEM "http://localhost/x.dtd"><robot', "a <!DOCTYPE>"),
        ("<robot", '<?xml version="1.0" encoding="bogus"?><robot', "unknown encoding: bogus"),
        ("<robot", '<?xml version="1.0" encoding="rot13"?><robot', "not a well-formed URDF"),
        ("<robot", '<?xml version="1.0" encoding="utf-16"?><robot', "not a well-formed URDF"),
        ('<mass value="8"/>', "<a>" * 300 + "</a>" * 300, "nested more than 200 deep"),
        ('<mass value="8"/>', '<mass value="8"/><mass value="9"/>', "has 2 <mass>; one at most"),
        ('<mass value="8"/>', '<mass value="1e300"/>', "numbers of at most 1e+09 are needed"),
        ('"0 3 4"', '"0 1e-200 0"', "its axis is zero"),
        ('link name="lamp"', 'link name="la&#x9b;31mmp"', "printable characters only"),
        ('link name="lamp"', 'link name="la&#10;mp"', "printable characters only"),
    ],
)
def test_hostile_xml_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    text = (HERE / "crane.urdf").read_text()
    text = text[text.index("<robot") :]
    assert old in text
    (tmp_path / "arm.urdf").write_text(text.replace(old, new, 1))
    line = refusal(changed(CRANE, urdf="arm.urdf"), tmp_path)
    assert message in line
    assert "arm.urdf" in line
    assert line.isprintable()


def test_long_chains_of_links_are_refused_or_read(tmp_path: Path) -> None:
    def chain(links: int) -> str:
        parts = ['<robot name="chain"><link name="l0"/>']
        for k in range(1, links):
            parts.append(
                f'<link name="l{k}"/><joint name="j{k}" type="fixed"><parent link="l{k - 1}"/>'
                f'<child link="l{k}"/></joint>'
            )
        return "".join(parts) + "</robot>"

    (tmp_path / "chain.urdf").write_text(chain(501))
    assert "501 links; at most 500" in refusal(changed(CRANE, urdf="chain.urdf"), tmp_path)
    (tmp_path / "chain.urdf").write_text(chain(500))
    assert len(read_tree(tmp_path / "chain.urdf").joints) == 500


def test_a_link_that_only_mujoco_refuses_is_named(tmp_path: Path) -> None:
    """Fixed to a heavier link it makes a possible body; on its own it is none."""
    text = (HERE / "crane.urdf").read_text()
    place = text.index('link name="bracket"')
    thin = text[:place] + re.sub(r'ixx="[^"]*"', 'ixx="0.012"', text[place:], count=1)
    (tmp_path / "arm.urdf").write_text(thin)
    content = RobotFile.model_validate(changed(CRANE, urdf="arm.urdf"))
    assert ElasticRobot(content, tmp_path).name == "crane"
    with pytest.raises(InvalidInput, match=r"MuJoCo.* refuses the robot: .*'bracket'"):
        build_plant(content, tmp_path / "arm.urdf")


def test_zero_inertias_are_refused_where_a_motion_moves_no_mass(tmp_path: Path) -> None:
    text = (HERE / "pendulum.urdf").read_text()
    point = text.replace('ixx="0.01"', 'ixx="0"').replace('"0.2"', '"0"')
    (tmp_path / "point.urdf").write_text(point)
    # A point mass beside the hinge is fine ...
    robot = ElasticRobot(RobotFile.model_validate(changed(PENDULUM, urdf="point.urdf")), tmp_path)
    mass = robot.network(np.zeros((1, 1))).mass[0]
    assert mass[0, 0] == pytest.approx(1.0, rel=1e-12)
    # ... one on its axis is not.
    (tmp_path / "point.urdf").write_text(point.replace('xyz="0.5 0 0"', 'xyz="0 0.5 0"'))
    line = refusal(changed(PENDULUM, urdf="point.urdf"), tmp_path)
    assert line.startswith("a motion about 'hinge' moves no mass")


def test_a_joint_that_mimics_another_has_no_motor(tmp_path: Path) -> None:
    text = (HERE / "crane.urdf").read_text()
    coupled = text.replace('"nod" type="revolute">', '"nod" type="revolute"><mimic joint="lean"/>')
    (tmp_path / "coupled.urdf").write_text(coupled)
    content = changed(CRANE, urdf="coupled.urdf")
    line = refusal(content, tmp_path)
    assert line == (
        "joint 'nod' follows 'lean' (mimic) and has neither motor nor drive spring of its own"
    )
    content["motors"] = [m for m in content["motors"] if m["joint"] != "nod"]
    content["springs"] = [
        s for s in content["springs"] if (s.get("joint"), s["axis"]) != ("nod", "drive")
    ]
    robot = ElasticRobot(RobotFile.model_validate(content), tmp_path)
    assert robot.couplings["nod"].leader == "lean"
    plant = build_plant(robot.file, robot.model_file)
    columns = [plant.coordinate(name) for name in ("lean", "nod")]
    assert plant.constraints[:, columns].tolist() == [[-1.0, 1.0]]
    content["lock"] = {"flap": 0.4, "nod": 0.1}
    locked = ElasticRobot(RobotFile.model_validate(content), tmp_path)
    assert locked.locked_followers == {"nod": "lean"}


def test_another_kind_of_xml_is_refused(tmp_path: Path) -> None:
    for name, content, message in (
        ("a.urdf", "<sdf><world/></sdf>", "a.urdf: SDF is not read; convert it to MJCF first (sdf"),
        ("a.sdf", "<sdf/>", "a.sdf: SDF is not read; convert it to MJCF first (sdformat2mjcf"),
        ("a.usda", "#usda", "a.usda: USDA is not read; convert it to a URDF first (usd_to_urdf"),
        ("a.urdf", "<svg/>", "a.urdf: not a URDF: its root is <svg>, not <robot> (nor <mujoco>)"),
    ):
        (tmp_path / name).write_text(content)
        assert message in refusal(changed(CRANE, urdf=name), tmp_path)


def test_a_robot_without_moving_joints_is_refused(tmp_path: Path) -> None:
    text = (HERE / "pendulum.urdf").read_text().replace("revolute", "fixed")
    (tmp_path / "still.urdf").write_text(text)
    line = refusal(changed(PENDULUM, urdf="still.urdf"), tmp_path)
    assert line == "motor 'm': 'hinge' is not a moving joint of the URDF; there are none"


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    line = refusal(changed(CRANE, urdf="nowhere/crane.urdf"), tmp_path)
    assert line == f"model file: {tmp_path}/nowhere/crane.urdf: no such file"
    line = refusal(changed(CRANE, urdf="example-robot-data:ur_description/urdf/ur11_robot.urdf"))
    assert "no such file in example-robot-data (did you mean 'ur_description/urdf/ur1" in line


@pytest.mark.parametrize(
    ("content", "lock", "message"),
    [
        (
            CRANE,
            {"flop": 0.1},
            "lock: 'flop' is not a moving joint of the URDF (did you mean 'flap'",
        ),
        (CRANE, {"boom_bracket": 0.1}, "lock: 'boom_bracket' is not a moving joint"),
        (CRANE, {"flap": 1.5}, "lock: joint 'flap' at 1.5 is outside its limits [-1, 1]"),
        (WALL, {"elbow_joint": 0.1}, "motor 'm3': 'elbow_joint' is held under 'lock'"),
        (
            PANDA,
            {},
            "joints without motor or drive spring: panda_finger_joint1; give each a motor",
        ),
    ],
)
def test_locks_that_cannot_be(content: dict, lock: dict[str, float], message: str) -> None:
    assert message in refusal(changed(content, lock=lock))


def test_meshes_may_be_absent() -> None:
    assert "package://nowhere" in (HERE / "crane.urdf").read_text()
    assert built(CRANE).name == "crane"


def test_whatever_is_drawn_or_drives_a_joint_does_not_matter(tmp_path: Path) -> None:
    """Neither unnamed materials nor limits without effort, which parsers of URDFs refuse."""
    text = (HERE / "crane.urdf").read_text()
    text = text.replace("<visual>", "<visual><material/>").replace(' effort="100"', "")
    (tmp_path / "bare.urdf").write_text(text.replace(' velocity="3"', ""))
    robot = ElasticRobot(RobotFile.model_validate(changed(CRANE, urdf="bare.urdf")), tmp_path)
    positions = np.full((1, 5), 0.1)
    np.testing.assert_array_equal(
        robot.network(positions).mass, built(CRANE).network(positions).mass
    )


def test_what_only_the_parser_minds_is_still_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(xml: str) -> None:
        raise ValueError("no reason")

    monkeypatch.setattr("pinocchio.buildModelFromXML", refuse)
    assert refusal(CRANE).endswith("crane.urdf: not a valid URDF: no reason")


def test_an_empty_robot_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty.urdf").write_text("<robot/>")
    line = refusal(changed(CRANE, urdf="empty.urdf"), tmp_path)
    assert line.endswith("empty.urdf: it has no <link>")


def test_a_continuous_joint_can_be_locked_at_any_angle() -> None:
    path = locate("crane.urdf", HERE)
    placements = [
        rigid_model(path, {"turn": angle, "flap": 0.0}).jointPlacements[1].homogeneous
        for angle in (4.0, 4.0 - 2 * np.pi)
    ]
    np.testing.assert_allclose(placements[0], placements[1], atol=1e-12)


def test_the_robot_file_is_named_too(tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text(
        "schema: robot/1\nname: a\nurdf: b.urdf\n"
        "motors: [{name: m, joint: j, gear_ratio: 1, inertia: 1}]\n"
        "springs: [{name: s, joint: j, axis: drive, stiffness: 1, damping: 1}]\n"
    )
    with pytest.raises(InvalidInput) as error:
        load_robot(path)
    assert str(error.value) == f"{path}: model file: {tmp_path}/b.urdf: no such file"
