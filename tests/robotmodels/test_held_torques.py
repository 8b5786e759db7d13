"""Images of held torques against exactly sampled linear runs, and steps that MuJoCo needs."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from estimators import estimate_frf, fit, read_fits, run_spectra, write_fits
from robotmodels import frequency_response, load_robot
from robotmodels.linear.held_torques import held_torque_images
from robotmodels.simulation import simulate_block
from robotmodels.simulation.controller import default_controller
from robotmodels.simulation.imperfections import Imperfections
from robotmodels.simulation.linear_simulation import simulate_linear
from robotmodels.simulation.simulate import simulate

PERIOD, SAMPLE_TIME = 0.5, 0.004
LINES = np.arange(2, 21)  # up to 40 Hz, a sixth of the sampling frequency
OMEGA = 2 * np.pi * LINES / PERIOD
SAMPLES = round(PERIOD / SAMPLE_TIME)


@pytest.fixture(scope="module")
def robot():
    return load_robot("moberg_axis1")


@pytest.fixture(scope="module")
def signals():
    """One period of a multisine of small amplitude, so that gravity and gears stay linear."""
    phases = np.exp(2j * np.pi * np.random.default_rng(0).random(len(LINES)))
    spectrum = np.zeros(SAMPLES // 2 + 1, dtype=complex)
    spectrum[LINES] = 1e-3 * SAMPLES / 2 * phases
    return np.fft.irfft(spectrum, SAMPLES).reshape(1, 1, SAMPLES, 1)


@pytest.fixture(scope="module")
def sampled(robot, signals):
    """Runs of the linear model between samples, by matrix exponentials."""
    model = robot.network(np.zeros((1, 1))).linear_model().at(0)
    controller, rng = default_controller(robot, SAMPLE_TIME), np.random.default_rng(0)
    noise = {"angle_noise": 1e-13, "rng": rng}
    return simulate_linear(model, signals, controller, lines=LINES, transient=40, **noise)


def response_of(records):
    return estimate_frf(records, covariance="noise", structure="diagonal", transient=0)


def images_of(model, **options):
    response = partial(frequency_response, model, np.zeros((1, 1)))
    return held_torque_images(response, OMEGA, SAMPLE_TIME, **options)


def off(found, expected):
    return np.abs(found / expected - 1).max()


def test_frfs_of_held_torques_are_the_model_with_images(robot, sampled):
    measured = response_of(sampled)
    model = frequency_response(robot, measured.positions, OMEGA)
    images = images_of(robot)
    assert off(measured.response, model) > 2e-3
    assert off(measured.response, model + images) < 3e-5
    assert off(measured.without_images(robot, sampled).response, model) < 3e-5
    taken = replace(sampled, command=sampled.torque)  # measured torques were not held
    assert measured.without_images(robot, taken) is measured


def test_those_of_a_free_motor_have_a_closed_form(robot):
    stiffless = robot.network(np.zeros((1, 1)))
    stiffless = replace(
        stiffless,
        stiffness=0 * stiffless.stiffness,
        damping=0 * stiffless.damping,
        spring_stiffness=0 * stiffless.spring_stiffness,
        spring_damping=0 * stiffless.spring_damping,
    )

    class Free:
        parameters = robot.parameters

        def network(self, positions, parameters=None):
            return stiffless

    images = images_of(Free())
    x = OMEGA * SAMPLE_TIME / 2
    expected = x**3 * np.cos(x) / np.sin(x) ** 3 - 1
    relative = images[0, :, 0, 0] / frequency_response(Free(), np.zeros((1, 1)), OMEGA)[0, :, 0, 0]
    assert relative == pytest.approx(expected, rel=5e-3)
    assert expected == pytest.approx(-(x**4) / 15, rel=0.1)


def test_late_outputs_have_late_images(robot):
    late = 0.0013
    plain = images_of(robot)
    delayed = images_of(robot, delay=late)
    # A whole sample late the sampled output is the same one, and so are its images.
    whole = images_of(robot, delay=SAMPLE_TIME)
    assert np.allclose(whole, plain)
    assert not np.allclose(delayed, plain, rtol=0.1)


@pytest.mark.parametrize("data", ["FRFs", "runs"])
def test_fits_of_held_torques_have_the_true_springs(robot, sampled, data):
    truth = robot.parameters.values
    if data == "FRFs":
        estimate = response_of(sampled)
        pair = [estimate.without_images(robot, sampled), estimate]
    else:
        runs = run_spectra(sampled, noise=(1e-6, 1e-9), states="no")
        assert runs.hold_time == SAMPLE_TIME
        pair = [runs, replace(runs, hold_time=0.0)]
    fits = [fit(robot, one, "nls" if data == "FRFs" else None) for one in pair]
    springs = [name.endswith("stiffness") for name in robot.parameters.names]
    right, wrong = (np.abs(one.parameters.values / truth - 1)[springs].max() for one in fits)
    assert right < 1e-4
    assert wrong > 5 * right


def test_stored_fits_of_runs_have_their_data(robot, sampled, tmp_path):
    runs = run_spectra(sampled, noise=(1e-6, 1e-9), states="no")
    found = fit(robot, runs)
    write_fits(tmp_path / "fits.h5", [found])
    (again,) = read_fits(tmp_path / "fits.h5", robot, runs)
    residuals, _ = again.problem.evaluate(again.parameters.values)
    assert residuals @ residuals == pytest.approx(found.cost, rel=1e-6)


def test_mujoco_takes_steps_that_are_accurate_at_the_lines(robot, signals, monkeypatch):
    def simulated():
        options = {
            "lines": LINES,
            "imperfections": Imperfections(angle_noise=1e-13),
            "transient": 40,
        }
        controller, rng = default_controller(robot, SAMPLE_TIME), np.random.default_rng(0)
        runs = simulate(robot, np.zeros((1, 1)), signals, controller, rng=rng, **options)
        return response_of(next(iter(runs))).response

    expected = frequency_response(robot, np.zeros((1, 1)), OMEGA)
    expected = expected + images_of(robot)
    assert off(simulated(), expected) < 2e-4
    # As many steps as lines need, not as the robot's shape does.
    monkeypatch.setattr(simulate_block, "_LONGEST", np.inf)
    accurate = off(simulated(), expected)
    assert accurate < 2e-4
    monkeypatch.setattr(simulate_block, "_ACCURACY", np.inf)  # what is stable is not enough
    assert off(simulated(), expected) > 5 * accurate
