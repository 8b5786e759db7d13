"""xacro files: arguments, packages in folders, mistakes in one line."""

import sys

import pytest

from reports.commands.init_files import starter_files, write_starter_files
from reports.commands.init_options import model_options
from robotmodels import InvalidInput, load_robot, save_robot
from robotmodels.description.model_files import ModelFile, model_digest, read_model
from robotmodels.library.robot_digest import robot_digest

XACRO = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
BODY = f"""\
<robot {XACRO}>
  <xacro:macro name="body" params="name mass"><link name="${{name}}"><inertial>
    <mass value="${{mass}}"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>
  </inertial></link></xacro:macro>
</robot>
"""
JOINT = f"""\
<robot {XACRO}>
  <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/>
    <axis xyz="0 1 0"/><limit lower="${{-pi / 2}}" upper="1" effort="5" velocity="3"/></joint>
</robot>
"""
ARM = f"""\
<robot name="arm" {XACRO}>
  <xacro:arg name="mass" default="2"/>
  <xacro:include filename="$(find arm_parts)/urdf/body.xacro"/>
  <xacro:include filename="parts/joint.xacro"/>
  <xacro:body name="base" mass="1"/><xacro:body name="arm" mass="$(arg mass)"/>
</robot>
"""


@pytest.fixture
def arm(tmp_path):
    package = tmp_path / "ros" / "cloned"
    (package / "urdf").mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>arm_parts</name></package>")
    (package / "urdf" / "body.xacro").write_text(BODY)
    (tmp_path / "mine" / "parts").mkdir(parents=True)
    (tmp_path / "mine" / "parts" / "joint.xacro").write_text(JOINT)
    path = tmp_path / "mine" / "arm.urdf.xacro"
    path.write_text(ARM)
    return path


def masses(model):
    return [float(mass.get("value")) for mass in read_model(model).iter("mass")]


def test_arguments_and_packages(arm, tmp_path):
    folders = (tmp_path / "ros",)
    assert masses(ModelFile(arm, (), folders)) == [1, 2]
    assert masses(ModelFile(arm, (("mass", "7.5"),), folders)) == [1, 7.5]
    # A package lies around the file as well.
    (tmp_path / "ros" / "cloned").rename(tmp_path / "arm_parts")
    assert masses(arm) == [1, 2]


def test_init_keeps_arguments_and_the_robot_file_expands_anew(arm, tmp_path):
    options = model_options(["mass:=7.5"], [tmp_path / "ros"])
    write_starter_files(starter_files(str(arm), tmp_path / "new", options), tmp_path / "new")
    robot = load_robot(tmp_path / "new" / "robot.yaml")
    assert robot.name == "arm"
    assert robot.rigid.inertias[1].mass == 7.5
    (tmp_path / "other").mkdir()
    save_robot(robot, tmp_path / "other" / "robot.yaml")
    again = load_robot(tmp_path / "other" / "robot.yaml")
    assert robot_digest(again) == robot_digest(robot)
    text = (tmp_path / "new" / "robot.yaml").read_text().replace("7.5", "8")
    (tmp_path / "new" / "robot.yaml").write_text(text)
    changed = load_robot(tmp_path / "new" / "robot.yaml")
    assert changed.rigid.inertias[1].mass == 8
    assert robot_digest(changed) != robot_digest(robot)


def test_a_changed_included_file_is_noticed(arm, tmp_path):
    model = ModelFile(arm, (), (tmp_path / "ros",))
    before = model_digest(model)
    assert model_digest(model) == before
    (tmp_path / "mine" / "parts" / "joint.xacro").write_text(
        JOINT.replace('"1" effort', '"1.5" effort')
    )
    assert model_digest(model) != before


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("", "", "needs the package 'arm_parts', which is neither around the file nor in a folder"),
        ("$(find arm_parts)/urdf", "nowhere", "cannot be expanded: .*nowhere/body.xacro"),
        (' default="2"', "", "'mass' has no value: --argument mass=VALUE, or under 'xacro"),
        ("$(arg mass)", "$(arg weight)", "'weight' has no value: --argument weight=VALUE"),
        ("$(arg mass)", "${1 / 0}", "cannot be expanded: .*division by zero"),
        ("<xacro:body ", "<xacro:bodi ", "cannot be expanded: .*bodi"),
    ],
)
def test_mistakes_are_one_line(arm, tmp_path, old, new, message):
    arm.write_text(ARM.replace(old, new) if old else ARM)
    folders = (tmp_path / "ros",) if old else ()
    with pytest.raises(InvalidInput, match=message) as error:
        read_model(ModelFile(arm, (), folders))
    assert str(error.value).startswith(str(arm))
    assert "\n" not in str(error.value)


def test_wrong_options_are_named(arm, tmp_path):
    folders = (tmp_path / "ros",)
    with pytest.raises(InvalidInput, match=r"'mas' is not an argument .*did you mean 'mass'"):
        read_model(ModelFile(arm, (("mas", "7"),), folders))
    with pytest.raises(InvalidInput, match=r"packages: .*gone: no such folder"):
        read_model(ModelFile(arm, (), (tmp_path / "gone",)))
    plain = tmp_path / "plain.urdf"
    plain.write_text('<robot name="a"><link name="l"/></robot>')
    with pytest.raises(InvalidInput, match="is a URDF without macros; 'xacro' and its arguments"):
        read_model(ModelFile(plain, (("mass", "7"),)))
    assert model_options(["mass=7"]) == model_options(["mass:=7"])
    assert model_options(["a=b:=c"]).arguments == (("a", "b:=c"),)
    with pytest.raises(InvalidInput, match="--argument: 'mass' is not of the form NAME=VALUE"):
        model_options(["mass"])
    with pytest.raises(InvalidInput, match="--lock, --tip, --base and xacro's are of model files"):
        starter_files("ur10", tmp_path, model_options(["mass:=7"]))


def test_without_xacrodoc_the_command_that_installs_it_is_named(arm, monkeypatch):
    monkeypatch.setitem(sys.modules, "xacrodoc", None)
    with pytest.raises(InvalidInput, match=r"run: pip install 'elastic-robot-oed\[xacro\]'"):
        read_model(arm)
