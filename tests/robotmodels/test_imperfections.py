"""Friction, backlash, hardening gears, encoders, disturbances and torque limits of a plant."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from simulated import T, errors, frf, pendulum, records_of

import robotmodels
from robotmodels import Imperfections, InvalidInput
from robotmodels.simulation.imperfections import IDEAL


def test_friction_holds_a_motor_that_pushes_too_little() -> None:
    robot = pendulum(coulomb=0.2)
    stuck = records_of(robot, np.zeros(1), samples=500, imperfections=Imperfections())
    assert np.abs(stuck.torque - stuck.torque.mean()).max() < 0.2
    assert np.ptp(stuck.angle) < 1e-9
    free = records_of(robot, np.zeros(1), samples=500, imperfections=Imperfections(friction=0.0))
    assert np.ptp(free.angle) > 1e-5


def test_friction_opposes_motion_with_its_torque() -> None:
    robot = pendulum(coulomb=0.2)
    r = records_of(
        robot, np.zeros(1), amplitude=20.0, lines=np.array([3]), imperfections=Imperfections()
    )
    torque, angle = r.torque[0, 0, 0, 0, :, 0], r.angle[0, 0, 0, 0, :, 0]
    # Over a period all work goes into friction: Coulomb's, viscous, a little in the gear.
    moved = np.roll(angle, -1) - angle
    work = torque @ moved - 2e-3 * moved @ moved / T
    assert np.abs(moved).sum() > 1.0
    assert work / np.abs(moved).sum() == pytest.approx(0.2, rel=0.01)


def test_friction_of_coupled_rigid_drives() -> None:
    """All six motors of the r3 stick, three of them coupled through the wrist's inertia."""
    robot = robotmodels.load_robot("manutec_r3")
    stuck, free = (
        records_of(robot, np.zeros(6), samples=400, imperfections=f, experiments=1)
        for f in (Imperfections(), IDEAL)
    )
    assert (np.ptp(stuck.angle, axis=4) < 1e-2 * np.ptp(free.angle, axis=4)).all()
    assert np.ptp(stuck.angle, axis=4).max() < 1e-6


def test_a_motor_within_its_backlash_feels_the_gears_damper_alone() -> None:
    robot = robotmodels.load_robot("moberg_axis1")
    # Without gravity the gear hangs at a flank; a thousandth of its stiffness stands for none.
    flaws = replace(IDEAL, backlash=0.1)
    r = records_of(robot, np.zeros(1), imperfections=flaws, amplitude=1e-3)
    slack = robot.parameters.values.copy()
    slack[robot.parameters.index("g1.stiffness.low")] *= 1e-6
    expected = robotmodels.frequency_response(robot, np.zeros((1, 1)), r.omega, slack)[0]
    assert errors(frf(r), expected)[0] < 1e-3
    tight = robotmodels.frequency_response(robot, np.zeros((1, 1)), r.omega)[0]
    assert errors(frf(r), tight)[0] > 0.1


def test_backlash_under_load_is_crossed_by_large_motions_only() -> None:
    flaws = replace(IDEAL, backlash=2e-4)
    robot = pendulum()
    hanging = np.array([1.5])  # nearly: gravity presses the flanks together, but lightly
    small, large = (
        records_of(robot, hanging, samples=2000, imperfections=flaws, amplitude=a)
        for a in (1e-4, 1.0)
    )
    expected = robotmodels.frequency_response(robot, hanging[None], small.omega)[0]
    assert errors(frf(small), expected)[0] < 2e-4
    assert errors(frf(large), expected)[0] > 1e-2


def test_hardening_gears_are_stiffer_in_large_motions() -> None:
    robot = robotmodels.load_robot("moberg_axis1")
    flaws = replace(IDEAL, nonlinear_gears=True)
    ideal, hard = (
        records_of(robot, np.zeros(1), samples=2000, imperfections=f, amplitude=1.0)
        for f in (IDEAL, flaws)
    )
    assert errors(frf(hard), frf(ideal))[0] > 0.1
    small = records_of(robot, np.zeros(1), samples=2000, imperfections=flaws, amplitude=1e-3)
    assert errors(frf(small), frf(ideal))[0] < 1e-3


def test_encoders_have_steps_and_noise_inside_the_loop() -> None:
    robot = pendulum()
    clean = records_of(robot, np.zeros(1), samples=500)
    step = 2 * np.pi / 4096
    coarse = records_of(
        robot, np.zeros(1), samples=500, imperfections=replace(IDEAL, quantisation=step)
    )
    np.testing.assert_allclose(coarse.angle / step, np.round(coarse.angle / step), atol=1e-9)
    noisy = records_of(
        robot, np.zeros(1), samples=500, periods=8, imperfections=replace(IDEAL, angle_noise=1e-4)
    )
    assert np.std(noisy.angle - clean.angle) == pytest.approx(1e-4, rel=0.1)
    for flawed in (coarse, noisy):
        assert np.std(flawed.torque - clean.torque) > 1e-3  # the controller saw it


def test_a_disturbance_moves_the_motor_unseen() -> None:
    robot = pendulum()
    clean = records_of(robot, np.zeros(1), samples=500)
    pushed = records_of(
        robot, np.zeros(1), samples=500, imperfections=replace(IDEAL, torque_disturbance=0.1)
    )
    assert np.std(pushed.angle - clean.angle) > 1e-4


def test_torque_limits_are_kept_and_told() -> None:
    robot = robotmodels.load_robot("ur5")
    free = records_of(robot, np.zeros(6), samples=500, amplitude=0.3, experiments=1)
    assert not free.saturated.any()
    largest = np.abs(free.torque).max(axis=(0, 1, 2, 3, 4))
    limit = 5.0 * largest
    limit[2] = largest[2] - 0.1 * np.std(free.torque[..., 2])  # holds the weight still
    flaws = replace(IDEAL, torque_limit=limit)
    r = records_of(
        robot, np.zeros(6), samples=500, amplitude=0.3, experiments=1, imperfections=flaws
    )
    assert r.saturated[0, 0, 0, 0].tolist() == [False, False, True, False, False, False]
    assert np.abs(r.torque[..., 2]).max() == limit[2]


@pytest.mark.parametrize(
    ("flaw", "message"),
    [
        ({"friction": -1.0}, "friction -1.0"),
        ({"angle_noise": np.nan}, "angle_noise nan"),
        ({"torque_limit": [1.0, 0.0]}, r"torque_limit \[1.0, 0.0\] is not positive"),
    ],
)
def test_impossible_imperfections(flaw: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        Imperfections(**flaw)
