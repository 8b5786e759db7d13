"""Bodies made of several links, cut in several places."""

from copy import deepcopy
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from mujoco_arm import MujocoArm
from robots import CRANE, HERE, SPLIT, built, changed, refusal, with_spring

from robotmodels import frequency_response
from robotmodels.description.urdf import locate

OMEGA = 2 * np.pi * np.geomspace(2.0, 80.0, 5)
GROUND = """
  <link name="ground"><inertial><mass value="100"/>
    <inertia ixx="4" ixy="0" ixz="0" iyy="5" iyz="0" izz="6"/></inertial></link>
  <joint name="bolts" type="fixed"><parent link="ground"/><child link="floor"/></joint>
"""


def cut(name: str, link: str, at: list[float], axis: str, distal: dict | None = None) -> dict:
    spring = {"name": name, "link": link, "at": at, "axis": axis, "stiffness": 2e4, "damping": 9.0}
    return spring if distal is None else spring | {"distal": distal}


def yard() -> dict:
    """The crane with its lamp locked; cuts through column, lamp, and two links of the boom."""
    content = deepcopy(CRANE)
    content["motors"] = [m for m in content["motors"] if m["joint"] != "nod"]
    content["lock"] = {"flap": -0.7, "nod": 1.2}
    content["payload"] = {
        "link": "lamp",
        "mass": 2.0,
        "com": [0.1, 0.1, 0.0],
        "inertia": [0.01, 0.02, 0.025],
    }
    content["accelerometers"] = [
        {"name": "light", "link": "lamp", "at": [0.3, 0.0, 0.0], "direction": [0, 0, 1]},
        {"name": "tip", "link": "knob", "at": [0.02, 0.0, 0.0], "direction": [1, 1, 0]},
        {"name": "waist", "link": "column", "at": [0.0, 0.1, 0.9], "direction": [1, 0, 0]},
    ]
    column = {"mass": 6.0, "com": [0.02, 0.01, 0.4], "inertia": [0.3, 0.3, 0.05]}
    lamp = {"mass": 1.5, "com": [0.33, 0.0, 0.12], "inertia": [0.008, 0.01, 0.01]}
    bracket = {"mass": 0.5, "com": [0.06, 0.0, 0.02], "inertia": [1e-3, 1e-3, 1e-3]}
    content["springs"] += [
        cut("cx", "column", [0.0, 0.0, 0.5], "x", column),
        cut("cz", "column", [0.0, 0.0, 0.5], "z"),
        cut("lx", "lamp", [0.15, 0.0, 0.05], "x", lamp),
        cut("kz", "bracket", [0.05, 0.0, 0.0], "z", bracket),
    ]
    content["parameters"] = {}
    return content


def check_against_mujoco(content: dict) -> None:
    robot = built(content)
    judge = MujocoArm(robot.file, locate(robot.file.urdf, robot.folder))
    order = judge.order(robot.coordinate_names)
    positions = np.random.default_rng(4).uniform(
        *robot.position_limits.T, (3, len(robot.motor_names))
    )
    q = [judge.equilibrium(p, {}) for p in positions]
    expected = np.array([judge.mass(c)[np.ix_(order, order)] for c in q])
    found = robot.network(positions).mass
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max())
    expected = judge.frequency_response(positions, OMEGA)
    scale = np.abs(expected).max(axis=3, keepdims=True)
    found = frequency_response(robot, positions, OMEGA)
    np.testing.assert_allclose(found / scale, expected / scale, rtol=0, atol=1e-6)


def test_cuts_through_links_fixed_to_each_other() -> None:
    check_against_mujoco(yard())


def test_an_elastic_foundation_on_a_pedestal(tmp_path: Path) -> None:
    """What the cut link is bolted to stays on the ground."""
    text = (HERE / "crane.urdf").read_text()
    path = tmp_path / "pedestal.urdf"
    path.write_text(text.replace('<link name="floor">', GROUND + '<link name="floor">', 1))
    check_against_mujoco(changed(CRANE, urdf=str(path)))


def test_a_root_link_without_mass_can_be_an_elastic_foundation(tmp_path: Path) -> None:
    text = (HERE / "crane.urdf").read_text()
    start, end = text.index('<link name="floor">'), text.index("</link>") + len("</link>")
    path = tmp_path / "floor.urdf"
    path.write_text(text[:start] + '<link name="floor"/>' + text[end:])
    check_against_mujoco(changed(CRANE, urdf=str(path)))


def test_links_beside_each_other_can_both_be_cut(tmp_path: Path) -> None:
    """Two brackets on one boom, neither beyond the other."""
    text = (HERE / "crane.urdf").read_text()
    second = text[text.index('<joint name="boom_bracket"') : text.index('<joint name="flap"')]
    second = second.replace("boom_bracket", "bolted").replace('"bracket"', '"second"')
    second = second.replace('rpy="0.3 0.2 0.1"', 'rpy="-0.3 1 0"')
    path = tmp_path / "two.urdf"
    path.write_text(text.replace("</robot>", second + "</robot>"))
    part = {"mass": 0.5, "com": [0.06, 0.0, 0.02], "inertia": [1e-3, 1e-3, 1e-3]}
    springs = [
        *CRANE["springs"],
        cut("k1", "bracket", [0.05, 0.0, 0.0], "z", part),
        cut("k2", "second", [0.05, 0.0, 0.0], "y", part),
    ]
    check_against_mujoco(changed(CRANE, urdf=str(path), springs=springs))


def test_a_payload_on_a_cut_link_lies_beyond_the_cut() -> None:
    payload = {"link": "boom", "mass": 2.0, "com": [0.4, 0, 0], "inertia": [0.01, 0.01, 0.01]}
    bare, loaded = (built(changed(CRANE, payload=p)).arm.model for p in (CRANE["payload"], payload))
    far = bare.inertias[bare.getJointId("ay")].mass
    assert loaded.inertias[loaded.getJointId("ay")].mass == pytest.approx(far + 2.0, rel=1e-12)
    assert pin.computeTotalMass(loaded) == pytest.approx(pin.computeTotalMass(bare) - 2.0)


def test_what_a_cut_leaves_is_judged_link_by_link() -> None:
    """Even where heavier links are fixed to it, or it stays on the ground."""
    content = yard()
    content["springs"][-2]["distal"] |= {"com": [0.4, 0.0, 0.1]}
    line = refusal(content)
    assert "spring 'lx': what its cut leaves of link 'lamp' is not physically consistent" in line
    heavy = {"mass": 100.0, "com": [0, 0, 0], "inertia": [1, 1, 1]}
    line = refusal(with_spring(SPLIT, "fx", distal=heavy))
    assert "spring 'fx': what its cut leaves of link 'base_link' has mass -96 kg" in line


def test_a_whole_link_may_lie_beyond_its_cut() -> None:
    """Its joint then moves nothing but the cut, about another axis: every motion moves the hand."""
    hand = {"mass": 3.0, "com": [0.3, 0.0, 0.1], "inertia": [0.02, 0.03, 0.03]}
    springs = [*CRANE["springs"], cut("ly", "lamp", [0.1, 0.0, 0.0], "x", hand)]
    arm = built(changed(CRANE, springs=springs)).arm.model
    assert arm.inertias[arm.getJointId("nod")].mass == 0
    assert arm.inertias[arm.getJointId("ly")].mass == pytest.approx(3.0, rel=1e-12)
    content = changed(yard(), springs=[*yard()["springs"][:-2], springs[-1]])
    arm = built(content).arm.model  # fixed to the column, which has a mass
    assert arm.inertias[arm.getJointId("ly")].mass == pytest.approx(3.0 + 2.0, rel=1e-12)


@pytest.mark.parametrize("at", [[0.3, 0.0, 2.0], [300.0, 0.0, 0.0], [0.3, -0.6, 0.0]])
def test_a_cut_outside_its_link_is_refused(at: list[float]) -> None:
    line = refusal(with_spring(with_spring(CRANE, "az", at=at), "ay", at=at))
    assert f"spring 'az': its cut at {at} lies outside link 'boom', which reaches from" in line


def test_a_cut_may_lie_a_little_outside_and_a_foundation_anywhere() -> None:
    at = [0.7, 0.05, -0.1]
    assert built(with_spring(with_spring(CRANE, "az", at=at), "ay", at=at))
    content = changed(CRANE)
    for spring in content["springs"]:
        if spring.get("link") == "floor":
            spring["at"] = [0.0, 0.0, -5.0]
    assert built(content)


def test_nothing_is_mounted_on_the_ground() -> None:
    content = changed(CRANE, springs=[s for s in CRANE["springs"] if s.get("link") != "floor"])
    content["parameters"] = {}
    payload = changed(content, payload=CRANE["payload"] | {"link": "floor"})
    assert refusal(payload) == "payload: link 'floor' does not move"
    sensor = {"name": "foot", "link": "floor", "at": [0, 0, 0], "direction": [0, 0, 1]}
    assert refusal(changed(content, accelerometers=[sensor])) == (
        "accelerometer 'foot': link 'floor' does not move"
    )


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            changed(SPLIT, payload=SPLIT["payload"] | {"inertia": [-1, 1, 1]}),
            "payload is not physically consistent: its principal moments of inertia are -1, 1, 1",
        ),
        (
            changed(SPLIT, payload=SPLIT["payload"] | {"mass": 0.0}),
            "payload has mass 0 kg; a positive mass is needed",
        ),
        (
            with_spring(
                SPLIT, "c3z", distal={"mass": 1.2, "com": [0, 0, 0.486], "inertia": [1, 1, -1]}
            ),
            "spring 'c3z': 'distal' is not physically consistent: its principal moments",
        ),
    ],
)
def test_bodies_that_cannot_be(content: dict, message: str) -> None:
    assert message in refusal(content)


def test_an_empty_payload_is_no_payload() -> None:
    empty = {"link": "tool0", "mass": 0.0, "com": [0, 0, 0], "inertia": [0, 0, 0]}
    bare, loaded = (built(changed(SPLIT, payload=p)).arm.model for p in (None, empty))
    assert pin.computeTotalMass(loaded) == pin.computeTotalMass(bare)
