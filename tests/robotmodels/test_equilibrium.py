"""Static equilibria against closed forms, and springs that are too weak."""

import re

import numpy as np
import pytest
from robots import CRANE, PENDULUM, SPLIT, WALL, built, changed, with_spring
from scipy.optimize import brentq

from robotmodels import NoEquilibrium, frequency_response, linearize
from robotmodels.elastic.dynamics import gravity

GRAVITY_TORQUE = 4 * 9.81 * 0.5  # of the level pendulum [N m]


@pytest.mark.parametrize("angle", [-1.8, -0.4, 0.0, 1.0, 1.8])
def test_the_pendulum_sags_by_its_torque_over_its_stiffness(angle: float) -> None:
    at = built(PENDULUM).equilibrium(np.array([[angle]]))
    sag = brentq(lambda x: 5e3 * x + GRAVITY_TORQUE * np.cos(angle + x), -0.1, 0.1, xtol=1e-15)
    np.testing.assert_allclose(at.elongations, [[sag]], rtol=0, atol=1e-13)
    np.testing.assert_allclose(at.coordinates, [[angle + sag]], rtol=1e-14)
    np.testing.assert_array_equal(at.slopes, [[5e3]])


@pytest.mark.parametrize("angle", [-0.4, 0.0, 1.0])
def test_a_hardening_pendulum_sags_along_its_cubic(angle: float) -> None:
    stiffness = {"low": 500.0, "high": 2000.0, "torque": 15.0}
    at = built(with_spring(PENDULUM, "g", stiffness=stiffness)).equilibrium(np.array([[angle]]))
    knee = 3 * 15.0 / (2 * 500 + 2000)
    kappa = 1500 / (3 * knee**2)
    sag = brentq(
        lambda x: 500 * x + kappa * x**3 + GRAVITY_TORQUE * np.cos(angle + x), -0.1, 0.1, xtol=1e-15
    )
    np.testing.assert_allclose(at.elongations, [[sag]], rtol=0, atol=1e-13)
    np.testing.assert_allclose(at.slopes, [[500 + 3 * kappa * sag**2]], rtol=1e-10)


@pytest.mark.parametrize("content", [SPLIT, WALL, CRANE], ids=lambda c: c["name"])
def test_springs_and_gravity_balance(content: dict) -> None:
    robot = built(content)
    rng = np.random.default_rng(1)
    positions = rng.uniform(*robot.position_limits.T, (20, len(robot.motor_names)))
    at = robot.equilibrium(positions)
    torques = robot.elements.laws(robot.parameters.values)(at.elongations)[0]
    load = gravity(robot.arm, at.coordinates).torques
    for i, name in enumerate(s.name if s.axis != "drive" else s.joint for s in robot.file.springs):
        c = robot.arm.coordinate[name]
        np.testing.assert_allclose(
            load[:, c], -torques[:, i], rtol=0, atol=1e-9 * np.abs(load).max()
        )


def test_positions_do_not_influence_each_other() -> None:
    robot = built(SPLIT)
    positions = np.random.default_rng(2).uniform(-2, 2, (6, 6))
    together = robot.equilibrium(positions).coordinates
    alone = np.concatenate([robot.equilibrium(p[None]).coordinates for p in positions])
    np.testing.assert_allclose(together, alone, rtol=0, atol=1e-13)


def test_rigid_drives_stay_where_they_are() -> None:
    robot = built(WALL)
    positions = np.random.default_rng(3).uniform(-2, 2, (5, len(robot.motor_names)))
    at = robot.equilibrium(positions).coordinates
    lift = robot.motor_joints.index("shoulder_lift_joint")
    np.testing.assert_array_equal(
        at[:, robot.arm.coordinate["shoulder_lift_joint"]], positions[:, lift]
    )


def test_without_gravity_nothing_sags() -> None:
    robot = built(changed(CRANE, gravity=[0.0, 0.0, 0.0]))
    assert not robot.equilibrium(np.full((1, 5), 0.2)).elongations.any()


def test_a_weak_spring_is_named_with_its_joint_the_position_and_the_torque() -> None:
    robot = built(with_spring(SPLIT, "d2", stiffness=50.0))
    positions = np.zeros((3, 6))
    positions[:, 1] = [-np.pi / 2, 0.0, -np.pi / 2]  # upright, level, upright
    with pytest.raises(NoEquilibrium) as error:
        frequency_response(robot, positions, np.array([10.0]))
    message = str(error.value)
    torque = gravity(robot.arm, np.zeros((1, robot.arm.model.nv))).torques
    load = abs(torque[0, robot.arm.coordinate["shoulder_lift_joint"]])
    assert "position 1, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]" in message
    assert "spring 'd2' of joint 'shoulder_lift_joint' yields" in message
    assert f"gravity torque of {load:.4g} N m" in message
    assert "\n" not in message


@pytest.mark.parametrize("share", [0.9, 1.0])
def test_an_upright_pendulum_on_a_weak_spring_is_not_stable(share: float) -> None:
    falling = -gravity(built(PENDULUM).arm, np.array([[np.pi / 2]])).slopes[0, 0, 0]
    assert falling == pytest.approx(GRAVITY_TORQUE)
    weak = built(with_spring(PENDULUM, "g", stiffness=share * falling))
    with pytest.raises(
        NoEquilibrium, match=r"not stable: gravity overcomes spring 'g' of joint"
    ) as e:
        linearize(weak, np.array([np.pi / 2]))
    assert re.search(r"its torque of \S+ N m there rises faster than the spring's", str(e.value))


def test_what_bends_the_spring_of_a_prismatic_joint_is_a_force() -> None:
    weak = built(with_spring(CRANE, "ds", stiffness=50.0))
    middle = weak.position_limits.mean(axis=1)
    with pytest.raises(NoEquilibrium, match=r"'ds' of joint 'slide' .* gravity force of \S+ N; "):
        weak.equilibrium(middle[None])


def test_an_upright_pendulum_on_a_strong_spring_is_stable() -> None:
    strong = built(with_spring(PENDULUM, "g", stiffness=1.1 * GRAVITY_TORQUE))
    stiffness = linearize(strong, np.array([np.pi / 2])).stiffness
    assert stiffness[0, 0] == pytest.approx(0.1 * GRAVITY_TORQUE)


@pytest.mark.parametrize("angle", [1.275, 1.725])
def test_a_spring_that_gravity_nearly_overcomes_is_no_less_accurate(angle: float) -> None:
    weak = built(with_spring(PENDULUM, "g", stiffness=1.5 * GRAVITY_TORQUE))
    at = weak.equilibrium(np.array([[angle]]))
    sag = brentq(lambda x: 1.5 * x + np.cos(angle + x), -0.5, 0.5, xtol=1e-15)
    np.testing.assert_allclose(at.elongations, [[sag]], rtol=0, atol=5e-14)


@pytest.mark.parametrize("angle", [0.0, 0.7, 1.4])
def test_a_gear_with_a_soft_start_carries_its_load(angle: float) -> None:
    stiffness = {"low": 20.0, "high": 1e4, "torque": 5.0}
    robot = built(with_spring(PENDULUM, "g", stiffness=stiffness))
    at = robot.equilibrium(np.array([[angle]]))
    torque = robot.elements.laws(robot.parameters.values)(at.elongations)[0]
    load = GRAVITY_TORQUE * np.cos(angle + at.elongations)
    np.testing.assert_allclose(torque, -load, rtol=0, atol=1e-9)
