"""The rigid part of a robot as URDF: payload and locks as fixed joints, friction, gear ratios."""

import os
import xml.etree.ElementTree as ET
from pathlib import Path

from scipy.spatial.transform import Rotation

from robotmodels.description.model_files import read_model
from robotmodels.description.robot_file import Motor, Payload, RobotFile
from robotmodels.description.urdf_elements import number_text
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.exports.formats import left_out
from robotmodels.exports.robot_files import relative_to
from robotmodels.simulation.urdf_tree import Joint, read_tree

_AXES = ("xx", "xy", "xz", "yy", "yz", "zz")


def urdf_text(robot: ElasticRobot, folder: Path) -> str:
    """Return the robot as URDF for `folder`, meshes found from there.

    Its mass matrix and gravity are those of the robot file with rigid springs and without motors.
    What the format cannot hold stands in a comment on top of the text, see `left_out`.
    """
    source = robot.model_file
    root, file = read_model(source), robot.file
    joints = {j.name: j for each in read_tree(source).joints.values() for j in each}
    for element in root.findall("joint"):
        if (name := element.get("name", "")) in file.lock:
            _lock(element, joints[name], file.lock[name])
    _add_motors(root, file)
    if file.payload is not None:
        _add_payload(root, file.payload)
    for mesh in root.iter("mesh"):
        filename = mesh.get("filename", "")
        if filename and "://" not in filename and not os.path.isabs(filename):
            mesh.set("filename", relative_to(folder, source.path.parent / filename))
    root.set("name", robot.name)
    ET.indent(root)
    lines = "\n".join(f"  - {line.replace('--', '- -')}" for line in left_out(file, "urdf"))
    text = ET.tostring(root, encoding="unicode")
    return f'<?xml version="1.0"?>\n<!-- Not in this file:\n{lines}\n-->\n{text}\n'


def _lock(element: ET.Element, joint: Joint, value: float) -> None:
    """Make a joint fixed at its locked value."""
    position, rotation = joint.position, joint.rotation
    if joint.kind == "prismatic":
        position = position + rotation.apply(value * joint.axis)
    else:
        rotation = rotation * Rotation.from_rotvec(value * joint.axis)
    for tag in ("origin", "axis", "limit", "dynamics", "mimic", "calibration", "safety_controller"):
        if (child := element.find(tag)) is not None:
            element.remove(child)
    element.set("type", "fixed")
    rpy = rotation.as_euler("xyz")
    element.insert(0, ET.Element("origin", xyz=number_text(position), rpy=number_text(rpy)))


def _add_motors(root: ET.Element, file: RobotFile) -> None:
    """Add motors, then the friction of joints."""
    for motor in file.motors:
        _add_motor(root, motor)
    for item in file.friction:
        _add_dynamics(root, item.joint, item.viscous, item.coulomb)


def _add_motor(root: ET.Element, motor: Motor) -> None:
    """Add a motor's friction, on the arm side, and its gear ratio."""
    ratio = motor.gear_ratio
    for joint in root.findall("joint"):  # motors tell more than the URDF did
        if joint.get("name") == motor.joint and (dynamics := joint.find("dynamics")) is not None:
            joint.remove(dynamics)
    _add_dynamics(root, motor.joint, motor.viscous * ratio**2, motor.coulomb * abs(ratio))
    for other in root.findall("transmission"):
        if any(j.get("name") == motor.joint for j in other.findall("joint")):
            root.remove(other)
    transmission = ET.SubElement(root, "transmission", name=f"{motor.joint}_{motor.name}")
    kind = "transmission_interface/SimpleTransmission"
    ET.SubElement(transmission, "type").text = kind
    ET.SubElement(transmission, "joint", name=motor.joint)
    actuator = ET.SubElement(transmission, "actuator", name=motor.name)
    ET.SubElement(actuator, "mechanicalReduction").text = repr(ratio)


def _add_dynamics(root: ET.Element, name: str, damping: float, friction: float) -> None:
    """Add to the friction of a joint."""
    (joint,) = (j for j in root.findall("joint") if j.get("name") == name)
    if (dynamics := joint.find("dynamics")) is None:
        dynamics = ET.SubElement(joint, "dynamics")
    for key, value in (("damping", damping), ("friction", friction)):
        dynamics.set(key, repr(float(dynamics.get(key, "0")) + value))


def _add_payload(root: ET.Element, payload: Payload) -> None:
    """Add a payload as a link of its own."""
    names = {element.get("name") for element in root}
    name = "payload"
    while name in names or f"{name}_joint" in names:
        name += "_"
    link = ET.SubElement(root, "link", name=name)
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=number_text(payload.com), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=repr(payload.mass))
    moments = zip(_AXES, payload.inertia, strict=True)
    ET.SubElement(inertial, "inertia", {f"i{axes}": repr(value) for axes, value in moments})
    joint = ET.SubElement(root, "joint", name=f"{name}_joint", type="fixed")
    ET.SubElement(joint, "parent", link=payload.link)
    ET.SubElement(joint, "child", link=name)
