"""Robots that between them use every entry of a robot file."""

from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest
import yaml

from robotmodels import ElasticRobot, InvalidInput
from robotmodels.description.robot_file import RobotFile

HERE = Path(__file__).parent


def built(content: dict[str, Any]) -> ElasticRobot:
    """Return the robot whose file says `content`; relative paths start in this folder."""
    return ElasticRobot(RobotFile.model_validate(content), HERE)


def refusal(content: dict[str, Any], folder: Path = HERE) -> str:
    """Return the one line with which a robot is refused."""
    with pytest.raises(InvalidInput) as error:
        ElasticRobot(RobotFile.model_validate(content), folder)
    assert "\n" not in str(error.value)
    return str(error.value)


def changed(content: dict[str, Any], **entries: Any) -> dict[str, Any]:
    """Return a deep copy of `content` with some of its entries replaced."""
    return deepcopy(content) | entries


# Two cuts through one link, an elastic foundation, hardening gears, a payload on a fixed child.
SPLIT = yaml.safe_load("""
schema: robot/1
name: ur10-split
urdf: example-robot-data:ur_description/urdf/ur10_robot.urdf
motors:
  - {name: m1, joint: shoulder_pan_joint, gear_ratio: 101, inertia: 4.0e-4, viscous: 2.0e-3}
  - {name: m2, joint: shoulder_lift_joint, gear_ratio: 101, inertia: 4.0e-4, viscous: 2.0e-3}
  - {name: m3, joint: elbow_joint, gear_ratio: 101, inertia: 2.0e-4, viscous: 1.5e-3}
  - {name: m4, joint: wrist_1_joint, gear_ratio: 101, inertia: 6.0e-5, viscous: 4.0e-4}
  - {name: m5, joint: wrist_2_joint, gear_ratio: 101, inertia: 4.0e-5, viscous: 3.0e-4}
  - {name: m6, joint: wrist_3_joint, gear_ratio: 101, inertia: 3.0e-5, viscous: 2.0e-4}
springs:
  - {name: d1, joint: shoulder_pan_joint, axis: drive, stiffness: 4.0e+4, damping: 60}
  - name: d2
    joint: shoulder_lift_joint
    axis: drive
    stiffness: {low: 2.0e+4, high: 5.0e+4, torque: 150}
    damping: 60
  - name: d3
    joint: elbow_joint
    axis: drive
    stiffness: {low: 2.0e+4, high: 4.0e+4, torque: 80}
    damping: 40
  - {name: d4, joint: wrist_1_joint, axis: drive, stiffness: 8.0e+3, damping: 12}
  - {name: d5, joint: wrist_2_joint, axis: drive, stiffness: 6.0e+3, damping: 9}
  - {name: d6, joint: wrist_3_joint, axis: drive, stiffness: 4.0e+3, damping: 6}
  - {name: fx, link: base_link, at: [0.0, 0.0, 0.0], axis: x, stiffness: 2.0e+5, damping: 200}
  - {name: fy, link: base_link, at: [0.0, 0.0, 0.0], axis: y, stiffness: 2.5e+5, damping: 200}
  - {name: b2x, joint: shoulder_lift_joint, axis: x, stiffness: 8.0e+4, damping: 80}
  - {name: b2z, joint: shoulder_lift_joint, axis: z, stiffness: 7.0e+4, damping: 80}
  - name: a3y
    link: forearm_link
    at: [0.0, 0.01, 0.2]
    axis: y
    stiffness: 5.0e+4
    damping: 40
    distal: {mass: 2.5, com: [0.0, 0.0, 0.386], inertia: [0.0326, 0.0, 0.0005, 0.033, 0.0, 0.007]}
  - {name: a3x, link: forearm_link, at: [0.0, 0.01, 0.2], axis: x, stiffness: 4.0e+4, damping: 40}
  - name: c3z
    link: forearm_link
    at: [0.0, 0.0, 0.4]
    axis: z
    stiffness: 3.0e+4
    damping: 20
    distal: {mass: 1.2, com: [0.0, 0.0, 0.486], inertia: [0.0047, 0.005, 0.0034]}
payload:
  {link: tool0, mass: 5.0, com: [0.05, 0.02, 0.1], inertia: [0.03, 0.0, 0.002, 0.04, 0.0, 0.05]}
parameters:
  fixed: [fx.damping, fy.damping]
  tied: [[a3y.stiffness, a3x.stiffness]]
""")

# Rigid drives, a negative gear ratio, motors out of order, gravity askew (hung on a wall).
WALL = yaml.safe_load("""
schema: robot/1
name: ur5-on-a-wall
urdf: example-robot-data:ur_description/urdf/ur5_robot.urdf
gravity: [-8.0, 3.0, -4.0]
lock: {wrist_3_joint: 0.7}
motors:
  - {name: m3, joint: elbow_joint, gear_ratio: -90, inertia: 2.0e-4, viscous: 1.5e-3}
  - {name: m1, joint: shoulder_pan_joint, gear_ratio: 101, inertia: 4.0e-4, viscous: 2.0e-3}
  - {name: m2, joint: shoulder_lift_joint, gear_ratio: -80, inertia: 4.0e-4, viscous: 2.0e-3}
  - {name: m5, joint: wrist_2_joint, gear_ratio: 50, inertia: 4.0e-5}
  - {name: m4, joint: wrist_1_joint, gear_ratio: 101, inertia: 6.0e-5, viscous: 4.0e-4}
springs:
  - {name: b3z, joint: elbow_joint, axis: z, stiffness: 3.0e+4, damping: 25}
  - {name: d3, joint: elbow_joint, axis: drive, stiffness: 1.5e+4, damping: 20}
  - {name: b3x, joint: elbow_joint, axis: x, stiffness: 3.5e+4, damping: 30}
  - {name: b2x, joint: shoulder_lift_joint, axis: x, stiffness: 4.0e+4, damping: 40}
  - {name: d5, joint: wrist_2_joint, axis: drive, stiffness: 3.0e+3, damping: 3}
  - {name: d1, joint: shoulder_pan_joint, axis: drive, stiffness: 2.0e+4, damping: 30}
""")

_PANDA_STIFFNESS = (3.0e4, 3.0e4, 2.5e4, 2.0e4, 9.0e3, 8.0e3, 6.0e3)
PANDA = {
    "schema": "robot/1",
    "name": "panda",
    "urdf": "example-robot-data:panda_description/urdf/panda.urdf",
    "lock": {"panda_finger_joint1": 0.03, "panda_finger_joint2": 0.01},
    "motors": [
        {
            "name": f"m{i}",
            "joint": f"panda_joint{i}",
            "gear_ratio": 100,
            "inertia": 5e-5,
            "viscous": 5e-4,
        }
        for i in range(1, 8)
    ],
    "springs": [
        {
            "name": f"d{i}",
            "joint": f"panda_joint{i}",
            "axis": "drive",
            "stiffness": k,
            "damping": 1e-3 * k,
        }
        for i, k in enumerate(_PANDA_STIFFNESS, start=1)
    ]
    + [
        {
            "name": f"b{i}{axis}",
            "joint": f"panda_joint{i}",
            "axis": axis,
            "stiffness": 4e4,
            "damping": 40.0,
        }
        for i in (1, 2, 4)
        for axis in "yx"
    ],
}

# Everything at once, on the URDF beside this file.
CRANE = yaml.safe_load("""
schema: robot/1
name: crane
urdf: crane.urdf
gravity: [1.0, -2.0, -9.0]
lock: {flap: 0.4}
motors:
  - {name: mw, joint: wrist, gear_ratio: 60, inertia: 5.0e-5, viscous: 2.0e-4}
  - {name: mt, joint: turn, gear_ratio: 120, inertia: 4.0e-4, viscous: 1.0e-3}
  - {name: ms, joint: slide, gear_ratio: 200, inertia: 3.0e-4, viscous: 1.0e-3}
  - {name: ml, joint: lean, gear_ratio: -80, inertia: 3.0e-4, viscous: 1.0e-3}
  - {name: mn, joint: nod, gear_ratio: 50, inertia: 1.0e-4}
springs:
  - {name: fz, link: floor, at: [0.1, -0.2, 0.3], axis: z, stiffness: 3.0e+5, damping: 300}
  - {name: fx, link: floor, at: [0.1, -0.2, 0.3], axis: x, stiffness: 2.0e+5, damping: 200}
  - {name: fy, link: floor, at: [0.1, -0.2, 0.3], axis: y, stiffness: 2.5e+5, damping: 250}
  - name: dt
    joint: turn
    axis: drive
    stiffness: {low: 2.0e+4, high: 6.0e+4, torque: 100}
    damping: 40
  - {name: btx, joint: turn, axis: x, stiffness: 6.0e+4, damping: 60}
  - {name: ds, joint: slide, axis: drive, stiffness: 5.0e+5, damping: 400}
  - {name: bsz, joint: slide, axis: z, stiffness: 6.0e+4, damping: 50}
  - {name: bsy, joint: slide, axis: y, stiffness: 5.0e+4, damping: 45}
  - name: dl
    joint: lean
    axis: drive
    stiffness: {low: 2.0e+4, high: 1.5e+4, torque: 100}
    damping: 30
  - {name: blx, joint: lean, axis: x, stiffness: 3.0e+4, damping: 20}
  - name: az
    link: boom
    at: [0.3, 0.0, 0.0]
    axis: z
    stiffness: 2.0e+4
    damping: 15
    distal: {mass: 3.0, com: [0.45, 0.0, 0.0], inertia: [0.02, 0.03, 0.03]}
  - {name: ay, link: boom, at: [0.3, 0.0, 0.0], axis: y, stiffness: 2.5e+4, damping: 15}
  - {name: dw, joint: wrist, axis: drive, stiffness: 3.0e+3, damping: 2}
payload: {link: hand, mass: 4.0, com: [0.1, 0.0, 0.2], inertia: [0.03, 0.02, 0.04]}
parameters:
  fixed: [fz.damping]
  tied: [[fx.stiffness, fy.stiffness], [dw.damping, dl.stiffness.high]]
""")

# Accelerometers before and beyond cuts, a delay, parameters that are neither spring nor damper.
SENSED = changed(
    SPLIT,
    accelerometers=[
        {"name": "tip", "link": "wrist_3_link", "at": [0.1, 0.0, 0.05], "direction": [0, 1, 1]},
        {"name": "elbow", "link": "forearm_link", "at": [0.0, 0.05, 0.5], "direction": [-1, 0, 2]},
        {"name": "foot", "link": "base_link", "at": [0.0, 0.1, 0.1], "direction": [1, 0, 0]},
    ],
    delay=2e-4,
    parameters={
        "fixed": ["fx.damping", "fy.damping"],
        "extra": ["m2.inertia", "m3.viscous", "payload.mass", "payload.com.z", "a3y.at", "delay"],
    },
)

_BALANCED_JOINTS = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint")

# A cylinder across the elbow, and a sinusoid whose amplitude is free.
BALANCED: dict[str, Any] = {
    "schema": "robot/1",
    "name": "balanced",
    "urdf": "example-robot-data:ur_description/urdf/ur10_robot.urdf",
    "lock": {f"wrist_{i}_joint": 0.3 for i in (1, 2, 3)},
    "motors": [
        {"name": f"m{i}", "joint": joint, "gear_ratio": 101, "inertia": 3e-4, "viscous": 1e-3}
        for i, joint in enumerate(_BALANCED_JOINTS)
    ],
    "springs": [
        {"name": f"d{i}", "joint": joint, "axis": "drive", "stiffness": 2e4, "damping": 20.0}
        for i, joint in enumerate(_BALANCED_JOINTS)
    ],
    "counterbalances": [
        {
            "name": "lift",
            "joint": "shoulder_lift_joint",
            "sinusoid": {"amplitude": 90.0, "phase": 0.4},
        },
        {
            "name": "cylinder",
            "joint": "elbow_joint",
            "spring": {
                "points": [
                    {"link": "upper_arm_link", "at": [0.1, 0.05, 0.4]},
                    {"link": "forearm_link", "at": [0.08, -0.03, 0.25]},
                ],
                "stiffness": 900.0,
                "rest_length": 0.3,
                "preload": -60.0,
            },
        },
    ],
    "friction": [
        {"name": "f2", "joint": "shoulder_lift_joint", "viscous": 15.0},
        {"name": "f3", "joint": "elbow_joint", "viscous": 4.0, "coulomb": 3.0},
    ],
    "parameters": {
        "extra": ["lift.amplitude", "cylinder.stiffness", "cylinder.preload", "f2.viscous"]
    },
}

# One arm, one gear, level at position 0: everything about it has a closed form.
PENDULUM = {
    "schema": "robot/1",
    "name": "pendulum",
    "urdf": "pendulum.urdf",
    "motors": [
        {"name": "m", "joint": "hinge", "gear_ratio": 50.0, "inertia": 1e-3, "viscous": 2e-3}
    ],
    "springs": [{"name": "g", "joint": "hinge", "axis": "drive", "stiffness": 5e3, "damping": 4.0}],
}


def with_spring(content: dict[str, Any], spring: str, **entries: Any) -> dict[str, Any]:
    """Return a copy of `content` with entries of one spring replaced; None takes one out."""
    copy = deepcopy(content)
    (place,) = (i for i, s in enumerate(copy["springs"]) if s["name"] == spring)
    merged = copy["springs"][place] | entries
    copy["springs"][place] = {k: v for k, v in merged.items() if v is not None}
    return copy


PARALLELOGRAM = yaml.safe_load((HERE / "parallelogram.yaml").read_text())
