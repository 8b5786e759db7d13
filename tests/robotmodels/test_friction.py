"""Friction of motors and joints: closed forms, Monte Carlo, and MuJoCo in closed loop."""

from typing import Any

import numpy as np
import pytest
from derivatives import apart, frf_derivatives, information_of
from robots import CRANE, PENDULUM, built, changed
from simulated import T, errors, frf, records_of

import robotmodels
from robotmodels import ElasticRobot, Imperfections, InvalidInput, kernel
from robotmodels.description.friction import (
    equivalent_dampers,
    equivalent_damping,
    friction_sentences,
    shaft_friction,
)
from robotmodels.elastic.inverse_dynamics import movement_torques
from robotmodels.exports.formats import left_out
from robotmodels.linear.noise import RelativeNoise

REST = np.zeros((1, 1))
FRICTION = Imperfections(nonlinear_gears=False)


def pendulum(motor: dict[str, Any] | None = None, **friction: Any) -> ElasticRobot:
    entry = {"name": "f", "joint": "hinge"} | friction
    motors = [PENDULUM["motors"][0] | (motor or {})]
    return built(changed(PENDULUM, motors=motors, friction=[entry] if friction else []))


@pytest.mark.parametrize("width", [0.0, 0.003, 0.1, 30.0])
def test_the_equivalent_damper_is_the_best_linear_substitute(width: float) -> None:
    speeds = 0.1 * np.random.default_rng(0).standard_normal(400_000)
    torque = 5.0 * (np.tanh(speeds / width) if width else np.sign(speeds))
    expected = torque @ speeds / (speeds @ speeds)
    assert equivalent_damping(5.0, width, 0.1) == pytest.approx(expected, rel=5e-3)
    assert equivalent_damping(5.0, width, None) == 0.0
    if width == 30.0:  # far below its width it is viscous
        assert equivalent_damping(5.0, width, 0.1) == pytest.approx(5.0 / 30.0, rel=1e-4)


def test_friction_of_a_joint_acts_behind_its_spring() -> None:
    robot = pendulum(viscous=30.0, coulomb=2.0, coulomb_speed=0.1)
    at = robotmodels.linearize(robot, REST)
    plain = robotmodels.linearize(pendulum(), REST)
    change = (at.damping - plain.damping)[0]
    equivalent = equivalent_damping(2.0, 1e-3, 0.1)
    np.testing.assert_allclose(change, np.diag([30.0 + equivalent, 0.0]), rtol=1e-12, atol=1e-12)
    shaft = pendulum({"coulomb": 0.1, "coulomb_speed": 4.0})
    change = (robotmodels.linearize(shaft, REST).damping - plain.damping)[0]
    equivalent = 0.1 * np.sqrt(2 / np.pi) / 4.0 * 50.0**2
    np.testing.assert_allclose(change, np.diag([0.0, equivalent]), rtol=1e-9, atol=1e-12)


def test_free_friction_of_joints_has_exact_derivatives_also_on_the_fast_path() -> None:
    crane = changed(CRANE)
    sprung = next(s["joint"] for s in crane["springs"] if s["axis"] == "drive")
    crane["friction"] = [{"name": "f", "joint": sprung, "viscous": 9.0}]
    crane["parameters"] = {"extra": ["f.viscous", f"{crane['motors'][0]['name']}.inertia"]}
    robot = built(crane)
    assert robot.elements.inertial_names == (crane["motors"][0]["name"], "f")
    positions = robot.position_limits.mean(axis=1)[None] * [[0.3], [0.8]]
    omega = 2 * np.pi * np.geomspace(3, 60, 8)
    check_sensitivity(robot, positions, omega)
    check_fast_path(robot, positions, omega)


def check_sensitivity(robot: ElasticRobot, positions: np.ndarray, omega: np.ndarray) -> None:
    """Each column of the sensitivity is its difference."""
    _, J = robotmodels.sensitivity(robot, positions, omega)
    changes = frf_derivatives(robot, positions, omega, 1e-4)
    size = np.abs(changes).max(axis=(0, 1, 2, 3))
    np.testing.assert_allclose(J / size, changes / size, rtol=0, atol=1e-6)


def check_fast_path(robot: ElasticRobot, positions: np.ndarray, omega: np.ndarray) -> None:
    """The kernel's information at fixed equilibria is that of the sensitivities there."""
    G, J = robotmodels.sensitivity(robot, positions, omega, equilibrium_shift=False)
    fast = kernel.information(robot.network(positions), omega, RelativeNoise())
    assert apart(fast, information_of(J, RelativeNoise().variance(G))) < 1e-9


def test_viscous_friction_of_a_joint_is_that_of_the_simulation() -> None:
    robot = pendulum(viscous=60.0)
    response = frf(records_of(robot, np.zeros(1), transient=6))
    omega = records_of(robot, np.zeros(1), transient=1).omega
    expected = robotmodels.frequency_response(robot, REST, omega)[0]
    assert errors(response, expected)[0] < 2e-3
    without = robotmodels.frequency_response(pendulum(), REST, omega)[0]
    assert errors(response, without)[0] > 0.1


def loaded(**friction: Any) -> ElasticRobot:
    entry = {"name": "f", "joint": "hinge", "load": 0.5, "coulomb_speed": 0.05} | friction
    payload = {"link": "rod", "mass": 1.0, "com": [0.4, 0, 0], "inertia": [0.01, 0.01, 0.01]}
    soft = {**PENDULUM["springs"][0], "stiffness": 300.0}
    return built(
        changed(
            PENDULUM, friction=[entry], payload=payload, springs=[soft],
            parameters={"extra": ["payload.mass", "f.viscous"]},
        )
    )  # fmt: skip


TILTED = np.array([[0.0], [0.7]])


def test_friction_by_the_load_counts_in_each_position() -> None:
    robot, without = loaded(viscous=2.0, coulomb=1.0), loaded(viscous=2.0, coulomb=1.0, load=0.0)
    change = robotmodels.linearize(robot, TILTED).damping
    change = change - robotmodels.linearize(without, TILTED).damping
    angle = robot.equilibrium(TILTED).coordinates[:, 0]
    torque = 9.81 * (4.0 * 0.5 + 0.4) * np.cos(angle)
    expected = 0.5 * torque * np.sqrt(2 / np.pi) / 0.05
    np.testing.assert_allclose(change[:, 0, 0], expected, rtol=1e-3)  # of the width and of g
    assert np.count_nonzero(change) == 2
    (sentence,) = [w for w in friction_sentences(robot.file) if "more for each N m" in w]
    assert "counts as 15.9" in sentence


def test_friction_by_the_load_has_exact_derivatives_also_on_the_fast_path() -> None:
    """Gravity's torque changes with the payload, and with springs that sag."""
    robot, omega = loaded(viscous=2.0), 2 * np.pi * np.geomspace(0.5, 20, 8)
    check_sensitivity(robot, TILTED, omega)
    fixed = built({**robot.file.model_dump(by_alias=True, exclude_unset=True), "parameters": {}})
    check_fast_path(fixed, TILTED, omega)


@pytest.mark.parametrize("where", ["motor", "joint", "load"])
def test_coulomb_friction_counts_as_the_damper_of_its_excitation(where: str) -> None:
    if where == "motor":
        robot = pendulum({"coulomb": 0.3, "coulomb_width": 0.05})
    elif where == "joint":
        robot = pendulum(coulomb=15.0, coulomb_width=1e-3)
    else:  # 4 kg at 0.5 m
        robot = pendulum(load=15.0 / (4.0 * 9.81 * 0.5), coulomb_width=1e-3)
    records = records_of(
        robot, np.zeros(1), transient=6, amplitude=0.05, samples=8000, imperfections=FRICTION
    )
    speed = np.gradient(records.angle[0, 0, 0, 0, :, 0], T)
    counted = robotmodels.with_speeds(robot, np.array([speed.std()]))
    responses = frf(records)
    expected, without = (
        robotmodels.frequency_response(r, REST, records.omega)[0] for r in (counted, robot)
    )
    misfits = [np.median(np.abs(responses / other - 1)) for other in (expected, without)]
    assert misfits[0] < 0.4 * misfits[1]
    assert misfits[0] < 1e-3 or where == "motor"
    (damper,) = equivalent_dampers(counted.file)
    assert damper.dominates or where == "load"
    assert damper.speed == pytest.approx(speed.std() / (1 if where == "motor" else 50))


def test_friction_by_the_load_and_in_inverse_dynamics() -> None:
    robot = pendulum(viscous=3.0, coulomb=1.0, load=0.1)
    time = np.arange(0, 1, 0.01)
    angle = (0.3 * np.sin(6 * time))[:, None]
    speed, acceleration = 6 * (0.3 * np.cos(6 * time))[:, None], -36 * angle
    torques = movement_torques(robot, angle, speed, acceleration)
    level = 1.0 + 0.1 * np.abs(torques.links)
    expected = 3.0 * speed + level * np.tanh(speed / 1e-3)
    np.testing.assert_allclose(torques.friction, expected, rtol=1e-12)
    tilted = np.full(1, 0.6)
    swings = [
        np.ptp(records_of(r, tilted, samples=1000, amplitude=2e-3, imperfections=FRICTION).angle)
        for r in (pendulum(coulomb=1e-3), pendulum(coulomb=1e-3, load=0.3))
    ]
    assert swings[1] < swings[0]


def test_torques_of_motors_overcome_the_friction_of_their_joints() -> None:
    robot = pendulum({"coulomb": 0.1}, coulomb=2.0)
    np.testing.assert_allclose(shaft_friction(robot.file), [0.1 + 2.0 / 50])


def test_formats_say_what_of_friction_they_cannot_hold() -> None:
    robot = pendulum({"coulomb": 0.1}, coulomb=1.0, load=0.1)
    assert "Coulomb friction of joint hinge" in left_out(robot.file, "state_space")
    assert "Coulomb friction of motor m" in left_out(robot.file, "modes")
    lines = left_out(robot.file, "mjcf")
    assert "smooth onset of Coulomb friction of joint hinge" in lines
    assert "Coulomb friction by the load of joint hinge" in lines


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"friction": [{"name": "f", "joint": "hing"}]}, "did you mean 'hinge'"),
        ({"friction": [{"name": "f", "joint": "hinge"}] * 2}, "used 2 times|2 entries"),
        (
            {"friction": [{"name": "f", "joint": "hinge", "coulomb_width": 0}]},
            "greater than or equal to",
        ),
    ],
)
def test_entries_that_cannot_be(change: dict[str, Any], message: str) -> None:
    with pytest.raises((InvalidInput, ValueError), match=message):
        built(changed(PENDULUM, **change))


def test_friction_of_rigid_drives_is_the_motors() -> None:
    robot = robotmodels.load_robot("kr300")
    content = robot.file.model_dump(by_alias=True)
    content["friction"] = [{"name": "f", "joint": "joint5", "viscous": 1.0}]
    with pytest.raises(InvalidInput, match=r"driven rigidly.*motor 'm5'"):
        ElasticRobot(type(robot.file).model_validate(content), robot.folder)
    with pytest.raises(InvalidInput, match="one per motor"):
        robotmodels.with_speeds(robot, np.array([1.0, 2.0]))


@pytest.mark.parametrize("disturbance", [0.0, 0.02])
def test_links_that_motors_drive_rigidly_feel_sharp_friction(disturbance: float) -> None:
    """A gyroscope reads the motion alone, an accelerometer what MuJoCo makes of the forces."""
    arm, tilt = [0.4, 0.0, 0.0], [0.0, -1.0, 0.0]
    outputs = [
        {"motor": "m", "quantity": "angle"},
        {"link": "rod", "quantity": "angular_velocity", "direction": tilt},
        {"link": "rod", "quantity": "acceleration", "at": arm, "direction": [0, 0, 1]},
    ]
    motors = [PENDULUM["motors"][0] | {"coulomb": 0.2}]
    sideways = {"name": "b", "joint": "hinge", "axis": "x", "stiffness": 1e5, "damping": 50.0}
    robot = built(
        changed(PENDULUM, motors=motors, springs=[sideways], gravity=[0, 0, 0], outputs=outputs)
    )
    flaws = Imperfections(friction=1.0, torque_disturbance=disturbance)
    records = records_of(robot, REST, amplitude=1.0, imperfections=flaws)
    spectrum = np.fft.rfft(records.angle[0, 0, 0, -1], axis=0)[1:400]
    omega = 2 * np.pi * np.arange(1, 400) / (records.samples * T)
    tangential = 1j * omega * spectrum[:, 1] * 0.4
    assert np.abs(spectrum[:, 2] - tangential).max() < 2e-3 * np.abs(tangential).max()
