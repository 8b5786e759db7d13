"""Where torsions and cuts go, and those that cannot be made."""

import numpy as np
import pinocchio as pin
import pytest
from robots import CRANE, SPLIT, WALL, built, changed, refusal, with_spring

from robotmodels import frequency_response

OMEGA = 2 * np.pi * np.array([5.0, 30.0])
DISTAL = {"mass": 2.5, "com": [0.0, 0.0, 0.386], "inertia": [0.0326, 0.033, 0.007]}
BRACKET = {
    "name": "k",
    "link": "bracket",
    "at": [0.05, 0.0, 0.0],
    "axis": "z",
    "stiffness": 1e4,
    "damping": 5.0,
    "distal": {"mass": 0.5, "com": [0.06, 0.0, 0.02], "inertia": [1e-3, 1e-3, 1e-3]},
}


def added(content: dict, **spring: object) -> dict:
    new = {"name": "new", "stiffness": 1e4, "damping": 10.0} | spring
    return changed(content, springs=[*content["springs"], new])


def test_torsions_precede_their_drive_in_file_order() -> None:
    names = list(built(CRANE).arm.model.names)
    assert names[1:4] == ["fz", "fx", "fy"]  # the foundation comes first
    assert names[4:6] == ["btx", "turn"]
    for chain in (["bsz", "bsy", "slide"], ["blx", "lean", "az", "ay", "wrist"]):
        start = names.index(chain[0])
        assert names[start : start + len(chain)] == chain


@pytest.mark.parametrize("content", [SPLIT, WALL, CRANE], ids=lambda c: c["name"])
def test_torsions_and_cuts_take_no_mass_away(content: dict) -> None:
    robot = built(content)
    payload = robot.file.payload.mass if robot.file.payload else 0.0
    foundation = any(s.link == "floor" or s.link == "base_link" for s in robot.file.springs)
    moving = list(robot.rigid.inertias)[0 if foundation else 1 :]
    assert pin.computeTotalMass(robot.arm.model) == pytest.approx(
        sum(i.mass for i in moving) + payload, rel=1e-12
    )


def test_bodies_beyond_a_locked_joint_lie_beyond_the_cut() -> None:
    """bracket 1.5, plate 0.8 (locked) and knob 0.6 kg are fastened to the far end of the boom."""
    arm = built(CRANE).arm.model
    far, near = (arm.inertias[arm.getJointId(name)].mass for name in ("ay", "lean"))
    assert far == pytest.approx(3.0 + 1.5 + 0.8 + 0.6, rel=1e-12)
    assert near == pytest.approx(8.0 - 3.0, rel=1e-12)


def test_cuts_can_follow_each_other_along_a_chain_of_fixed_links() -> None:
    robot = built(changed(CRANE, springs=[*CRANE["springs"], BRACKET]))
    arm = robot.arm.model
    assert arm.names[arm.parents[arm.getJointId("k")]] == "ay"
    assert arm.inertias[arm.getJointId("k")].mass == pytest.approx(0.5 + 1.4, rel=1e-12)
    assert arm.inertias[arm.getJointId("ay")].mass == pytest.approx(3.0 + 1.0, rel=1e-12)


def test_cuts_through_different_links_may_be_given_in_any_order() -> None:
    position = built(CRANE).position_limits.mean(axis=1)[None]
    first, last = (
        built(changed(CRANE, springs=springs))
        for springs in ([BRACKET, *CRANE["springs"]], [*CRANE["springs"], BRACKET])
    )
    assert list(first.arm.model.names) == list(last.arm.model.names)
    G, expected = (frequency_response(robot, position, OMEGA) for robot in (first, last))
    np.testing.assert_allclose(G, expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (with_spring(SPLIT, "d4", joint="wrist1_joint"), "'wrist1_joint' is not a moving joint of"),
        (
            with_spring(SPLIT, "d4", joint="ee_fixed_joint"),
            "'ee_fixed_joint' is not a moving joint",
        ),
        (added(WALL, joint="wrist_3_joint", axis="x"), "'wrist_3_joint' is held under 'lock'"),
        (with_spring(SPLIT, "a3x", link="forearm"), "spring 'a3x': 'forearm' is not a link of the"),
        (
            changed(SPLIT, payload=SPLIT["payload"] | {"link": "tool"}),
            "payload: 'tool' is not a link",
        ),
        (
            with_spring(SPLIT, "b2x", name="elbow_joint"),
            "spring 'elbow_joint' has the name of a jo",
        ),
        (
            with_spring(SPLIT, "b2x", axis="y"),
            "spring 'b2x': axis 'y' is not orthogonal to the dri",
        ),
        (added(CRANE, joint="lean", axis="z"), "axis [0.0, 0.6, 0.8] of joint 'lean'"),
        (
            with_spring(SPLIT, "a3y", distal=None),
            "a cut through link 'forearm_link' needs 'distal'",
        ),
        (with_spring(SPLIT, "a3x", distal=DISTAL), "spring 'a3x': 'distal' is given twice"),
    ],
)
def test_springs_that_cannot_be_placed(content: dict, message: str) -> None:
    assert message in refusal(content)


def test_an_unknown_joint_or_link_comes_with_the_nearest_and_all() -> None:
    line = refusal(with_spring(SPLIT, "d4", joint="wrist1_joint"))
    assert "(did you mean 'wrist_1_joint'?); there are shoulder_pan_joint, shoulder_lift" in line
    line = refusal(with_spring(SPLIT, "a3x", link="forearm"))
    assert "(did you mean 'forearm_link'?); there are world, base_link" in line


def test_a_motor_cannot_have_the_name_of_a_joint() -> None:
    motors = [SPLIT["motors"][0] | {"name": "elbow_joint"}, *SPLIT["motors"][1:]]
    assert "motor 'elbow_joint' has the name of a joint" in refusal(changed(SPLIT, motors=motors))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"mass": 5.0},
            "spring 'a3y': what its cut leaves of link 'forearm_link' has mass",
        ),
        (
            {"com": [0.0, 0.5, 0.4]},
            "spring 'a3y': what its cut leaves of link 'forearm_link' is not phys",
        ),
        ({"inertia": [0.03, 0.1, 0.007]}, "spring 'a3y': 'distal' is not physically consistent"),
        ({"mass": 0.0}, "spring 'a3y': 'distal' has mass 0 kg; a positive mass is needed"),
    ],
)
def test_a_split_outside_its_link(change: dict, message: str) -> None:
    assert message in refusal(with_spring(SPLIT, "a3y", distal=DISTAL | change))


def test_a_payload_must_be_a_possible_body() -> None:
    payload = SPLIT["payload"] | {"inertia": [1.0, 1.0, 3.0]}
    line = refusal(changed(SPLIT, payload=payload))
    assert line.startswith("payload is not physically consistent: its principal moments")
    assert "1, 1, 3 kg m^2" in line


def test_an_elastic_foundation_carries_the_root_link() -> None:
    arm = built(CRANE).arm.model
    assert arm.inertias[arm.getJointId("fy")].mass == pytest.approx(60.0)
    np.testing.assert_allclose(
        arm.jointPlacements[arm.getJointId("fz")].translation, [0.1, -0.2, 0.3], atol=1e-15
    )
