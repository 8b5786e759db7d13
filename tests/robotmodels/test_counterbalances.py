"""Counterbalances against finite differences, energies from kinematics, and each other."""

from copy import deepcopy
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from robots import BALANCED, CRANE, built, changed
from simulated import frf, records_of

import robotmodels
from robotmodels import ElasticRobot, InvalidInput
from robotmodels.elastic.dynamics import gravity, gravity_torques
from robotmodels.elastic.rigid_pose import configurations, holding_torques, unloaded
from robotmodels.exports.formats import left_out

POINTS = BALANCED["counterbalances"][1]["spring"]["points"]
ANGLES = np.linspace(-2 * np.pi, 2 * np.pi, 400).tolist()
LAWS: dict[str, dict[str, Any]] = {
    "sinusoid": {"sinusoid": {"amplitude": 90.0, "phase": 0.4}},
    "spring": {"spring": BALANCED["counterbalances"][1]["spring"]},
    "pulling": {"gas": {"points": POINTS, "force": 700.0, "length": 0.5, "column": 0.6}},
    "pushing": {"gas": {"points": POINTS, "force": -700.0, "length": 0.5, "column": 0.6}},
    "table": {"table": {"angles": ANGLES, "torques": (80 * np.sin(ANGLES)).tolist()}},
}


def balanced(law: dict[str, Any], joint: str = "elbow_joint") -> ElasticRobot:
    entry = {"name": "b", "joint": joint} | law
    return built(changed(BALANCED, counterbalances=[entry], parameters={}))


@pytest.mark.parametrize("name", LAWS)
def test_slopes_are_those_of_the_torques(name: str) -> None:
    arm = balanced(LAWS[name]).arm
    q = np.random.default_rng(0).uniform(-2, 2, (5, arm.size))
    here = gravity(arm, q)
    for j, e in enumerate(1e-5 * np.eye(arm.size)):
        change = (gravity_torques(arm, q + e) - gravity_torques(arm, q - e)) / 2e-5
        np.testing.assert_allclose(here.slopes[:, :, j], change, rtol=1e-7, atol=1e-6)
    shift = np.random.default_rng(1).standard_normal(q.shape)
    product = np.einsum("qij,qj->qi", here.slopes, shift)
    np.testing.assert_allclose(here.slopes_times(shift), product, rtol=1e-12, atol=1e-10)
    assert np.all(here.slope_bounds >= np.abs(here.slopes).sum(axis=2) - 1e-9)


@pytest.mark.parametrize("name", ["spring", "pulling", "pushing"])
def test_torques_come_from_the_work_between_two_points(name: str) -> None:
    robot, plain = balanced(LAWS[name]), built(changed(BALANCED, counterbalances=[], parameters={}))
    positions = np.random.default_rng(2).uniform(-2, 2, (6, 3))
    torque = gravity_torques(plain.arm, positions) - gravity_torques(robot.arm, positions)
    step = np.array([0.0, 0.0, 1e-6])
    lengths = [distances(robot, p) for p in (positions - step, positions, positions + step)]
    (law,) = LAWS[name].values()
    if name == "spring":
        pull = law["preload"] + law["stiffness"] * (lengths[1] - law["rest_length"])
    else:  # of the volume of the gas
        into_gas = np.sign(law["force"]) * (lengths[1] - law["length"])
        pull = law["force"] * (1 - into_gas / law["column"]) ** -1.2
    expected = -pull * (lengths[2] - lengths[0]) / 2e-6
    np.testing.assert_allclose(torque[:, 2], expected, rtol=1e-7, atol=1e-6)
    np.testing.assert_allclose(torque[:, :2], 0.0, atol=1e-9)


def distances(robot: ElasticRobot, positions: np.ndarray) -> np.ndarray:
    """Return how far the two points are apart, by Pinocchio's kinematics."""
    data = robot.rigid.createData()
    lengths = []
    for q in configurations(robot, positions):
        pin.framesForwardKinematics(robot.rigid, data, q)
        frames = [data.oMf[robot.rigid.getFrameId(p["link"], pin.BODY)] for p in POINTS]
        ends = [f.act(np.array(p["at"])) for f, p in zip(frames, POINTS, strict=True)]
        lengths.append(np.linalg.norm(ends[1] - ends[0]))
    return np.array(lengths)


def test_equilibria_balance_and_free_amplitudes_have_exact_derivatives() -> None:
    robot = built(BALANCED)
    positions = np.random.default_rng(3).uniform(-2, 2, (4, 3))
    at = robot.equilibrium(positions)
    torques = gravity_torques(robot.arm, at.coordinates)
    np.testing.assert_allclose(torques, -2e4 * at.elongations, rtol=0, atol=1e-6)
    omega = 2 * np.pi * np.array([3.0, 9.0, 20.0])
    _, J = robotmodels.sensitivity(robot, positions, omega)
    theta = robot.parameters.values
    for name in ("lift.amplitude", "cylinder.stiffness", "cylinder.preload"):
        j = robot.parameters.names.index(name)
        plus, minus = (
            robotmodels.frequency_response(
                robot, positions, omega, parameters=theta * np.exp(h * (np.arange(len(theta)) == j))
            )
            for h in (1e-3, -1e-3)
        )
        change = (plus - minus) / 2e-3
        np.testing.assert_allclose(J[..., j], change, rtol=0, atol=2e-6 * np.abs(change).max())


def test_a_counterbalance_takes_torque_from_its_motor() -> None:
    robot, plain = (
        balanced(LAWS["sinusoid"]),
        built(changed(BALANCED, counterbalances=[], parameters={})),
    )
    positions = np.array([[0.2, -1.0, 0.7]])
    torques = [holding_torques(r, unloaded(r, positions))[0] for r in (plain, robot)]
    np.testing.assert_allclose(torques[0] - torques[1], [0, 0, 90 * np.sin(1.1) / 101], atol=1e-12)


def test_a_simulation_feels_tables_and_springs_alike() -> None:
    position = np.array([[0.3, -1.0, 0.9]])
    spring = balanced(LAWS["spring"])
    torque, angles = spring.arm.counterbalances[0].law, np.linspace(-2 * np.pi, 2 * np.pi, 2000)
    table = {"table": {"angles": angles.tolist(), "torques": torque(angles)[0].tolist()}}
    responses = [
        frf(records_of(robot, position, transient=8)) for robot in (spring, balanced(table))
    ]
    np.testing.assert_allclose(
        responses[1], responses[0], rtol=0, atol=1e-4 * np.abs(responses[0]).max()
    )


def test_mjcf_says_what_it_cannot_hold() -> None:
    robot = balanced(LAWS["table"])
    (line,) = [x for x in left_out(robot.file, "mjcf") if "b:" in x]
    assert "counterbalance b" in line


ENTRY = {"name": "b", "joint": "elbow_joint"}


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        (ENTRY, "exactly one of sinusoid, spring, gas and table"),
        (ENTRY | {"joint": "elbow"} | LAWS["sinusoid"], "did you mean 'elbow_joint'"),
        (ENTRY | {"joint": "wrist_1_joint"} | LAWS["sinusoid"], "held under 'lock'"),
        (ENTRY | {"joint": "shoulder_pan_joint"} | LAWS["spring"], "two sides of joint"),
        (
            ENTRY | {"table": {"angles": [0, 1, 2, 3], "torques": [0] * 4}},
            "its table covers 0 to 3",
        ),
        (ENTRY | {"table": {"angles": [0, 1, 1, 3], "torques": [0] * 4}}, "each must be larger"),
        (ENTRY | {"table": {"angles": [0, 1, 2, 3], "torques": [0] * 5}}, "4 angles and 5 torques"),
        (ENTRY | {"name": "elbow_joint"} | LAWS["sinusoid"], "the name of a joint"),
    ],
)
def test_entries_that_cannot_be(entry: dict[str, Any], message: str) -> None:
    with pytest.raises((InvalidInput, ValueError), match=message):
        built(changed(BALANCED, counterbalances=[entry], parameters={}))


def test_a_point_on_the_axis_or_a_joint_that_slides() -> None:
    law = deepcopy(LAWS["spring"])
    law["spring"]["points"][1]["at"] = [0.0, 0.0, 0.0]
    with pytest.raises(InvalidInput, match="on the joint's axis"):
        balanced(law)
    entry = {"name": "b", "joint": "slide"} | LAWS["sinusoid"]
    with pytest.raises(InvalidInput, match="joint 'slide' slides"):
        built(changed(CRANE, counterbalances=[entry]))


def test_kr300_has_the_published_modes_and_gravity() -> None:
    robot = robotmodels.load_robot("kr300")
    payload = robot.file.payload
    assert payload is not None
    # The authors' model has one body of 150 kg at z = 0.1 m instead of flange and load.
    flange = 17.78
    mass = 150.0 - flange
    com = (0.0, 0.0, (150 * 0.1 + flange * 0.05) / mass)
    body = payload.model_copy(update={"mass": mass, "com": com})
    file = robot.file.model_copy(update={"payload": body})
    start = np.radians([[0, -90, 90, 0, 0, 0]])
    torques = gravity_torques(ElasticRobot(file, robot.folder).arm, start)[0]
    published = np.array([0, -1994.90909, -2629.96584, -25.0410060, -503.087603, 0])
    np.testing.assert_allclose(np.delete(torques - published, 1), 0, atol=2e-5)
    assert abs(torques[1] - published[1]) < 6.0  # the sinusoid instead of the cylinder
    # With the wrist locked and 150 kg beside the flange: 18.4, 18.9 and 28.1 Hz.
    body = payload.model_copy(update={"mass": 150.0})
    file = robot.file.model_copy(update={"payload": body})
    at = robotmodels.linearize(ElasticRobot(file, robot.folder), start)
    locked = np.ix_([0, 1, 2, 6, 7, 8], [0, 1, 2, 6, 7, 8])
    poles = np.linalg.eigvals(np.linalg.solve(at.mass[0][locked], at.stiffness[0][locked]))
    hertz = np.sort(np.sqrt(np.abs(poles)))[3:] / (2 * np.pi)
    np.testing.assert_allclose(hertz, [18.4, 18.9, 28.1], atol=0.05)
