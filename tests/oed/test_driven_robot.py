"""Friction that plans of visits heed, against simulated visits."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from axis_campaign import TRUTH, write_campaign

from estimators import run_spectra
from oed import Campaign, simulate_visits
from oed.campaign.driven_robot import (
    driven,
    driven_by,
    net_torques,
    rms_speeds,
    write_visit_files,
)
from oed.campaign.visit_plan import visit_spectrum
from oed.experiment.draw_plan import experiment_plan
from oed.experiment.multisine import Multisine
from oed.experiment.prepare import controller_of
from oed.information_sets.excitations import Zippered
from robotmodels import InvalidInput, load_robot, save_robot, with_speeds
from robotmodels.simulation.controller import default_controller
from robotmodels.simulation.loop_noise import closed_loop

LEVEL = 0.6
"""About the root mean square of the torques [N m]."""


def test_torques_less_friction_are_the_planned_ones(tmp_path: Path) -> None:
    """As dampers at the plan's speeds friction is heeded; left out, torques seem far larger."""
    path = write_campaign(tmp_path, ("friction: 0", "friction: 1"))
    robot = load_robot(TRUTH)
    motors = [motor.model_copy(update={"coulomb": LEVEL}) for motor in robot.file.motors]
    robot = replace(robot, file=robot.file.model_copy(update={"motors": motors}))
    save_robot(robot, tmp_path / "guesses.yaml")
    for _ in range(2):
        campaign = Campaign.load(path)
        visits = campaign.ask()
        simulate_visits(campaign.settings, campaign.robot, robot, visits)
    visit, controller = visits[0], controller_of(campaign.settings, robot)
    data = run_spectra(visit.records, "detection", friction=robot, weak=True)
    assert data.coulomb is not None
    net = data.inputs[0, 0] - LEVEL * data.coulomb.shares[0, 0]
    power = 2 * np.abs(net[:, 0]) ** 2
    planned = visit_spectrum(visit.plan, robot, controller)[:, 0, 0].real
    assert np.sqrt(planned.sum() / power.sum()) == pytest.approx(1, abs=0.05)
    smooth = robot.file.model_copy(update={"motors": load_robot(TRUTH).file.motors})
    ignored = visit_spectrum(visit.plan, replace(robot, file=smooth), controller)[:, 0, 0].real
    assert np.sqrt(ignored.sum() / power.sum()) > 1.1


def test_visits_are_within_limits_at_the_dampers_of_their_speeds(tmp_path: Path) -> None:
    """Smaller amplitudes have larger dampers: of one turn, files were 3 % beyond the limit."""
    path = write_campaign(
        tmp_path,
        ("friction: 0", "friction: 1"),
        ("limits: {", "limits: {torque: 2.0, margin: 0.1, "),
    )
    campaign, robot = Campaign.load(path), load_robot(TRUTH)
    motors = [motor.model_copy(update={"coulomb": 1.0}) for motor in robot.file.motors]
    robot = replace(robot, file=robot.file.model_copy(update={"motors": motors}))
    with campaign._evaluation() as now:
        planner = replace(now.planner, robot=robot)
    plan = planner.plans([(planner.positions[0], Zippered(), 2)])[0]
    files = tmp_path / "files"
    assert write_visit_files(plan, files, campaign.settings, robot) is plan  # which are checked
    larger = write_visit_files(plan.rescaled(np.asarray(1.2)), files, campaign.settings, robot)
    assert 1.0 < larger.scale[0] / plan.scale[0] < 1.2  # the files of a lower one
    with pytest.raises(InvalidInput, match="is beyond its limit"):
        write_visit_files(plan.rescaled(np.asarray(10.0)), files, campaign.settings, robot)


def test_dampers_belong_to_the_speeds_they_leave() -> None:
    """Of sharp friction damper and rms speed make coulomb sqrt(2 / pi); nothing rubs, no damper."""
    robot = load_robot("manutec_r3")
    n = len(robot.motor_names)
    controller = default_controller(robot, 0.002)
    grid = Multisine(500, 0.002, np.arange(5, 60, 2), n).with_amplitudes(np.full((28, n), 20.0))
    rng = np.random.default_rng(1)
    plan = experiment_plan(
        robot, np.zeros((1, n)), grid, blocks=1, periods=2, speed=1.0, acceleration=5.0, rng=rng
    )
    after = driven_by(plan, robot, controller)
    loop = closed_loop(after.network(np.zeros((1, n))), grid.omega, controller)
    R = grid.spectrum(plan.phases[0])[0, ..., : plan.runs] * (2 / grid.samples)
    speeds = rms_speeds(loop.angle[0] @ R, grid.omega)
    pairs = zip(robot.file.motors, after.file.motors, strict=True)
    dampers = [b.viscous - a.viscous for a, b in pairs]
    levels = np.array([motor.coulomb for motor in robot.file.motors])
    assert dampers * speeds == pytest.approx(levels * np.sqrt(2 / np.pi), rel=1e-2)
    assert driven_by(plan, after, controller) is after


def test_friction_that_responses_count_is_no_friction_of_plans() -> None:
    """A robot file's `coulomb_speed` has dampers in the FRF already; elsewhere torques lose it."""
    robot = load_robot("manutec_r3")
    n, speeds = len(robot.motor_names), np.full(len(robot.motor_names), 20.0)
    omega, after = np.array([30.0, 200.0]), driven(robot, speeds)
    loop = closed_loop(after.network(np.zeros((1, n))), omega, default_controller(robot, 0.002))
    counted = with_speeds(robot, speeds)
    assert net_torques(loop, omega, counted, after) == pytest.approx(loop.torque[0], rel=1e-12)
    lost = loop.torque[0] - net_torques(loop, omega, robot, after)
    levels = np.array([motor.coulomb for motor in robot.file.motors])
    friction = 1j * omega[:, None, None] * loop.angle[0] * (levels / 20)[:, None]
    assert lost == pytest.approx(np.sqrt(2 / np.pi) * friction, rel=1e-6)
