"""The robot as its users see it: names, units, limits, positions, joint origins."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from robots import CRANE, HERE, PANDA, PENDULUM, SPLIT, WALL, built, changed

from robotmodels import InvalidInput, frequency_response, linearize
from robotmodels.elastic.rigid_pose import joint_origins


def test_parameters_are_all_stiffnesses_then_all_dampings_in_file_order() -> None:
    names = built(PANDA).parameters.names
    springs = [s["name"] for s in PANDA["springs"]]
    assert names == tuple(
        f"{spring}.{kind}" for kind in ("stiffness", "damping") for spring in springs
    )


def test_fixed_and_tied_parameters_leave_the_list() -> None:
    parameters = built(SPLIT).parameters
    assert "fx.damping" not in parameters.names
    assert "a3x.stiffness" not in parameters.names
    assert parameters.values[parameters.index("a3y.stiffness")] == 5e4
    assert {"d2.stiffness.low", "d2.stiffness.high", "a3x.damping"} < set(parameters.names)


def test_tied_elements_keep_their_ratio() -> None:
    robot = built(SPLIT)
    theta = np.array(robot.parameters.values)
    theta[robot.parameters.index("a3y.stiffness")] *= 1.5
    springs = [s.name for s in robot.file.springs]
    stiffness = robot.network(np.zeros((1, 6)), theta).spring_stiffness[0]
    assert stiffness[springs.index("a3y")] == pytest.approx(7.5e4)
    assert stiffness[springs.index("a3x")] == pytest.approx(6e4)


def test_a_group_is_called_by_its_first_member_as_written() -> None:
    """Even where another member comes first among the robot's elements."""
    parameters = built(CRANE).parameters
    assert "dl.stiffness.high" not in parameters.names
    assert parameters.values[parameters.index("dw.damping")] == 2.0


def test_units() -> None:
    parameters = built(CRANE).parameters
    unit = dict(zip(parameters.names, parameters.units, strict=True))
    assert unit["ds.stiffness"] == "N/m"
    assert unit["ds.damping"] == "N s/m"
    assert unit["bsz.stiffness"] == "N m/rad"  # a torsion at the prismatic joint
    assert unit["dt.stiffness.low"] == "N m/rad"
    assert unit["dw.damping"] == "N m s/rad"


def test_coordinates_are_the_arm_then_elastic_motors_in_motor_order() -> None:
    robot = built(WALL)
    assert robot.coordinate_names[-3:] == ("m3", "m1", "m5")
    assert robot.motor_names == ("m3", "m1", "m2", "m5", "m4")
    assert robot.motor_joints[0] == "elbow_joint"
    assert linearize(robot, np.zeros(5)).selector.shape == (len(robot.coordinate_names), 5)


def test_limits_follow_the_motors_and_a_continuous_joint_has_a_turn() -> None:
    np.testing.assert_allclose(
        built(CRANE).position_limits,
        [[-3, 3], [-np.pi, np.pi], [-0.2, 0.4], [-2, 2.5], [-1.5, 1.5]],
    )


@pytest.mark.parametrize(
    ("positions", "message"),
    [
        (
            np.zeros((2, 4)),
            r"shape \(2, 4\) was given, \(Q, 5\) is needed, one column per motor: mw",
        ),
        (np.zeros(5), r"shape \(5,\) was given, \(Q, 5\)"),
        (
            [[0, 0, 0, 0, 0], [0, 0, 0.5, 0, 0]],
            r"position 1: joint 'slide' at 0\.5 is outside its limits \[-0\.2, 0\.4\]",
        ),
        ([[0, 4, 0, 0, 0]], r"joint 'turn' at 4 is outside"),
        ([["a"] * 5], r"positions: an array of real numbers is needed, found \[\['a', 'a'"),
        (
            [[0, 0], [0]],
            r"positions: an array of real numbers is needed, found \[\[0, 0\], \[0\]\]",
        ),
        (np.full((1, 5), np.nan), r"position 0: joint 'wrist' at nan is outside"),
    ],
)
def test_positions_that_cannot_be(positions: np.ndarray, message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        frequency_response(built(CRANE), positions, np.array([10.0]))


def test_joint_origins_run_from_base_to_tool() -> None:
    robot = built(PENDULUM)
    np.testing.assert_allclose(
        joint_origins(robot, np.array([0.5])), [[0, 0, 0], [0, 0, 1], [0, 0, 1]]
    )
    points = joint_origins(built(WALL), np.zeros(5))
    assert points.shape[1] == 3
    assert not points[0].any()
    with pytest.raises(InvalidInput, match=r"\(Q, 5\) is needed"):
        joint_origins(built(WALL), np.zeros(4))


def test_joint_origins_leave_other_branches_out(tmp_path: Path) -> None:
    """Whether they move (the lamp) or are locked and come last in the file (the plate)."""
    points = joint_origins(built(CRANE), np.zeros(5))
    origins = built(CRANE).rigid
    names = ["turn", "slide", "lean", "wrist"]
    assert len(points) == 1 + len(names) + 1
    data = origins.createData()
    pin.forwardKinematics(origins, data, pin.neutral(origins))
    for point, name in zip(points[1:-1], names, strict=True):
        np.testing.assert_allclose(point, data.oMi[origins.getJointId(name)].translation)
    np.testing.assert_allclose(points[-1], points[-2])  # the hand
    text = (HERE / "crane.urdf").read_text().replace('"lamp"', '"zz"').replace('"nod"', '"zz_nod"')
    (tmp_path / "renamed.urdf").write_text(text)
    motors = [m for m in CRANE["motors"] if m["joint"] != "nod"]
    lock = CRANE["lock"] | {"zz_nod": 1.0}
    renamed = changed(CRANE, urdf=str(tmp_path / "renamed.urdf"), motors=motors, lock=lock)
    np.testing.assert_allclose(joint_origins(built(renamed), np.zeros(4)), points, atol=1e-12)


def test_an_undriven_joint_can_rest_on_its_drive_spring() -> None:
    """A spring between links instead of a gear: its joint has no motor and no position."""
    motors = [m for m in WALL["motors"] if m["joint"] != "wrist_2_joint"]
    robot = built(changed(WALL, motors=motors))
    network = robot.network(np.zeros((1, 4)))
    spring = [s.name for s in robot.file.springs].index("d5")
    assert network.nodes[spring].tolist() == [robot.coordinate_names.index("wrist_2_joint"), -1]


def test_a_joint_needs_a_motor_a_spring_or_a_lock() -> None:
    motors = [m for m in WALL["motors"] if m["joint"] != "wrist_1_joint"]
    with pytest.raises(
        InvalidInput, match=r"without motor or drive spring: wrist_1_joint; give each"
    ):
        built(changed(WALL, motors=motors))
