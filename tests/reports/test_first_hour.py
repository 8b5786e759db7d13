"""URDFs as robots' makers publish them: ``oed init`` writes studies of them that run."""

import importlib.metadata
from pathlib import Path

import numpy as np
import pytest

import oed
from oed.study.settings.study_file import load_study
from oed.study.stages.candidates import gather
from reports.commands.init_files import starter_files, write_starter_files
from reports.commands.init_options import model_options
from robotmodels import InvalidInput, RelativeNoise, linearize, load_robot
from robotmodels.common.yaml_files import parse_yaml
from robotmodels.description.robot_file import RobotFile
from robotmodels.description.urdf import (
    check_moments,
    inconsistency,
    nearest_consistent,
    rigid_model,
)
from robotmodels.linear.modes import resonances

EXAMPLES = "example-robot-data:"
MOMENTS = 'ixx="{0}" iyy="{0}" izz="{0}" ixy="0" ixz="0" iyz="0"'


def link(name, mass=1.0, moment=0.01, inside=""):
    inertia = MOMENTS.format(moment)
    body = f'<inertial><origin xyz="0 0 0.1"/><mass value="{mass}"/><inertia {inertia}/></inertial>'
    return f'<link name="{name}">{body if mass else ""}{inside}</link>'


def joint(name, parent, child, axis="0 1 0", limits=(-1, 1), inside=""):
    return (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0 0.3"/><axis xyz="{axis}"/>'
        f'<limit lower="{limits[0]}" upper="{limits[1]}" effort="1" velocity="1"/>{inside}</joint>'
    )


def urdf(*parts, attributes=""):
    return f'<robot name="arm"{attributes}>{"".join(parts)}</robot>'


ARM = (link("base"), link("post"), link("beam"))
JOINTS = (joint("turn", "base", "post", "0 0 1"), joint("lean", "post", "beam"))


def started(folder, content, name="arm.urdf"):
    """Return what init writes about a URDF, with the robot and the candidates of its study."""
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(content, encoding="utf-8")
    return run_of(str(folder / name), folder / "new")


def run_of(reference, folder):
    starter = starter_files(reference, folder)
    write_starter_files(starter, folder)
    robot = load_robot(folder / "robot.yaml")
    screened = gather(load_study(folder / "study.yaml").candidates, robot)
    linearize(robot, screened.positions[0])
    return starter, robot, screened


@pytest.mark.parametrize(
    ("links", "joints"),
    [
        (("base", "post", "beam"), ("post", "beam")),
        (("base", "post", "beam"), ("beam", "base")),
        (("universe", "post", "world"), ("turn", "lean")),
        (("base", "universe", "beam"), ("base", "universe joint")),
        (("base", "post", "beam"), ("m1", "d2")),
        (("base", "root", "payload"), ("motor1", "m2")),
    ],
)
def test_names_that_clash_with_links_or_invented_names(tmp_path, links, joints):
    names = [link(name) for name in links]
    moving = [joint(joints[0], *links[:2], "0 0 1"), joint(joints[1], *links[1:])]
    _, robot, _ = started(tmp_path, urdf(*names, *moving))
    assert robot.motor_joints == joints
    reference = rigid_model(tmp_path / "arm.urdf", {joints[1]: 0.3})
    assert [f.name for f in reference.frames if "BODY" in str(f.type)] == list(links)
    plain = urdf(*ARM, *JOINTS)
    (tmp_path / "plain.urdf").write_text(plain)
    same = rigid_model(tmp_path / "plain.urdf", {"lean": 0.3})
    assert np.allclose(
        reference.inertias[1].toDynamicParameters(), same.inertias[1].toDynamicParameters()
    )


def test_a_joint_with_the_name_of_the_ground_is_refused_in_one_line(tmp_path):
    content = urdf(*ARM, joint("universe", "base", "post"), JOINTS[1])
    with pytest.raises(InvalidInput, match=r"arm.urdf: joint 'universe' has Pinocchio's name"):
        started(tmp_path, content)


@pytest.mark.parametrize("name", ["arm.URDF", "a:b.urdf"])
def test_names_of_files(tmp_path, name):
    _, robot, _ = started(tmp_path / "in: here", urdf(*ARM, *JOINTS), name)
    assert robot.motor_joints == ("turn", "lean")


def test_a_default_namespace(tmp_path):
    attributes = ' xmlns="https://www.ros.org" xmlns:gazebo="https://gazebosim.org"'
    content = urdf(*ARM, *JOINTS, "<gazebo:plugin/>", attributes=attributes)
    _, robot, _ = started(tmp_path, content)
    assert robot.motor_joints == ("turn", "lean")


def test_more_motors_than_arrays_have_axes(tmp_path):
    names = [f"l{i}" for i in range(41)]
    joints = [
        joint(f"j{i}", names[i], names[i + 1], "1 0 0" if i % 2 else "0 1 0", (-0.1, 0.1))
        for i in range(40)
    ]
    _, robot, screened = started(tmp_path, urdf(*map(link, names), *joints))
    assert len(robot.motor_names) == 40
    assert len(screened) > 30


def test_moments_of_rounding_and_massless_links_are_used(tmp_path):
    check_moments(0.01, np.diag([-5e-20, 0.0, 0.0]), "point")
    check_moments(1e-15, np.diag([-1.8e-22, 0.0, 4.1e-18]), "placeholder")
    with pytest.raises(InvalidInput, match="not physically consistent"):
        check_moments(0.01, np.diag([-5e-9, 0.0, 0.0]), "point")
    wrist = (link("beam", mass=0), link("hand"), joint("nod", "beam", "hand", "1 0 0"))
    _, robot, _ = started(tmp_path, urdf(*ARM[:2], *JOINTS, *wrist))
    assert robot.motor_joints == ("turn", "lean", "nod")
    same_axis = (link("beam", mass=0), link("hand"), joint("nod", "beam", "hand"))
    content = urdf(*ARM[:2], *JOINTS, *same_axis)
    _, robot, _ = started(tmp_path / "regular", content)  # its axes are 0.3 m apart
    tip = urdf(*ARM[:2], link("beam", mass=0), *JOINTS)
    with pytest.raises(InvalidInput, match="moves no mass"):
        started(tmp_path / "singular", tip)


def test_the_nearest_consistent_inertia():
    rounded = np.diag([1.0, 2.0, 3.2])
    assert inconsistency(rounded) == pytest.approx(0.2 / 3.2)
    check_moments(1.0, rounded, "link")
    with pytest.raises(InvalidInput, match=r"the nearest .* = 1\.5, 0, 0, 2\.5, 0, 4"):
        check_moments(1.0, np.diag([1.0, 2.0, 4.0]), "link")
    # By the definition: of all bodies none has nearer second moments.
    wrong = np.diag([-0.5, 1.5, 2.5])
    nearest = nearest_consistent(np.trace(wrong) * np.eye(3) - wrong)
    assert inconsistency(nearest) == pytest.approx(0, abs=1e-12)
    second = np.trace(nearest) / 2 * np.eye(3) - nearest
    distance = np.linalg.norm(second - wrong)
    rng = np.random.default_rng(0)
    for _ in range(2000):
        root = np.sqrt(np.abs(second)) + rng.normal(scale=0.2, size=(3, 3))
        assert np.linalg.norm(root @ root.T - wrong) >= distance - 1e-12


def test_equal_arms_get_equal_springs(tmp_path):
    arms = [
        part
        for side in ("left", "right")
        for part in (
            link(f"{side} upper"),
            link(f"{side} lower"),
            joint(f"{side} shoulder", "base", f"{side} upper"),
            joint(f"{side} elbow", f"{side} upper", f"{side} lower"),
        )
    ]
    _, robot, _ = started(tmp_path, urdf(link("base"), *arms))
    stiffness = {s.joint: s.stiffness for s in robot.file.springs}
    assert stiffness["left shoulder"] == stiffness["right shoulder"]
    assert stiffness["left elbow"] == stiffness["right elbow"]


def test_light_last_axes_resonate_inside_the_band(tmp_path):
    tip = link("beam", 0.001, 1e-7)
    _, robot, screened = started(tmp_path, urdf(*ARM[:2], tip, *JOINTS))
    band = load_study(tmp_path / "new" / "study.yaml").frequencies
    hertz = resonances(linearize(robot, screened.positions[0])).frequencies / (2 * np.pi)
    assert hertz.max() < band.high <= 80


def test_equal_limits_are_told_and_no_false_sentence(tmp_path):
    still = joint("lean", "post", "beam", limits=(0, 0))
    starter, robot, _ = started(tmp_path, urdf(*ARM, JOINTS[0], still))
    assert "joint 'lean' has equal limits and stays where it is" in starter.notes
    assert "lean changes no response" not in starter.files["study.yaml"]
    assert robot.motor_joints == ("turn", "lean")


@pytest.mark.parametrize(
    ("parts", "doubt"),
    [
        ((*ARM, JOINTS[0], joint("lean", "post", "beam", limits=(-90, 90))), "in degrees?"),
        ((*ARM[:2], link("beam", 6000, 60), *JOINTS), "6000 kg: in g?"),
    ],
)
def test_other_units_are_warned_of(tmp_path, parts, doubt):
    starter, _, _ = started(tmp_path, urdf(*parts))
    assert any(doubt in note for note in starter.notes)
    right, _, _ = started(tmp_path / "right", urdf(*ARM, *JOINTS))
    assert not any("in degrees?" in note or "in g?" in note for note in right.notes)


def test_placeholders_of_templates_are_warned_of(tmp_path):
    starter, _, _ = started(tmp_path / "three", urdf(*ARM, *JOINTS))
    assert "links base, post, beam have the same mass and inertia: placeholders?" in starter.notes
    unit = (*ARM[:2], link("beam", 2, 1), *JOINTS)
    starter, _, _ = started(tmp_path / "unit", urdf(*unit))
    assert (
        "link 'beam' has an inertia of 1 kg m^2 about every axis: a placeholder?" in starter.notes
    )
    assert not any("same mass" in note for note in starter.notes)


DYNAMICS = '<dynamics damping="3" friction="7"/>'
GEAR = """<transmission name="t"><joint name="turn"/><actuator name="a">
<mechanicalReduction>-120</mechanicalReduction></actuator></transmission>"""


def test_numbers_of_drives_in_the_file_come_before_guesses(tmp_path):
    drives = (joint("turn", "base", "post", "0 0 1", inside=DYNAMICS), JOINTS[1], GEAR)
    starter, robot, _ = started(tmp_path, urdf(*ARM, *drives))
    turn, lean = robot.file.motors
    assert turn.gear_ratio == -120
    assert turn.viscous * turn.gear_ratio**2 == pytest.approx(3, rel=1e-12)
    assert turn.coulomb * 120 == pytest.approx(7, rel=1e-12)
    assert (lean.gear_ratio, lean.coulomb) == (100, 0)
    text = starter.files["robot.yaml"]
    assert "# GUESS but for gear_ratio, viscous and coulomb" in text
    assert not any("<dynamics>" in note or "<transmission>" in note for note in starter.notes)
    study = starter.files["study.yaml"]
    assert "# torque: [0.0083, 0.01] " in study  # effort 1 N m over 120 and 100
    assert "[120, 100]" in study  # velocity 1 rad/s
    assert any("effort and velocity of <limit>: not used, because" in n for n in starter.notes)


def test_fillers_of_templates_are_no_numbers_of_drives(tmp_path):
    zero = '<dynamics damping="0" friction="0.0"/>'
    drives = (joint("turn", "base", "post", "0 0 1", inside=zero), JOINTS[1])
    one = GEAR.replace("-120", "1.0")
    starter, robot, _ = started(tmp_path, urdf(*ARM, *drives, one))
    assert robot.file.motors[0].gear_ratio == 100
    assert robot.file.motors[0].viscous > 0
    assert any(n.startswith("damping, friction, gear_ratio: not used") for n in starter.notes)


def test_a_part_of_a_robot(tmp_path):
    content = urdf(
        *ARM, link("hand"), link("tool"), *JOINTS, joint("nod", "beam", "hand"),
        joint("bite", "hand", "tool", limits=(0.2, 1)),
    )  # fmt: skip
    (tmp_path / "arm.urdf").write_text(content, encoding="utf-8")
    for words, moving, locked in (
        ({"tip": "beam"}, ("turn", "lean"), {"nod": 0, "bite": 0.2}),
        ({"base": "post"}, ("lean", "nod", "bite"), {"turn": 0}),
        ({"base": "post", "tip": "hand"}, ("lean", "nod"), {"turn": 0, "bite": 0.2}),
        ({"lock": ["lean=0.5", "nod"]}, ("turn", "bite"), {"lean": 0.5, "nod": 0}),
    ):
        starter = starter_files(str(tmp_path / "arm.urdf"), tmp_path, model_options(**words))
        file = parse_yaml(starter.files["robot.yaml"], RobotFile, "robot.yaml")
        assert tuple(motor.joint for motor in file.motors) == moving
        assert file.lock == locked
    for words, message in (
        ({"tip": "bean"}, r"--tip: 'bean' is not a link \(did you mean 'beam'"),
        ({"base": "hand", "tip": "post"}, "--tip: link 'post' does not lie beyond 'hand'"),
        ({"lock": ["lan"]}, "--lock: 'lan' is not a moving joint .did you mean 'lean'"),
        ({"lock": ["lean=up"]}, "--lock: 'lean=up': 'up' is no number"),
        ({"lock": ["lean=3"]}, "joint 'lean' at 3 is outside its limits"),
        ({"base": "tool"}, "no joint moves by itself"),
    ):
        with pytest.raises(InvalidInput, match=message):
            starter_files(str(tmp_path / "arm.urdf"), tmp_path, model_options(**words))


def test_a_free_base_is_held_with_a_word_only(tmp_path):
    float_ = joint("float", "world", "base").replace('"revolute"', '"floating"')
    content = urdf(link("world", mass=0), *ARM, float_, *JOINTS)
    (tmp_path / "arm.urdf").write_text(content, encoding="utf-8")
    refusal = "'float' leaves link 'base' free to move; .* --base base or --lock float"
    for words in ({}, {"tip": "beam"}, {"lock": ["turn"]}):
        with pytest.raises(InvalidInput, match=refusal):
            starter_files(str(tmp_path / "arm.urdf"), tmp_path, model_options(**words))
    for words in ({"base": "base"}, {"lock": ["float"]}, {"base": "base", "tip": "beam"}):
        starter = starter_files(str(tmp_path / "arm.urdf"), tmp_path, model_options(**words))
        file = parse_yaml(starter.files["robot.yaml"], RobotFile, "robot.yaml")
        assert file.lock == {"float": 0}
        assert len(file.motors) == 2


MESH = '<collision><geometry><mesh filename="bad.stl"/></geometry></collision>'


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("none.xml", None, "none.xml: no such file$"),
        ("cut.xml", "<mujoco><worldbody>", "cut.xml: not a well-formed MJCF: "),
        ("cut.xacro", "<robot>", "cut.xacro: not a well-formed xacro file: "),
        ("cut.urdf", "<robot>", "cut.urdf: not a well-formed URDF: "),
        (
            "mesh.urdf",
            urdf(ARM[0], link("post", inside=MESH), JOINTS[0]),
            r"mesh.urdf: link 'post': its mesh cannot be read: .*bad.stl.*; mend the mesh, or",
        ),
        (
            "free.urdf",
            urdf(*ARM[:2], JOINTS[0].replace('"revolute"', '"planar"')),
            "free.urdf: joint 'turn' leaves link 'post' free to move",
        ),
    ],
)
def test_files_that_cannot_be_read_are_named_by_their_kind(tmp_path, name, content, message):
    (tmp_path / "bad.stl").write_text("solid x")
    if content:
        (tmp_path / name).write_text(content)
    with pytest.raises(InvalidInput, match=message) as error:
        starter_files(str(tmp_path / name), tmp_path / "new")
    assert str(error.value).startswith(str(tmp_path))


BOX = '<collision><geometry><box size="0.2 0.2 0.7"/></geometry></collision>'


def test_links_that_always_touch_the_floor_or_each_other(tmp_path):
    """Boxes about the joints' origins: neighbours overlap, the base stands 0.35 m deeper."""
    links = [link(name, inside=BOX) for name in ("base", "post", "beam", "hand")]
    joints = (*JOINTS, joint("nod", "beam", "hand", "1 0 0"))
    starter, _, screened = started(tmp_path, urdf(*links, *joints))
    assert len(screened) >= 0.05 * screened.proposed
    assert "floor: -0.35" in starter.files["study.yaml"]
    assert "ignored:" in starter.files["study.yaml"]
    assert any("not compared" in note for note in starter.notes)


def examples():
    files = importlib.metadata.files("example-robot-data") or []
    return sorted({str(f).split("/robots/")[-1] for f in files if f.suffix == ".urdf"})


_MOST_DESIGNED = 60  # candidates: what a design costs grows with them
_LINES = 20


def designed(folder, robot, screened):
    """Return the plan of a study in some of its candidates, at some lines of its band."""
    study = load_study(folder / "study.yaml")
    band = study.frequencies
    omega = 2 * np.pi * np.geomspace(band.low, band.high, _LINES)
    noise = RelativeNoise(study.noise.relative, study.noise.floor)
    some = screened.positions[:: -(-len(screened) // _MOST_DESIGNED)]
    info = oed.information(robot, some, omega, noise)
    relaxed = oed.optimal_design(info, study.design.criterion, solver="newton")
    return oed.exact_design(info, study.design.experiments, relaxed)


@pytest.mark.parametrize(
    "name", ["so_arm_description/urdf/so100.urdf", "finger_edu.urdf", "kinova.urdf"]
)
def test_studies_of_some_published_robots_run(tmp_path, name):
    _, robot, screened = run_of(EXAMPLES + name, tmp_path)
    assert len(screened) >= 10
    plan = designed(tmp_path, robot, screened)
    assert plan.efficiency > 0.99
    assert np.sqrt(np.diag(np.linalg.inv(plan.information))).max() < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("name", examples())
def test_studies_of_all_published_robots_run_or_say_why_not(tmp_path, name):
    refusal = ""
    try:
        _, robot, screened = run_of(EXAMPLES + name, tmp_path)
    except InvalidInput as error:
        refusal = str(error)
    assert refusal or len(screened) >= 1
    assert "\n" not in refusal
    if not refusal:
        plan = designed(tmp_path, robot, screened)
        assert plan.efficiency > 0.9
        assert np.isfinite(np.linalg.inv(plan.information)).all()
    assert "candidate positions are left" not in refusal
    assert Path(name).name in refusal or not refusal
