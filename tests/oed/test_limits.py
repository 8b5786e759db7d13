"""Limits beside peaks: heat, commands, carriers; judged by simulation sample by sample."""

from dataclasses import replace

import numpy as np
import pytest
from two_axes import CONTROLLER, RATIOS, N, T, TwoAxes, plan, run

from oed import (
    ExperimentPlan,
    Limits,
    band_multisine,
    experiment_plan,
    predicted_peaks,
    scale,
)
from oed.experiment.carrier import Carrier, carrier_in
from oed.experiment.run_experiment import SimulatedPlant
from robotmodels import InvalidInput, frequency_response, load_robot
from robotmodels.simulation.controller import default_controller
from robotmodels.simulation.imperfections import Imperfections

AXES = TwoAxes()
HELD = np.array([[0.4, -0.1], [-0.2, 0.3]])
SPEED = np.array([6.0, 9.0])


SINE = band_multisine(N, T, (2 * np.pi * 10, 2 * np.pi * 60), inputs=2)


def with_carrier(speed=SPEED):
    ramped = plan(multisine=SINE, repetitions=None, transient_periods=1, ramp=True)
    carrier = carrier_in(AXES, ramped.positions, CONTROLLER, speed, None, SINE)
    return replace(ramped, carrier=carrier)


@pytest.mark.parametrize("friction", [0.0, 0.05])
def test_rms_torques_fill_their_limit(friction):
    """The simulated torque's root mean square, gravity included; friction adds at its worst."""
    limit = np.array([0.6, 0.5])
    scaling = scale(
        plan(), AXES, CONTROLLER, Limits(rms_torque=limit), holding=HELD, friction=[friction] * 2
    )
    used = []
    for visit, q in enumerate(scaling.plan.visited):
        torque = run(q, scaling.plan.reference(visit).reshape(-1, N, 2))[0][-N:]
        moving = np.sqrt((torque**2).mean(axis=0)) + friction
        hold = HELD[scaling.plan.visits[visit]]
        used.append((np.hypot(moving, hold) / limit).max())
    assert max(used) == pytest.approx(1, abs=1e-3)
    assert "rms_torque of motor" in str(scaling.binding)
    with pytest.raises(InvalidInput, match=r"limits.rms_torque: position 1: motor 'm1' needs 0.4"):
        scale(plan(), AXES, CONTROLLER, Limits(rms_torque=np.array([0.4, 1.0])), holding=HELD)


@pytest.mark.parametrize(("order", "key"), [(0, "command_speed"), (1, "command_acceleration")])
def test_commands_fill_their_limits(order, key):
    """Steps from sample to sample; the ramp and the fall at the end are among them."""
    limit = np.array([20.0, 30.0]) * 400.0**order
    scaling = scale(
        plan(ramp=True), AXES, CONTROLLER, Limits(**{key: limit}), holding=HELD, per_visit=True
    )
    for visit in range(3):
        runs = scaling.plan.reference(visit)
        played = scaling.plan.played(runs, 3)
        played = np.pad(played, [(0, 0)] * 2 + [(1, 1), (0, 0)])  # from rest to rest
        largest = np.abs(np.diff(played, order, axis=2)).max(axis=(0, 1, 2)) / T**order
        assert (largest / limit).max() == pytest.approx(1, rel=1e-9)


def test_swing_is_a_limit_like_others():
    """The ratios of amplitudes heed it too."""
    limits = Limits(swing=np.array([0.004, 0.01]))
    for balance in (False, True):
        scaling = scale(plan(), AXES, CONTROLLER, limits, holding=HELD, balance=balance)
        used = np.abs(scaling.peaks.swing[:, 2]).max(axis=(0, 2)) / limits.swing
        assert used.max() == pytest.approx(1)
    assert used.min() > 0.7


def test_runs_end_as_they_begin():
    """A quarter of a period falls to zero by no larger steps than the ramp's."""
    ramped = plan(ramp=True)
    period = ramped.reference(0)[0]
    played = ramped.played(period, 3)
    assert played.shape == (2, 3 * N + N // 4, 2)
    np.testing.assert_array_equal(played[:, N : 3 * N], np.tile(period, (1, 2, 1)))
    np.testing.assert_allclose(played[:, -1], 0, atol=1e-3 * np.abs(period).max())
    assert len(plan().fall) == 0
    run_time = (ramped.periods + ramped.transient_periods) * N * T + N // 4 * T
    assert ramped.excitation_duration == pytest.approx(3 * 2 * 2 * run_time)


def test_motors_follow_their_carriers():
    """The simulated speeds have the stated amplitudes, each motor its own phase."""
    carried = with_carrier()
    k = carried.carrier.line
    assert k == 2
    speeds = run(carried.positions[0], carried.reference(0)[0], periods=12)[1]
    last = speeds[-4 * N :].reshape(N, 4, -1, 2)[:, 0]
    spectrum = 2 / N * np.fft.rfft(last, axis=0)[k]
    np.testing.assert_allclose(np.abs(spectrum), np.tile(SPEED, (2, 1)), rtol=2e-3)
    phases = np.angle(spectrum[0, 1] / spectrum[0, 0])
    assert phases == pytest.approx(np.pi / 2, abs=2e-3)
    plain = replace(carried, carrier=None)
    difference = carried.reference(0) - plain.reference(0)
    spectrum = np.abs(np.fft.rfft(difference, axis=2))
    assert np.delete(spectrum, k, axis=2).max() < 1e-9 * spectrum.max()


def test_peaks_have_the_carrier_in_them():
    """No simulated value is beyond the prediction, which is not far above."""
    carried = with_carrier().rescaled(np.full(2, 0.05))
    peaks = predicted_peaks(carried, AXES, CONTROLLER, np.zeros((2, 2)))
    plain = predicted_peaks(replace(carried, carrier=None), AXES, CONTROLLER, np.zeros((2, 2)))
    for visit, q in enumerate(carried.visited):
        played = carried.played(carried.reference(visit).reshape(-1, N, 2), 4)
        torque, speed, angle = run(q, played, periods=1)
        for k, signal in enumerate((torque, speed, angle / RATIOS)):
            largest = np.abs(signal).max(axis=(0, 1))
            predicted = np.abs(peaks.swing[visit, k]).max(axis=-1)
            assert (largest <= 1.01 * predicted).all()
            assert (largest >= 0.6 * predicted).all()
            assert (largest > 1.2 * np.abs(plain.swing[visit, k]).max(axis=-1)).all()


def test_excitation_takes_what_the_carrier_leaves():
    limits = Limits(speed=np.array([20.0, 20.0]), swing=np.array([0.05, 0.05]))
    scaling = scale(with_carrier(), AXES, CONTROLLER, limits, holding=HELD)
    largest = scaling.peaks.largest
    assert (largest[:, 1] / limits.speed).max() == pytest.approx(1)
    assert scaling.plan.carrier.amplitudes.tolist() == with_carrier().carrier.amplitudes.tolist()
    again = predicted_peaks(scaling.plan, AXES, CONTROLLER, HELD)
    np.testing.assert_allclose(again.swing, scaling.peaks.swing, rtol=1e-9, atol=1e-12)
    tight = replace(limits, swing=np.array([0.05, 4e-3]))
    with pytest.raises(InvalidInput, match=r"carrier: position .: swing of motor 'm2' takes .* of"):
        scale(with_carrier(), AXES, CONTROLLER, tight, holding=HELD)


def test_carriers_are_written_and_read_back(tmp_path):
    carried = replace(with_carrier(), settle=0.7)
    carried.save(tmp_path / "plan.yaml")
    again = ExperimentPlan.load(tmp_path / "plan.yaml")
    assert again.settle == 0.7
    np.testing.assert_array_equal(again.reference(1), carried.reference(1))
    assert again.duration == carried.duration
    assert carried.duration == pytest.approx(replace(carried, settle=0).duration + 2 * 0.7)


@pytest.mark.parametrize(
    ("frequency", "message"),
    [
        (3.0, r"carrier.frequency: 3 Hz; a multiple of 1 / period = 2 Hz below the lowest line, "),
        (2e3, "2000 Hz; a multiple"),
        (0.5, "0.5 Hz; a multiple"),
    ],
)
def test_frequencies_that_are_no_carriers(frequency, message):
    with pytest.raises(InvalidInput, match=message):
        carrier_in(AXES, np.zeros((1, 2)), CONTROLLER, SPEED, frequency, SINE)


def test_carriers_that_cannot_be():
    two = np.tile(SPEED, (2, 1))
    for carrier, message in (
        (Carrier(1, two, two), "line 1 is one of the multisine"),
        (Carrier(2, two[:1], two[:1]), r"shapes \(1, 2\) and \(1, 2\); \(2, 2\), positions by"),
    ):
        with pytest.raises(InvalidInput, match=message):
            replace(plan(), carrier=carrier)
    with pytest.raises(InvalidInput, match="amplitudes not negative"):
        Carrier(2, -two, two)


@pytest.mark.parametrize(("line", "clean"), [(2, True), (4, True), (1, False), (3, False)])
def test_reversals_of_even_carriers_leave_odd_lines_alone(line, clean):
    """Coulomb friction under the carrier alone: a square wave, odd harmonics of its line."""
    carrier = Carrier(line, np.ones((1, 2)), np.array([[0.3, 1.1]]))
    friction = np.sign(carrier.reference(0, SINE))
    spectrum = np.abs(np.fft.rfft(friction, axis=0))
    assert (spectrum[1::2].max() < 1e-9 * spectrum.max()) == clean


def test_a_carrier_keeps_friction_from_sticking():
    """Motion at the lines is half of it the linear model's; without, friction rules it all."""
    robot = load_robot("manutec_r3")
    position = np.array([[0.2, -0.4, 0.5, 0.3, 0.4, 0.1]])
    controller = default_controller(robot, 0.004)
    sine = band_multisine(500, 0.004, (2 * np.pi * 3, 2 * np.pi * 30), inputs=6)
    limits = Limits(speed=np.full(6, 10.0))
    quiet = experiment_plan(
        robot, position, sine, blocks=1, periods=1, runs=1, speed=1.0, acceleration=1.0,
        rng=np.random.default_rng(1), crest_iterations=20,
    )  # fmt: skip
    quiet = scale(quiet, robot, controller, limits, balance=True).plan
    carrier = carrier_in(robot, position, controller, np.full(6, 20.0), None, sine)
    G = frequency_response(robot, position, sine.omega)[0]
    misfit = []
    for plan_ in (quiet, replace(quiet, carrier=carrier)):
        plant = SimulatedPlant(robot, controller, Imperfections(), np.random.default_rng(2))
        records = plant.measure(plan_, 0)
        torque, angle = (
            np.fft.rfft(x[0, 0, 0, 0], axis=0)[sine.lines] for x in (records.torque, records.angle)
        )
        motion = -(sine.omega**2)[:, None] * angle
        error = motion - np.einsum("fij,fj->fi", G, torque)
        misfit.append(np.median(np.linalg.norm(error, axis=0) / np.linalg.norm(motion, axis=0)))
    assert misfit[1] < 0.75 < 3 < misfit[0]
