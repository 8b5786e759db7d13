"""Margins against python-control, and against the poles that the same gains and delays lead to."""

import json

import numpy as np
import pytest
import yaml
from robots import HERE, PENDULUM, built, changed

from robotmodels import (
    Controller,
    Frame,
    InvalidInput,
    LinearFeedback,
    Notch,
    default_controller,
    linear_feedback,
    linearize,
    loop_margins,
    tool_model,
)
from robotmodels.simulation.discrete_loop import first_order_system, sampled_loop
from robotmodels.simulation.loop_plant import loop_plant, loop_poles

control = pytest.importorskip("control")

ONE, AT_ONE = built(PENDULUM), np.array([[0.4]])
TWO = built(yaml.safe_load((HERE / "two_joints.yaml").read_text()))
AT_TWO = np.array([[-0.8, 0.4]])
T = 2e-3
CASCADE = Controller(np.array([0.08]), np.array([0.3]), np.array([4.0]), T)
# Position and speed by a filtered derivative, in continuous time.
GAIN, LEAD, LAG = 0.6, 0.08, 0.004


def plant_of(robot, position, time=None):
    """Return python-control's plant from torques to motor angles, sampled by its own rule."""
    model = linearize(robot, position[0])
    system, size = first_order_system(model), 2 * len(model.selector)
    n = model.inputs
    C = np.hstack([model.selector.T, np.zeros((n, size - len(model.selector)))])
    whole = control.ss(system[:, :size], system[:, size:], C, np.zeros((n, n)))
    return whole if time is None else control.c2d(whole, time, "zoh")


def check(margins, loop, i=0):
    """Compare with python-control's margins of one loop, at crossings of |L| and of its phase."""
    gains, phases, _, _, _, _ = control.stability_margins(loop, returnall=True)
    rising, falling = gains[(gains > 1) & (gains < 1e12)], gains[gains < 1]  # no rounding of none
    assert margins.gain_margin[0, i] == pytest.approx(rising.min(initial=np.inf), rel=1e-4)
    expected = falling.max(initial=0.0)
    assert margins.gain_reduction[0, i] == pytest.approx(expected, rel=1e-4, abs=1e-12)
    wrapped = np.abs((phases + 180) % 360 - 180).min()
    assert np.rad2deg(margins.phase_margin[0, i]) == pytest.approx(wrapped, abs=0.01)


def test_sampled_loop_of_one_motor():
    margins = loop_margins(ONE, AT_ONE, linear_feedback(CASCADE))
    plant = plant_of(ONE, AT_ONE, T)
    z = control.tf([1, 0], [1], T)
    k = CASCADE.speed_gain[0] * (1 + T / CASCADE.integral_time[0] * z / (z - 1))
    F = k * (CASCADE.position_gain[0] + (1 - 1 / z) / T)
    loop = control.ss(F) * plant
    assert margins.stable[0]
    # By responses: polynomials of z miss the slow crossing.
    omega = np.geomspace(0.1, np.pi / T * 0.999, 6_000)
    values = np.squeeze(loop(np.exp(1j * omega * T)))
    check(margins, control.frd(values, omega))
    S = np.abs(1 / (1 + values))
    assert margins.peak_sensitivity[0, 0] == pytest.approx(S.max(), rel=1e-5)
    assert margins.largest_sensitivity[0] == pytest.approx(margins.peak_sensitivity[0, 0])
    assert margins.bandwidth[0, 0] == pytest.approx(omega[np.sqrt(0.5) < S][0], rel=1e-3)
    poles = np.log(control.feedback(loop).poles().astype(complex)) / T
    assert margins.growth[0] == pytest.approx(poles.real.max(), rel=1e-4)


def test_continuous_loop_of_one_motor_by_transfer_function():
    s = control.tf([1, 0], [1])
    F = GAIN * (1 + LEAD * s) / (1 + LAG * s)
    margins = loop_margins(ONE, AT_ONE, linear_feedback(F))
    check(margins, control.ss(F) * plant_of(ONE, AT_ONE))
    by_matrices = loop_margins(ONE, AT_ONE, linear_feedback(control.ss(F)))
    for name in ("gain_margin", "phase_margin", "peak_sensitivity", "bandwidth"):
        np.testing.assert_allclose(getattr(by_matrices, name), getattr(margins, name), rtol=1e-6)


def test_two_motors_each_with_the_other_closed():
    controller = default_controller(TWO, T)
    feedback = linear_feedback(controller)
    margins = loop_margins(TWO, AT_TWO, feedback)
    P = plant_of(TWO, AT_TWO, T)
    whole = control.ss(feedback.A, feedback.B, feedback.C, feedback.D, T)
    for i in range(2):
        select = np.eye(2)[[i]]
        others = np.eye(2) - select.T @ select
        closed = control.feedback(P, others * whole)
        loop = select * whole * closed * select.T
        omega = np.geomspace(0.5, np.pi / T * 0.999, 3_000)
        values = np.squeeze(loop(np.exp(1j * omega * T)))
        check(margins, control.frd(values, omega), i)
        S = np.abs(1 / (1 + values))
        assert margins.peak_sensitivity[0, i] == pytest.approx(S.max(), rel=1e-3)
    total = np.eye(2)[:, :, None] + (whole * P)(np.exp(1j * omega * T))
    largest = (1 / np.linalg.svd(np.moveaxis(total, 2, 0), compute_uv=False)[:, -1]).max()
    assert margins.largest_sensitivity[0] == pytest.approx(largest, rel=1e-3)


DELAYS = {
    "none": {},
    "fraction": {"torque_delay": 0.7e-3},
    "several": {"torque_delay": 5.3e-3, "torque_lag": 1e-3, "torque_gain": 1.1},
}


@pytest.mark.parametrize("delay", DELAYS)
@pytest.mark.parametrize("kind", ["sampled", "continuous"])
def test_gain_at_its_margin_is_on_the_edge(delay, kind):
    """Poles and responses are computed apart; they agree where stability ends."""
    motors = [PENDULUM["motors"][0] | DELAYS[delay]]
    robot = built(changed(PENDULUM, motors=motors, delay=0.4e-3))
    F = control.tf([GAIN * LEAD, GAIN], [LAG, 1])
    feedback = linear_feedback(CASCADE) if kind == "sampled" else linear_feedback(F)
    margins = loop_margins(robot, AT_ONE, feedback)
    assert margins.stable[0]
    factor = margins.gain_margin[0, 0]
    assert factor > 1.05
    for share, stable in ((0.995, True), (1.005, False)):
        beyond = loop_margins(robot, AT_ONE, feedback.filtered(0, None, share * factor))
        assert bool(beyond.stable[0]) == stable
    assert beyond.gain_margin[0, 0] == beyond.phase_margin[0, 0] == 0
    assert np.isinf(beyond.peak_sensitivity[0, 0])


@pytest.mark.parametrize("time", [None, T])
@pytest.mark.parametrize("viscous", [0.0, 2e-3])
def test_plants_without_friction_and_gravity_have_double_poles(viscous, time):
    motors = [m.model_dump() | {"viscous": viscous} for m in TWO.file.motors]
    content = yaml.safe_load((HERE / "two_joints.yaml").read_text())
    robot = built(changed(content, gravity=[0.0, 0.0, 0.0], motors=motors))
    plant = loop_plant(linearize(robot, AT_TWO[0]), time)
    w = np.array([0.1, 3.0, 60.0, 1000.0])
    points = 1j * w if time is None else np.exp(1j * w * time)
    expected = [
        plant.C @ np.linalg.solve(point * np.eye(len(plant.A)) - plant.A, plant.B0)
        for point in points
    ]
    error = np.abs(plant.response()(w) - expected).max(axis=(1, 2))
    assert (error < 1e-6 * np.abs(expected).max(axis=(1, 2))).all()


def test_poles_are_those_of_the_simulated_loop():
    controller = default_controller(TWO, T)
    model = linearize(TWO, AT_TWO[0])
    poles = loop_poles(loop_plant(model, T), linear_feedback(controller))
    expected = sampled_loop(model, controller).largest_pole
    assert np.abs(poles).max() == pytest.approx(expected, rel=1e-9)


def test_feedback_of_a_cascade_is_its_own():
    slow = Controller(np.array([0.08, 0.2]), np.array([0.3, np.inf]), np.array([4.0, 0.0]), T,
                      np.array([0.0, 4e-3]))  # fmt: skip
    w = np.array([3.0, 200.0, 1200.0])
    F = linear_feedback(slow).response(w)
    np.testing.assert_allclose(np.diagonal(F, axis1=1, axis2=2), slow.feedback(w), rtol=1e-9)
    assert np.abs(F[:, 0, 1]).max() == 0


def test_a_notch_takes_what_it_says_where_it_says():
    notch = Notch(frequency=300.0, zeros=0.05, poles=0.5)
    for feedback in (linear_feedback(CASCADE), linear_feedback(control.tf([2.0, 1.0], [1e-3, 1]))):
        filtered = feedback.filtered(0, notch, gain=0.8)
        w = np.array([300.0, 1.0])
        ratio = np.abs(filtered.response(w) / feedback.response(w)).ravel()
        np.testing.assert_allclose(ratio, [0.8 * 0.1, 0.8], rtol=1e-3)


def test_compliance_under_a_controller_has_the_motors_branch_in_series():
    w = np.array([0.02, 60.0, 400.0])
    tool = tool_model(ONE, AT_ONE, Frame("rod", (0.8, 0.0, 0.0)))
    closed, clamped = (
        tool.response(w, motors=motors)[0, :, 2, 2]
        for motors in (linear_feedback(CASCADE), "clamped")
    )
    # Slowly, the integral part holds the motor.
    assert abs(closed[0]) == pytest.approx(abs(clamped[0]), rel=0.02)
    twisted = ONE.equilibrium(AT_ONE).coordinates[0, 0]
    across, slope = 0.8 * np.cos(twisted), -4 * 9.81 * 0.5 * np.sin(twisted)
    hold = np.sinc(w * T / 2 / np.pi) * np.exp(-1j * w * T / 2)
    motor = 2500 * (-1e-3 * w**2 + 2e-3j * w + hold * CASCADE.feedback(w)[:, 0])
    spring = 5e3 + 4j * w
    expected = across**2 / (slope - 1.2 * w**2 + spring * motor / (spring + motor))
    np.testing.assert_allclose(closed, expected, rtol=1e-9)


def test_controllers_in_files(tmp_path):
    feedback = linear_feedback(CASCADE)
    matrices = {name: getattr(feedback, name).tolist() for name in "ABCD"}
    path = tmp_path / "controller.json"
    path.write_text(json.dumps({"schema": "controller/1", "sample_time": T} | matrices))
    w = np.array([10.0, 100.0])
    np.testing.assert_allclose(linear_feedback(path).response(w), feedback.response(w))
    motor = {"numerator": [GAIN * LEAD, GAIN], "denominator": [LAG, 1.0]}
    path.write_text(json.dumps({"schema": "controller/1", "motors": [motor, motor]}))
    expected = GAIN * (1 + 1j * LEAD * w) / (1 + 1j * LAG * w)
    response = linear_feedback(path).response(w)
    np.testing.assert_allclose(response, expected[:, None, None] * np.eye(2), rtol=1e-9)


MISTAKES = {
    '{"schema": "controller/1"}': "either motors, or A, B, C and D",
    '{"schema": "controller/1", "D": [[1.0], [2.0]]}': r"D of shape \(2, 1\)",
    '{"schema": "controller/1", "D": [[1.0], [2.0, 3.0]]}': "controller.json",
    '{"schema": "controller/1", "motors": [{"numerator": [1.0, 0.0], "denominator": [1.0]}]}':
        "motor 1: a numerator of order 1 over a denominator of order 0",
}  # fmt: skip


@pytest.mark.parametrize("text", MISTAKES)
def test_mistakes_in_files(tmp_path, text):
    path = tmp_path / "controller.json"
    path.write_text(text)
    with pytest.raises(InvalidInput, match=MISTAKES[text]) as error:
        linear_feedback(path)
    assert "controller.json" in str(error.value)


def test_other_mistakes():
    with pytest.raises(InvalidInput, match="1 motors, the robot has 2"):
        loop_margins(TWO, AT_TWO, linear_feedback(CASCADE))
    with pytest.raises(InvalidInput, match="a float"):
        linear_feedback(3.0)
    with pytest.raises(InvalidInput, match="without its sample time"):
        linear_feedback(control.tf([1.0], [1.0, 0.5], True))
    with pytest.raises(InvalidInput, match=r"controller: B of shape"):
        LinearFeedback(np.eye(2), np.ones((3, 1)), np.ones((1, 2)), np.ones((1, 1)))
