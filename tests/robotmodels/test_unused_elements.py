"""All of a URDF is used or listed as not used: attributes are changed, elements added."""

import importlib.metadata
import xml.etree.ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest

from robotmodels import InvalidInput
from robotmodels.description import unused_elements
from robotmodels.description.joint_drives import JointDrive, couplings, joint_drives
from robotmodels.description.unused_elements import unused_parts
from robotmodels.description.urdf import rigid_model
from robotmodels.description.urdf_check import checked_urdf

RICH = """\
<robot name="arm">
  <material name="red"><color rgba="1 0 0 1"/></material>
  <link name="base"/>
  <link name="post">
    <inertial><origin xyz="0 0.1 0.2" rpy="0.1 0.2 0.3"/><mass value="8"/>
      <inertia ixx="0.1" iyy="0.12" izz="0.11" ixy="0.01" ixz="0.02" iyz="0.01"/></inertial>
    <visual><geometry><mesh filename="post.stl"/></geometry><material name="red"/></visual>
    <collision name="c"><origin xyz="0 0 0.1" rpy="0 0 1"/>
      <geometry><cylinder radius="0.1" length="0.4"/></geometry></collision>
    <collision><geometry><box size="1 2 3"/></geometry></collision>
    <collision><geometry><capsule radius="0.1" length="0.4"/></geometry></collision>
    <collision><geometry><mesh filename="a.stl" scale="2 1 1"/></geometry></collision>
    <contact><stiffness value="3"/><damping value="4"/></contact>
    <self_collide/>
  </link>
  <link name="beam">
    <inertial><origin xyz="0.5 0 0"/><mass value="4"/>
      <inertia ixx="0.01" iyy="0.3" izz="0.3" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="finger">
    <inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="post"/>
    <origin xyz="0 0 0.4" rpy="0 0 0.2"/><axis xyz="0 0.1 1"/>
    <limit lower="-1.2" upper="0.8" effort="150" velocity="2" current="4"/>
    <dynamics damping="2.5" friction="4" armature="0.5" stiffness="8"/>
    <safety_controller soft_lower_limit="-1" soft_upper_limit="1" k_position="5" k_velocity="3"/>
    <calibration rising="0.1"/></joint>
  <joint name="yes" type="continuous"><parent link="post"/><child link="beam"/>
    <axis xyz="0 1 0"/></joint>
  <joint name="grip" type="prismatic"><parent link="beam"/><child link="finger"/>
    <origin xyz="1 0 0"/><axis xyz="1 0 0"/>
    <limit lower="0.01" upper="0.1" effort="5" velocity="1"/>
    <mimic joint="yes" multiplier="0.03" offset="0.01"/></joint>
  <transmission name="t1"><type>transmission_interface/SimpleTransmission</type>
    <joint name="turn"><hardwareInterface>EffortJointInterface</hardwareInterface>
      <offset>0.2</offset></joint>
    <actuator name="a1"><mechanicalReduction>-120</mechanicalReduction></actuator></transmission>
  <transmission name="t2"><joint name="yes"/><joint name="grip"/>
    <actuator name="a2"><mechanicalReduction>50</mechanicalReduction></actuator></transmission>
  <gazebo reference="turn"><springStiffness>3</springStiffness></gazebo>
</robot>
"""


def paths(root):
    """Return each element below the root with its path."""
    below = [(child.tag, child) for child in root]
    for path, element in below:
        below += [(f"{path}/{child.tag}", child) for child in element]  # grows while it is read
    return below


def attributes(root):
    """Return each attribute, and each text with key None, below the root."""
    places = [(path, element, key) for path, element in paths(root) for key in element.attrib]
    return places + [(p, e, None) for p, e in paths(root) if (e.text or "").strip()]


def other(value):
    """Return another value of the same kind."""
    try:
        return " ".join(repr(1.013 * float(word) + 0.001) for word in value.split())
    except ValueError:
        return value + "x"


def listed(path, key, parts):
    whole = path if key is None else f"{path}@{key}"
    return any(
        whole == p.path or whole.startswith((f"{p.path}/", f"{p.path}@")) for p in parts
    ) or unused_elements._below(whole, unused_elements._DRAWN)


def outcome(path, read):
    try:
        return read(path)
    except InvalidInput as error:
        return str(error)


def text_of(path):
    return ET.tostring(checked_urdf(path, shapes=True), encoding="unicode")


@pytest.fixture
def arm(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(RICH, encoding="utf-8")
    return path


def test_every_attribute_is_read_or_listed(arm):
    root = ET.fromstring(RICH)
    reference, parts = text_of(arm), unused_parts(arm)
    places = attributes(root)
    assert len(places) > 90
    for path, element, key in places:
        value = element.text if key is None else element.get(key)
        for new in (other(value), None):
            if key is None:
                element.text = new
            elif new is None:
                del element.attrib[key]
            else:
                element.set(key, new)
            arm.write_bytes(ET.tostring(root))
            changed = outcome(arm, text_of) != reference
            assert changed or listed(path, key, parts), (path, key, new)
            if key is None:
                element.text = value
            else:
                element.set(key, value)


def test_additions_are_listed(arm):
    root = ET.fromstring(RICH)
    for path, element in [("", root), *paths(root)]:
        extra = ET.SubElement(element, "joint_spring", stiffness="5")
        arm.write_bytes(ET.tostring(root))
        parts = outcome(arm, unused_parts)
        refused = isinstance(parts, str) and "is needed" in parts
        assert refused or listed(f"{path}/joint_spring".lstrip("/"), None, parts), path
        element.remove(extra)


def signature(path):
    """Return what the rest of the program sees of a URDF, but for drives of joints."""
    model = rigid_model(path, {})
    q = pin.integrate(model, pin.neutral(model), 0.3 + np.arange(model.nv))
    data = model.createData()
    shapes = checked_urdf(path, shapes=True).findall("link/collision")
    return (
        pin.crba(model, data, q).tobytes(),
        pin.computeGeneralizedGravity(model, data, q).tobytes(),
        [model.lowerPositionLimit.tobytes(), model.upperPositionLimit.tobytes(), list(model.names)],
        [frame.name for frame in model.frames],
        [placement.homogeneous.tobytes() for placement in model.jointPlacements],
        [ET.tostring(shape) for shape in shapes],
        couplings(checked_urdf(path)),
    )


def test_what_is_read_is_used_or_listed_beside_a_robot_file(arm):
    root = ET.fromstring(RICH)
    reference, parts = signature(arm), unused_parts(arm, beside_robot_file=True)
    for path, element, key in attributes(root):
        value = element.text if key is None else element.get(key)
        if key is None:
            element.text = other(value)
        else:
            element.set(key, other(value))
        arm.write_bytes(ET.tostring(root))
        changed = outcome(arm, signature) != reference
        whole = path.replace("/actuator", "")
        assert changed or listed(path, key, parts) or listed(whole, key, parts), (path, key)
        if key is None:
            element.text = value
        else:
            element.set(key, value)


def test_the_words(arm):
    lines = [str(part) for part in unused_parts(arm)]
    assert "<safety_controller> (turn): not used, because positions stay within <limit>" in lines
    assert (
        "stiffness of <dynamics> (turn): not used, because only damping, friction and armature are "
        "read" in lines
    )
    (single,) = [line for line in lines if line.startswith("<transmission>")]
    assert "(t2): not used, because only a mechanicalReduction of a single joint is read" in single
    assert not [line for line in lines if "material" in line or "visual" in line]
    beside = {part.path: part for part in unused_parts(arm, beside_robot_file=True)}
    assert beside["transmission/mechanicalReduction"].owners == ("turn",)
    assert beside["joint/limit@effort"].owners == ("turn", "grip")


def test_drives_of_joints(arm):
    drives = joint_drives(checked_urdf(arm))
    assert drives["turn"] == JointDrive(-120, 2.5, 4, 0.5, 150, 2)
    assert drives["yes"] == JointDrive()
    assert drives["grip"] == JointDrive(effort=5, velocity=1)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('damping="2.5"', 'damping="-2.5"', "joint 'turn': its damping -2.5 is negative; 0 or"),
        ('damping="2.5"', 'damping="high"', "joint 'turn': <dynamics> has damping='high'; a num"),
        (">-120<", ">0<", "joint 'turn': its transmission has mechanicalReduction '0'; a number"),
        ('offset="0.01"', 'offset="a"', "joint 'grip': <mimic> has offset='a'; a number is needed"),
    ],
)
def test_mistakes_are_named(arm, old, new, message):
    assert old in RICH
    arm.write_text(RICH.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(InvalidInput) as error:
        checked_urdf(arm)
    assert message in str(error.value)


def test_no_limit_may_be_infinite_effort(arm):
    arm.write_text(RICH.replace('effort="150"', 'effort="inf"'), encoding="utf-8")
    assert joint_drives(checked_urdf(arm))["turn"].effort is None


def test_published_robots_have_nothing_without_a_reason():
    files = importlib.metadata.files("example-robot-data") or []
    for file in files:
        if file.name in ("panda.urdf", "ur10_robot.urdf", "tiago_pro.urdf", "z1.urdf"):
            for part in unused_parts(file.locate(), beside_robot_file=True):
                assert part.owners
                assert "not used, because" in str(part)
