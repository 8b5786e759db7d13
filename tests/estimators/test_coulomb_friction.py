"""Coulomb friction of motors in runs: its course against the simulated one, levels, noise."""

import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from derivatives import circular
from noisy_runs import SMALL
from rubbing_arm import LEVELS, rubbing_arm, rubbing_records
from scipy.signal import lfilter

from estimators import (
    RunSpectra,
    covariance,
    fit,
    run_spectra,
    runs_at,
    settled_fit,
    settled_runs,
)
from estimators.input_output.coulomb import CoulombSpectra
from estimators.input_output.friction_course import MotorCourse
from estimators.input_output.friction_shares import _late_means, friction_shares
from estimators.input_output.silent_lines import SilentLines
from oed.experiment.draw_plan import experiment_plan
from oed.experiment.multisine import band_multisine
from oed.experiment.run_experiment import SimulatedPlant
from robotmodels import ElasticRobot, IdentificationWarning, InvalidInput, Records, load_robot
from robotmodels.common.arrays import Array
from robotmodels.description.outputs import Output
from robotmodels.exports.robot_files import with_values
from robotmodels.linear.response import frequency_response
from robotmodels.simulation.controller import default_controller
from robotmodels.simulation.imperfections import Imperfections

LEVEL = 0.5
ANGLE, GEAR = Output(motor="m1", quantity="acceleration"), Output(spring="g1", quantity="torque")


def rubbing(**changes: Any) -> ElasticRobot:
    """The axis with Coulomb friction at its motor, and a linear gear."""
    robot = load_robot("moberg_axis1")
    motors = [m.model_copy(update={"coulomb": LEVEL, **changes}) for m in robot.file.motors]
    return replace(robot, file=robot.file.model_copy(update={"motors": motors}))


@cache
def simulated(noise: float = 2e-5, friction: float = 1.0, outputs: int = 1) -> Records:
    """Four periods of one multisine about one position."""
    robot = rubbing()
    seen = replace(robot, file=robot.file.model_copy(update={"outputs": [ANGLE, GEAR][:outputs]}))
    rng = np.random.default_rng(3)
    sine = band_multisine(
        2000, 1e-3, (2 * np.pi, 2 * np.pi * 60), inputs=1, odd=True, detection_group=5, rng=rng
    )
    plan = experiment_plan(
        seen, np.zeros((1, 1)), sine.with_amplitudes(np.full((len(sine.lines), 1), 4.0)),
        blocks=1, periods=4, transient_periods=2, ramp=True, speed=1.0, acceleration=2.0,
        rng=rng, runs=1,
    )  # fmt: skip
    faults = Imperfections(angle_noise=np.full(1, noise), friction=friction, nonlinear_gears=False)
    plant = SimulatedPlant(seen, default_controller(robot, 1e-3), faults, rng)
    return plant.measure(plan, 0)


@cache
def settled() -> RunSpectra:
    """Those runs, settled from the true values."""
    return settled_runs(rubbing(), simulated(), "detection")


def test_course_of_friction_is_the_simulated_one() -> None:
    """Torque less inertia, viscous friction and the gear's torque; in turns as elsewhere."""
    records, robot = simulated(noise=0.0, outputs=2), rubbing()
    motor, step = robot.file.motors[0], records.sample_time
    angle, gear = records.angle[0, 0, 0].reshape(-1, 2).T
    torque = records.torque[0, 0, 0].ravel()
    acceleration, speed = np.diff(angle, 2) / step**2, np.gradient(angle, step)[1:-1]
    mean = (gear[2:] + 4 * gear[1:-1] + gear[:-2]) / 6
    friction = (
        0.5 * (torque[1:-1] + torque[:-2])
        - motor.inertia * acceleration
        - motor.viscous * speed
        - mean / motor.gear_ratio
    )
    alone = replace(records, angle=records.angle[..., :1], derivatives=records.derivatives[:1])
    shares = friction_shares(alone, robot).torque.ravel()[1:-1]
    error = (LEVEL * shares - friction)[5:-5] / LEVEL
    turning = np.abs(friction[5:-5]) < 0.98 * LEVEL
    assert turning.mean() > 0.02
    assert np.std(error) < 0.02
    assert np.std(error[turning]) < 0.06
    assert np.std(np.sign(speed)[5:-5][turning] - friction[5:-5][turning] / LEVEL) > 0.3


@pytest.mark.parametrize("scale", [1.0, 1.4])
def test_levels_and_springs_from_wrong_guesses(scale: float) -> None:
    """Left to noise, friction puts stiffnesses and costs far off."""
    records, robot = simulated(), rubbing()
    truth = robot.parameters.values
    data = settled_runs(robot, records, "detection", start=scale * truth)
    result = fit(robot, data)
    assert result.coulomb == pytest.approx(np.full((1, 1), LEVEL), rel=0.02)
    error = np.log(result.parameters.values / truth)
    assert (np.abs(error) < 4 * np.maximum(result.trust.std, 1e-3)).all()
    plain = fit(robot, run_spectra(records, "detection"))
    ignored = np.log(plain.parameters.values / truth)
    assert np.abs(ignored).max() > 5 * np.abs(error).max()


def test_runs_settle_about_the_best_search_from_wrong_guesses() -> None:
    """Values off by a factor of two, up or down: the same springs as from true ones."""
    records, robot = simulated(), rubbing()
    truth = robot.parameters.values
    guesses = with_values(robot, truth * 2.0 ** np.array([1, 1, 1, -1, -1, -1]))
    result, searches = settled_fit(guesses, records, [guesses.parameters.values], "detection")
    assert len(searches) == 1
    right = fit(robot, settled())
    error = np.log(result.parameters.values / right.parameters.values)
    assert np.abs(error).max() < 1e-3
    assert result.coulomb == pytest.approx(right.coulomb, rel=1e-3)
    (level,) = result.friction_levels(covariance(result).covariance)
    assert (level.motor, level.in_file) == ("m1", LEVEL)
    assert level.level == level.lowest == level.highest == result.coulomb
    written = result.robot().file.motors[0]
    assert written.coulomb == level.level


def _one_period(records: Records) -> Records:
    names = ("torque", "angle", "reference", "saturated")
    return replace(records, **{name: getattr(records, name)[:, :, :, :1] for name in names})


def _late(records: Records) -> Records:
    """Return the records with angles that are a sample late."""
    flat = records.angle.reshape(*records.angle.shape[:3], -1, records.angle.shape[-1])
    return replace(records, angle=np.roll(flat, 1, axis=3).reshape(records.angle.shape))


def _measured(records: Records) -> Records:
    """Return the records with torques as a sensor sees them, beside those commanded."""
    omega = 2 * np.pi * np.arange(1, records.samples // 2 + 1) / records.samples
    hold = np.append(1.0, (1 - np.exp(-1j * omega)) / (1j * omega))
    spectra = np.fft.rfft(records.torque, axis=4) * hold[:, None]
    seen = np.fft.irfft(spectra, records.samples, axis=4)
    return replace(records, torque=seen, command=records.torque)


@pytest.mark.parametrize(
    ("change", "made", "options"),
    [
        (lambda records: records, {}, {}),
        (lambda records: records, {"width": 0.2}, {}),
        (lambda records: records, {"late": True}, {}),
        (_one_period, {}, {}),
        (_late, {}, {"delay": 1e-3}),
        (_measured, {}, {}),
    ],
    ids=["sharp", "tanh", "torque loops", "one period", "late angles", "measured torques"],
)
def test_levels_of_three_coupled_motors(
    change: Callable[[Records], Records], made: dict[str, Any], options: dict[str, Any]
) -> None:
    robot, records = rubbing_arm(**made), change(rubbing_records(**made))
    result = fit(robot, settled_runs(robot, records, "detection", **options))
    assert result.coulomb == pytest.approx(LEVELS[None], rel=0.01)
    error = np.log(result.parameters.values / robot.parameters.values)
    assert (np.abs(error) < 4 * np.maximum(result.trust.std, 1e-3)).all()


@pytest.mark.parametrize(("late", "lag"), [(0.0, 0.0), (1.25, 0.0), (0.0, 0.7), (2.75, 2.5)])
def test_means_of_late_torques_are_exact(late: float, lag: float) -> None:
    """Against sums over a grid of a hundredth of a sample, of steps through a first-order lag."""
    fine, torque = 100, np.random.default_rng(1).standard_normal(80)
    steps = np.repeat(torque, fine)
    if lag:
        decay = np.exp(-1 / (fine * lag))
        begun = np.append(lfilter([1 - decay], [1, -decay], steps), 0)
        steps = (np.append(0, begun)[: len(steps)] + begun[:-1]) / 2
    rising = (np.arange(fine) + 0.5) / fine**2
    means = np.convolve(steps, np.concatenate([rising, rising[::-1]]))
    ends = np.round((np.arange(len(torque)) + 1 - late) * fine).astype(int) - 1
    inside = slice(40, -2)  # what was before the first sample has died out
    right = means[ends[inside]]
    about, of_steps = _late_means(torque, late, lag, steady=True)
    assert about[inside] == pytest.approx(right, abs=1e-4)
    sums = np.append(0, np.cumsum(steps)) / fine
    begin = np.round((np.arange(len(torque)) - late) * fine).astype(int)[inside]
    assert of_steps[1:][inside] == pytest.approx(sums[begin + fine] - sums[begin], abs=1e-4)


def test_no_friction_has_no_level() -> None:
    """And the same values as without estimating it."""
    records, robot = simulated(friction=0.0), rubbing()
    data = settled_runs(robot, records, "detection")
    result = fit(robot, data)
    assert result.coulomb is not None
    assert np.abs(result.coulomb).max() < 1e-3 * LEVEL


def test_levels_enter_covariances_linearly() -> None:
    """Against draws with the friction taken off each of them."""
    rng = np.random.default_rng(1)
    m, n, draws = 2, 2, circular(rng, 50, 6)
    levels = np.array([[0.3, -0.7]])
    full = np.einsum("ka,kb->ab", draws, np.conj(draws))[None, None] / 50
    spectra = CoulombSpectra(circular(rng, 1, 1, 1, n), np.zeros((1, n)), full)
    change, covariances, there = spectra.at(levels)
    less = np.concatenate([draws[:, : m + n]], axis=1)
    less[:, m:] -= levels * draws[:, m + n :]
    assert covariances[0, 0] == pytest.approx(np.einsum("ka,kb->ab", less, np.conj(less)) / 50)
    assert change == pytest.approx(-spectra.shares * levels)
    back, again, _ = there.at(np.zeros((1, n)))
    assert back == pytest.approx(-change)
    assert again[0, 0] == pytest.approx(full[0, 0, : m + n, : m + n])


@pytest.mark.parametrize("disturbed", [False, True])
@pytest.mark.parametrize("rub", [False, True])
def test_silent_lines_show_what_an_frf_leaves(disturbed: bool, rub: bool) -> None:
    """Motion by friction is no noise there; sensors and disturbances have laws of their own."""
    rng = np.random.default_rng(2)
    model, n = SMALL.model, SMALL.response.shape[3]
    excited = SMALL.omega
    silent = np.sort(rng.uniform(0.8 * excited[0], 1.2 * excited[-1], 60))
    at, here = (
        frequency_response(model, SMALL.positions[:1], omega)[0] for omega in (excited, silent)
    )
    m = at.shape[1]
    torques, shares = circular(rng, 40, 60, n), circular(rng, 40, 60, n)
    levels = rng.uniform(0.1, 1, n) if rub else np.zeros(n)
    push = 0.01 * circular(rng, 40, 60, n) if disturbed else np.zeros((40, 60, n))
    errors = 1e-5 * silent[:, None] ** 2 * circular(rng, 40, 60, m)
    moved = torques - levels * shares + push
    outputs = np.einsum("dmn,kdn->kdm", here, moved) + errors
    nearest = np.argsort(np.abs(silent - excited[:, None]), axis=1)[:, :6]
    inputs = np.concatenate([torques, shares], 2) if rub else torques
    lines = SilentLines(silent, outputs, inputs, np.full(m, 2), nearest)
    X = np.concatenate([np.broadcast_to(np.eye(m), (len(excited), m, m)), -at], axis=2)
    adjoint = np.conj(np.swapaxes(X, 1, 2))
    covariance = X @ lines.covariance_beside(excited, at, here)[0] @ adjoint
    right = 1e-10 * excited[:, None, None] ** 4 * np.eye(m)
    if disturbed:
        right = right + 1e-4 * at @ np.conj(np.swapaxes(at, 1, 2))
    ratio = np.linalg.solve(right, covariance)
    assert np.linalg.eigvals(ratio).real == pytest.approx(np.ones((len(excited), m)), abs=0.4)
    assert np.trace(ratio, axis1=1, axis2=2).mean().real == pytest.approx(m, rel=0.04)
    ignored = lines.covariance(excited)[:, : m + n, : m + n]
    plain = np.trace(np.linalg.solve(right, X @ ignored @ adjoint), axis1=1, axis2=2)
    assert np.abs(np.log(plain.real / m)).max() > 1.5


def test_intervals_with_friction_cover() -> None:
    """Costs as expected, estimates within their deviations, levels right; not so if ignored."""
    rng = np.random.default_rng(4)
    q, f, _, n = SMALL.response.shape
    levels, squares, costs, ignored = np.full((q, n), 0.4), [], [], []
    means = []
    for _ in range(25):
        data = SMALL.runs(rng, 2)
        shares = circular(rng, q, 2, f, n)
        zeros = np.zeros((q, f, *2 * (data.covariance.shape[-1] + n,)), dtype=complex)
        size = data.covariance.shape[-1]
        zeros[..., :size, :size] = data.covariance
        with_friction = replace(
            data,
            inputs=data.inputs + levels[:, None, None] * shares,
            coulomb=CoulombSpectra(shares, np.zeros((q, n)), zeros),
        )
        result = fit(SMALL.model, with_friction, start=SMALL.truth)
        error = np.log(result.parameters.values / SMALL.truth)
        matrix = covariance(result).covariance
        squares.append(error @ np.linalg.inv(matrix) @ error / len(error))
        means.append([(one.level - 0.4) / one.std for one in result.friction_levels(matrix)])
        costs.append(result.cost / result.expected_cost)
        assert result.coulomb == pytest.approx(levels, abs=0.15)
        left = fit(SMALL.model, replace(with_friction, coulomb=None), start=SMALL.truth)
        ignored.append(left.cost / left.expected_cost)
    assert np.mean(squares) == pytest.approx(1, abs=5 / np.sqrt(25 * len(error) / 2))
    assert np.mean(costs) == pytest.approx(1, abs=0.05)
    assert np.mean(ignored) > 2
    numbers = data.outputs[0].size - n / 2  # each level takes half of one
    assert result.problem.expected_squares == pytest.approx(np.full(q, numbers))
    assert 0.6 < np.sqrt(np.mean(np.square(means))) < 1.3


def test_runs_at_values_are_those_that_settle() -> None:
    records, robot = simulated(), rubbing()
    result = fit(robot, settled())
    again = runs_at(robot, records, result.parameters.values, "detection")
    assert isinstance(again, RunSpectra)
    assert again.inputs == pytest.approx(settled().inputs, rel=1e-2, abs=1e-4)


def test_friction_is_refused_where_it_cannot_be_told() -> None:
    records = simulated()
    with pytest.raises(InvalidInput, match="friction: motor 'm1' counts it as a damper"):
        run_spectra(records, "detection", friction=rubbing(coulomb_speed=5.0))
    speeds = replace(records, derivatives=np.array([1]))
    with pytest.raises(InvalidInput, match="friction: the first 1 outputs must be the motors'"):
        run_spectra(speeds, "detection", friction=rubbing())
    with pytest.raises(InvalidInput, match="friction: that of runs that do not end as they began"):
        run_spectra(records, "detection", friction=rubbing(), states="yes")
    late = rubbing()
    outputs = [ANGLE.model_copy(update={"delay": 1e-3})]
    late = replace(late, file=late.file.model_copy(update={"outputs": outputs}))
    with pytest.raises(InvalidInput, match="friction: delay, gain and lag of the encoder of m"):
        run_spectra(records, "detection", friction=late)
    with pytest.raises(InvalidInput):
        run_spectra(records, "detection", friction=load_robot("ur10"))


def test_motors_at_rest_have_no_level() -> None:
    """The robot file keeps its own; the others are estimated as before."""
    robot, records = rubbing_arm(), rubbing_records()
    noise = np.random.default_rng(5).normal(0, 1e-6, records.angle.shape[:-1])
    angle = np.concatenate([records.angle[..., :2], noise[..., None]], axis=-1)
    with pytest.warns(IdentificationWarning, match="motor 3 rests or turns around in 100 %"):
        data = runs_at(robot, replace(records, angle=angle), robot.parameters.values, "detection")
    result = fit(robot, data, max_evaluations=1)
    first, second, third = result.friction_levels(covariance(result).covariance)
    assert np.isnan([third.level, third.std, third.lowest, third.highest]).all()
    assert np.isfinite([first.level, first.std, second.level, second.std]).all()
    written = result.robot().file.motors
    assert written[2].coulomb == LEVELS[2]
    assert written[1].coulomb == max(second.level, 0)


def test_motors_at_rest_are_warned_of() -> None:
    """Their friction is not the full one, whatever it is."""
    records = simulated()
    still = replace(records, angle=np.round(records.angle / 2))
    with pytest.warns(IdentificationWarning, match="motor 1 rests or turns around in"):
        friction_shares(still, rubbing())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        friction_shares(records, rubbing())


def stick_slip(rng: np.random.Generator) -> tuple[MotorCourse, Array]:
    """Return a motor under disturbances of 0.6 of its friction, and its shares of friction.

    Twenty steps a sample; where friction can hold the motor, it stops at the step's end.
    """
    samples, fine, step, inertia, gain = 4000, 20, 1e-3, 1.3e-3, (0.5, 0.02)
    lines = np.arange(5, 240, 2)
    waves = 2 * np.pi * (np.outer(np.arange(samples) / samples, lines) + rng.random(len(lines)))
    force = np.cos(waves).sum(axis=1)
    force /= force.std()
    pushes, noise = 0.3 * rng.standard_normal(samples), 2e-5 * rng.standard_normal(samples)
    angle, speed, before = 0.0, 0.0, 0.0
    angles, torques, shares = np.zeros(samples), np.zeros(samples), np.zeros((samples, fine))
    for k in range(samples):
        angles[k] = angle + noise[k]
        torques[k] = force[k] - gain[0] * angles[k] - gain[1] * (angles[k] - before) / step
        before = angles[k]
        total, h = torques[k] + pushes[k], step / fine
        for i in range(fine):
            way = np.sign(speed) if speed else np.clip(total / LEVEL, -1, 1)
            later = speed + h * (total - LEVEL * way) / inertia
            if later * speed < 0 and abs(total) <= LEVEL:
                later = 0.0
            angle, speed, shares[k, i] = angle + h * (speed + later) / 2, later, way
    rising = (np.arange(fine) + 0.5) / fine**2
    about = np.zeros(samples)
    about[1:] = shares[:-1] @ rising + shares[1:] @ rising[::-1]
    means = np.convolve(torques, [0.5, 0.5])[:samples]
    return MotorCourse(angles, means, torques[:-1], inertia, step), about


def test_disturbances_leave_friction_near_stops_unbiased() -> None:
    """What is left over there holds disturbances, on which it depends whether a motor stops.

    Shares by it are 5 % too large there, so that levels come out too small.
    """
    rng, away = np.random.default_rng(0), []
    for _ in range(6):
        motor, right = stick_slip(rng)
        for course in (motor, replace(motor, predicted=False)):
            shares, _ = course.shares()
            away.append([(right - shares) @ shares / (shares @ shares), np.std(right - shares)])
    predicted, surplus = np.array(away).reshape(6, 2, 2).transpose(1, 2, 0)
    assert abs(predicted[0].mean()) < 0.015
    assert surplus[0].mean() < -0.03
    assert predicted[1].mean() < 0.75 * surplus[1].mean()
