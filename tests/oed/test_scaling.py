import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import nnls
from two_axes import CONTROLLER, RATIOS, N, T, TwoAxes, plan, run

import robotmodels
from oed import Limits, band_multisine, experiment_plan, predicted_peaks, scale
from oed.experiment.amplitude_scaling import fair_amplitudes
from oed.experiment.predicted_peaks import PlannedLoop
from robotmodels import InvalidInput, LinearModel
from robotmodels.linear.linear_model import Channels, Measurement
from robotmodels.simulation.controller import Controller, default_controller
from robotmodels.simulation.discrete_loop import sampled_loop

AXES = TwoAxes()
NOTHING_HELD = np.zeros((2, 2))
HELD = np.array([[0.4, -0.1], [-0.2, 0.3]])
LIMITS = Limits(
    torque=np.array([1.5, 0.9]),
    speed=np.array([40.0, 30.0]),
    positions=np.array([[-1.5, 1.5], [-2.0, 2.0]]),
)


def extremes(torque, speed, angle):
    """Return lowest and highest torque, speed, position (3, n, 2) of several runs."""
    signals = (torque, speed, angle / RATIOS)
    return np.array([np.stack([s.min(axis=(0, 1)), s.max(axis=(0, 1))], axis=-1) for s in signals])


def test_peaks_are_those_of_a_simulation_sample_by_sample():
    measured = plan(repetitions=None)
    loop = PlannedLoop.of(measured, AXES, CONTROLLER, NOTHING_HELD)
    other = replace(CONTROLLER, speed_gain=1.1 * CONTROLLER.speed_gain)
    wrong = PlannedLoop.of(measured, AXES, other, NOTHING_HELD)
    expected = []
    for visit, position in enumerate(measured.visited):
        runs = run(position, measured.reference(visit).reshape(-1, N, 2))
        R = measured.multisine.spectrum(measured.phases[visit])
        settled = extremes(*(s[-len(s) // 6 :] for s in runs))
        np.testing.assert_allclose(loop.steady(measured, visit, R), settled, rtol=4e-3)
        assert np.abs(wrong.steady(measured, visit, R) / settled - 1).max() > 0.02
        start = extremes(*(s[: len(s) // 2] for s in runs))  # 3 of 6 periods
        np.testing.assert_allclose(loop.start(measured, visit, R), start, rtol=4e-3)
        assert np.abs(wrong.start(measured, visit, R) / start - 1).max() > 0.02
        assert np.abs(start).max() > np.abs(settled).max()  # the transient counts
        expected.append(extremes(*runs))
    predicted = predicted_peaks(measured, AXES, CONTROLLER, NOTHING_HELD)
    np.testing.assert_allclose(predicted.swing, expected, rtol=4e-3)


def test_peaks_are_those_of_the_runs_that_are_made():
    """Of one run, not of as many as motors, whose other phases may add up higher."""
    one = replace(plan(repetitions=None), runs=1)
    settled = [
        extremes(*run(q, one.reference(v).reshape(-1, N, 2))) for v, q in enumerate(one.visited)
    ]
    predicted = predicted_peaks(one, AXES, CONTROLLER, NOTHING_HELD).swing
    np.testing.assert_allclose(predicted, settled, rtol=4e-3)
    every = predicted_peaks(plan(repetitions=None), AXES, CONTROLLER, NOTHING_HELD).swing
    assert np.abs(every / predicted - 1).max() > 0.02


def test_the_start_knows_the_speed_filter_and_a_delay():
    """Against the controller's equations and the plant, written out for one motor."""
    inertia, viscous, late = 0.02, 0.05, 3
    model = LinearModel(
        np.array([[inertia]]),
        np.array([[viscous]]),
        np.zeros((1, 1)),
        np.array([[1.0]]),
        Measurement(
            np.zeros((1, 1)), np.zeros((1, 1)), np.eye(1), Channels.plain(np.array([0.5])), late * T
        ),
    )
    controller = Controller([0.4], [0.3], [3.0], T, [4e-3])
    reference = np.random.default_rng(5).standard_normal((1, 400, 1))
    decay = np.exp(-viscous / inertia * T)
    angle = speed = w = i = last = 0.0
    angles, torques = [0.0] * late, []
    for r in reference[0, :, 0]:
        angles.append(angle)
        seen = angles[-1 - late]
        a = np.exp(-T / 4e-3)
        w = a * w + (1 - a) * (seen - last) / T
        last = seen
        e = r - 3.0 * seen - w
        i += T * e / 0.3
        u = 0.4 * (e + i)
        torques.append(u)
        final = 0.5 * u / viscous  # the speed to which the held torque leads
        angle += final * T + (speed - final) * (1 - decay) * inertia / viscous
        speed = final + (speed - final) * decay
    swing = sampled_loop(model, controller).swing(reference)
    np.testing.assert_allclose(swing[0, 0], [min(torques), max(torques)], rtol=1e-9)
    np.testing.assert_allclose(swing[2, 0], [min(angles), max(angles)], rtol=1e-9, atol=1e-12)


def test_progress_counts_visits_of_all_passes():
    seen = []
    scale(
        plan(),
        AXES,
        CONTROLLER,
        LIMITS,
        balance=True,
        holding=HELD,
        progress=lambda *counts: seen.append(counts),
    )
    assert seen == [(k, 9) for k in range(1, 10)]
    drawn = []
    plan(progress=lambda *counts: drawn.append(counts))
    assert drawn == [(1, 3), (2, 3), (3, 3)]


def test_an_unstable_loop_is_named():
    hasty = replace(CONTROLLER, speed_gain=40 * CONTROLLER.speed_gain)
    with pytest.raises(InvalidInput, match="controller: its loop is unstable in position 1"):
        scale(plan(), AXES, hasty, LIMITS, holding=HELD)


def test_scaled_plan_meets_one_limit_and_stays_inside_the_others():
    scaling = scale(plan(), AXES, CONTROLLER, LIMITS, holding=HELD)
    peaks = scaling.peaks
    again = predicted_peaks(scaling.plan, AXES, CONTROLLER, HELD)
    np.testing.assert_allclose(again.swing, peaks.swing, rtol=1e-12)
    ends = peaks.operating_point[..., None] + peaks.swing
    used = np.abs(ends[:, :2]).max(axis=-1) / np.stack([LIMITS.torque, LIMITS.speed])
    assert used.max() == pytest.approx(1)
    assert (ends[:, 2, :, 0] > LIMITS.positions[:, 0]).all()
    assert (ends[:, 2, :, 1] < LIMITS.positions[:, 1]).all()
    visit, k, motor = np.unravel_index(used.argmax(), used.shape)
    binding = scaling.binding
    assert (binding.visit, binding.motor) == (visit, ("m1", "m2")[motor])
    assert binding.quantity == ("torque", "speed")[k]
    assert binding.position == scaling.plan.visits[visit]
    assert abs(binding.limit) == (LIMITS.torque, LIMITS.speed)[k][motor]
    assert binding.factor == pytest.approx(1)
    assert [b.visit for b in scaling.bindings] == [0, 1, 2]
    np.testing.assert_array_equal(scaling.plan.scale, scaling.plan.scale[0])


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        (Limits(torque=np.array([1e3, 0.31])), "torque of motor 'm2' in position 2 .* 0.31 N m"),
        (Limits(speed=np.array([1e-3, 1e3])), "speed of motor 'm1' in position . .*0.001 rad/s"),
        (
            Limits(positions=np.array([[-1.0001, 1.5], [-2, 2]])),
            "position of motor 'm1' in position 2 meets its limit -1 rad",
        ),
    ],
)
def test_the_binding_limit_is_told(limits, expected):
    binding = scale(plan(), AXES, CONTROLLER, limits, holding=HELD).binding
    assert re.search(expected, str(binding))


def test_torque_limit_counts_holding_torque_with_its_sign():
    measured = plan(positions=np.array([[0.3, 0.1]]), repetitions=None, blocks=1)
    limits = Limits(torque=np.array([1.0, 50.0]))
    swing = predicted_peaks(measured, AXES, CONTROLLER, np.zeros((1, 2))).swing[0, 0, 0]
    for held in (-0.6, 0.6):
        scaling = scale(measured, AXES, CONTROLLER, limits, holding=np.array([[held, 0.0]]))
        expected = min((1 - held) / swing[1], (1 + held) / -swing[0])
        assert scaling.plan.scale[0] == pytest.approx(expected)
        assert scaling.binding.limit == np.sign(held)


def test_a_margin_is_kept():
    full = scale(plan(), AXES, CONTROLLER, LIMITS, holding=HELD).plan.scale
    less = scale(plan(), AXES, CONTROLLER, LIMITS, holding=HELD, margin=0.25).plan.scale
    np.testing.assert_allclose(less, 0.75 * full)


def test_a_factor_per_visit_fills_the_limits_in_each():
    scaling = scale(plan(), AXES, CONTROLLER, LIMITS, holding=HELD, per_visit=True)
    peaks = scaling.peaks
    ends = np.abs(peaks.operating_point[..., None] + peaks.swing)[:, :2].max(axis=-1)
    used = ends / np.stack([LIMITS.torque, LIMITS.speed])
    np.testing.assert_allclose(used.max(axis=(1, 2)), 1)
    assert len(set(scaling.plan.scale)) == 3
    assert all(b.factor == pytest.approx(1) for b in scaling.bindings)


def test_balancing_lets_every_motor_work():
    sine = plan().multisine
    lame = replace(plan(), multisine=sine.with_amplitudes([[1.0, 1e-3]]))
    assert lame.multisine.amplitudes.shape == sine.amplitudes.shape
    plain = scale(lame, AXES, CONTROLLER, LIMITS, holding=HELD)
    fair = scale(lame, AXES, CONTROLLER, LIMITS, holding=HELD, balance=True)

    def share(scaling):
        peaks = scaling.peaks.largest[:, :2] / np.stack([LIMITS.torque, LIMITS.speed])
        return peaks.max(axis=(0, 1))

    assert share(plain).min() < 0.6
    assert share(fair).min() > 0.6
    assert share(fair).max() == pytest.approx(1)
    # What the inputs looked like before has no say.
    other = scale(plan(), AXES, CONTROLLER, LIMITS, holding=HELD, balance=True)
    np.testing.assert_allclose(
        other.plan.reference(1), fair.plan.reference(1), rtol=1e-9, atol=1e-12
    )


def test_peaks_of_a_ramp_are_those_of_a_simulation():
    measured = replace(plan(repetitions=None), ramp=True)
    loop = PlannedLoop.of(measured, AXES, CONTROLLER, NOTHING_HELD)
    for visit, position in enumerate(measured.visited):
        runs = np.tile(measured.reference(visit).reshape(-1, N, 2), (1, 3, 1))
        runs[:, :N] *= measured.envelope[:, None]
        R = measured.multisine.spectrum(measured.phases[visit])
        expected = extremes(*run(position, runs, periods=1))
        np.testing.assert_allclose(loop.start(measured, visit, R), expected, rtol=4e-3)
        sudden = loop.start(replace(measured, ramp=False), visit, R)
        assert np.abs(sudden / expected - 1).max() > 0.02


@pytest.mark.parametrize("seed", range(3))
def test_a_ramp_leaves_room_for_larger_amplitudes(seed):
    """The jerk of a sudden start meets the torque limit long before the steady state does."""
    robot = robotmodels.load_robot("manutec_r3")
    controller = default_controller(robot, 1e-3)
    slow = {"amplitude": lambda omega: 1 / omega}
    sine = band_multisine(2000, 1e-3, (3.0, 380.0), inputs=6, count=40, **slow)
    keywords = {"blocks": 1, "periods": 1, "speed": 1.0, "acceleration": 2.0}
    position, rng = np.array([[0.0, 0.4, 0.9, 0.1, 0.3, 0.0]]), np.random.default_rng(seed)
    sudden = experiment_plan(robot, position, sine, rng=rng, **keywords)
    limits = Limits(torque=np.array([10.0, 10.0, 10.0, 2.1, 2.1, 2.1]))
    before, after = (
        scale(replace(sudden, ramp=ramp), robot, controller, limits, balance=True).plan.reference(0)
        for ramp in (False, True)
    )
    gains = after.std(axis=(0, 1, 2)) / before.std(axis=(0, 1, 2))
    assert np.exp(np.log(gains).mean()) > 1.5


def test_friction_takes_its_part_of_the_torque():
    rubbing = np.array([0.2, 0.1])
    less = replace(LIMITS, torque=LIMITS.torque - rubbing)
    expected = scale(plan(), AXES, CONTROLLER, less, holding=HELD).plan.scale
    scaling = scale(plan(), AXES, CONTROLLER, LIMITS, holding=HELD, friction=rubbing)
    np.testing.assert_allclose(scaling.plan.scale, expected)
    assert abs(scaling.binding.limit) in LIMITS.torque
    weak = replace(LIMITS, torque=np.array([1.0, 0.35]))
    words = "needs 0.3 N m to hold the arm alone and 0.1 N m against friction, which leaves nothing"
    with pytest.raises(InvalidInput, match=words):
        scale(plan(), AXES, CONTROLLER, weak, holding=HELD, friction=rubbing)


@pytest.mark.parametrize("seed", range(6))
def test_fair_amplitudes_have_the_largest_product(seed):
    """Stationarity: the gradient of the logarithms is a nonnegative mix of the tight limits'."""
    rng = np.random.default_rng(seed)
    n = 1 + seed
    used = np.exp(rng.normal(size=(90, n)) * 1.5)
    factors = fair_amplitudes(used)
    sums = (used**2 * factors**2).sum(axis=1)
    assert sums.max() == pytest.approx(1, abs=1e-5)
    tight = used[sums > 1 - 1e-3] ** 2 * factors**2
    _, miss = nnls(tight.T, np.ones(n))
    assert miss < 1e-2
    np.testing.assert_allclose(fair_amplitudes(used * 7), factors / 7, rtol=1e-5)


def test_fair_amplitudes_of_limits_that_motors_share_or_have_alone():
    np.testing.assert_allclose(fair_amplitudes(np.diag([2.0, 0.1, 5.0])), [0.5, 10, 0.2], rtol=1e-5)
    shared = fair_amplitudes(np.array([[2.0, 2.0, 4.0]]))
    np.testing.assert_allclose(shared, np.array([0.5, 0.5, 0.25]) / np.sqrt(3), rtol=1e-5)


def test_a_real_robot_holds_itself_against_gravity():
    robot = robotmodels.load_robot("manutec_r3")
    controller = default_controller(robot, 5e-4)
    sine = band_multisine(2000, 5e-4, (10.0, 380.0), inputs=6)
    keywords = {"blocks": 1, "periods": 1, "speed": 1.0, "acceleration": 2.0}
    rng = np.random.default_rng(3)
    positions = np.array([[0.0, 0.4, 0.9, 0.1, 0.3, 0.0], [0.2, 1.2, -0.5, 0.0, 0.5, 0.1]])
    measured = experiment_plan(robot, positions, sine, rng=rng, **keywords)
    limits = Limits(torque=np.full(6, 9.0), positions=robot.position_limits)
    scaling = scale(measured, robot, controller, limits)
    # Holding torques are the slope of the potential energy; the stiff gears hardly sag.
    arm, data = robot.arm.model, robot.arm.model.createData()
    ratios = np.array([m.gear_ratio for m in robot.file.motors])
    for rest, q in zip(scaling.peaks.operating_point, positions, strict=True):
        energy = [
            [pin.computePotentialEnergy(arm, data, q + sign * step) for sign in (1, -1)]
            for step in 1e-6 * np.eye(6)
        ]
        slope = -np.diff(energy)[:, 0] / 2e-6
        np.testing.assert_allclose(rest[0], slope / ratios, rtol=1e-2, atol=1e-3)
        assert np.abs(rest[0]).max() > 1
    assert np.abs(scaling.peaks.largest[:, 0]).max() == pytest.approx(9.0)
    heavy = int(np.abs(scaling.peaks.operating_point[1, 0]).argmax())
    weak = replace(limits, torque=np.where(np.arange(6) == heavy, 0.2, 9.0))
    alone = rf"limits.torque: position .: motor 'm{heavy + 1}' needs .* N m to hold the arm alone"
    with pytest.raises(InvalidInput, match=alone):
        scale(measured, robot, controller, weak)


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        (Limits(), "limits: none given"),
        (Limits(torque=np.ones(3)), r"limits.torque: shape \(3,\); \(2,\) is needed"),
        (Limits(speed=np.array([1.0, 0.0])), "limits.speed of motor 'm2': 0; a positive number"),
        (Limits(torque=np.array([np.nan, 1])), "limits.torque of motor 'm1': nan"),
        (
            Limits(positions=np.array([[1.0, -1.0], [0, 1]])),
            r"limits.positions of motor 'm1': \[1, -1\]; low < high",
        ),
        (
            Limits(torque=np.array([1, 0.2])),
            "limits.torque: position 2: motor 'm2' needs 0.3 N m to hold the arm alone, "
            "which leaves nothing of its limit 0.2 N m",
        ),
        (
            Limits(positions=np.array([[-1.0, 1.0], [-2, 2]])),
            r"limits.positions: position 2: motor 'm1' at -1 is not inside its limits \[-1, 1\]",
        ),
    ],
)
def test_impossible_limits_name_position_motor_and_quantity(limits, message):
    with pytest.raises(InvalidInput, match=message) as caught:
        scale(plan(), AXES, CONTROLLER, limits, holding=HELD)
    assert "\n" not in str(caught.value)


def test_what_does_not_fit_is_refused():
    measured = plan()
    with pytest.raises(InvalidInput, match=r"margin: 1\.0; a number from 0 to below 1"):
        scale(measured, AXES, CONTROLLER, LIMITS, margin=1.0, holding=HELD)
    with pytest.raises(InvalidInput, match=r"holding: shape \(2,\); \(2, 2\) is needed"):
        scale(measured, AXES, CONTROLLER, LIMITS, holding=np.zeros(2))
    with pytest.raises(InvalidInput, match="holding: the torques that hold the arm"):
        scale(measured, AXES, CONTROLLER, LIMITS)
    slow = replace(CONTROLLER, sample_time=2 * T)
    with pytest.raises(InvalidInput, match=r"sample time 0.002 s, the plan's signals have 0.001"):
        scale(measured, AXES, slow, LIMITS, holding=HELD)
    robot = robotmodels.load_robot("moberg_axis1")
    sine = band_multisine(N, T, (10.0, 100.0), inputs=1)
    other = experiment_plan(
        robot,
        np.zeros((1, 1)),
        sine,
        blocks=1,
        periods=1,
        speed=1.0,
        acceleration=1.0,
        rng=np.random.default_rng(0),
    )
    with pytest.raises(InvalidInput, match="robot: 2 motors; the plan has 1"):
        scale(other, Wide(), CONTROLLER, Limits(torque=np.ones(1)), holding=np.zeros((1, 1)))


class Wide(TwoAxes):
    def network(self, positions, parameters=None):
        return super().network(np.zeros((len(positions), 2)))
