"""Springs from deflections, on a movement that was integrated forward."""

from dataclasses import replace

import numpy as np
import pytest
from elastic_movement import COULOMB, DELAY, VISCOUS, elastic_movement, loaded

from estimators import DeflectionAssumptions, fit_deflection, systematic_terms
from estimators.logs.correlated_regression import Series, regress
from robotmodels import ElasticRobot, InvalidInput, Movement


def by_name(fit):
    return {interval.name: interval for interval in fit.intervals()}


def without(movement, role):
    signals = {name: values for name, values in movement.signals.items() if name != role}
    return replace(movement, signals=signals)


def test_a_record_gives_springs_delays_payload_and_friction():
    truth = elastic_movement()
    # Of another payload to start with: the record tells its own.
    robot = loaded(200.0)
    fit = fit_deflection(robot, truth.movement, systematic=())
    found = by_name(fit)
    for spring in robot.file.springs:
        assert found[f"{spring.name}.stiffness"].value == pytest.approx(spring.stiffness, rel=0.02)
    for j, motor in enumerate(robot.file.motors[:3]):
        assert found[f"{motor.name}.delay"].value == pytest.approx(DELAY, abs=1e-5)
        coulomb, viscous = (found[f"{motor.name}.{e}"].value for e in ("coulomb", "viscous"))
        assert coulomb * motor.gear_ratio == pytest.approx(COULOMB[j], rel=0.05)
        assert viscous * motor.gear_ratio**2 == pytest.approx(VISCOUS[j], rel=0.05)
    assert found["payload.mass"].value == pytest.approx(150.0, abs=1.0)
    assert not fit.flags
    identified = fit.robot()
    assert identified.file.payload.mass == found["payload.mass"].value
    assert identified.file.springs[0].stiffness == found["g1.stiffness"].value


def test_another_record_is_explained_and_two_are_pooled():
    one, other = elastic_movement(), elastic_movement(seed=1)
    fit = fit_deflection(one.robot, one.movement, systematic=())
    for centred in (False, True):
        shares = fit.explained_share(other.movement, centred=centred)
        assert min(shares.values()) > 0.999
    # Encoders have offsets and delays of their own in each record.
    late = {
        name: np.roll(values, 2, axis=0) + 1e-3 if name == "link_angle" else values
        for name, values in other.movement.signals.items()
    }
    both = fit_deflection(
        one.robot, [one.movement, replace(other.movement, signals=late)], systematic=()
    )
    found = by_name(both)
    assert found["g2.stiffness"].value == pytest.approx(7.5189e6, rel=0.02)
    assert found["m2.delay in record 1"].value == pytest.approx(DELAY, abs=1e-5)
    assert found["m2.delay in record 2"].value == pytest.approx(DELAY + 0.008, abs=1e-5)


def test_systematic_terms_widen_intervals_each_by_its_size():
    truth = elastic_movement()
    terms = [t for t in systematic_terms(DeflectionAssumptions()) if "torque" in t.name]
    fit = fit_deflection(truth.robot, truth.movement, systematic=terms)
    (shifts,) = fit.systematic_shifts().values()
    # Five per cent more torque is as much more weight, links included, at the same deflection.
    assert shifts["g3.stiffness"] == pytest.approx(0.05, abs=0.005)
    plain = fit_deflection(truth.robot, truth.movement, systematic=())
    noise, total = (by_name(f)["g3.stiffness"].std for f in (plain, fit))
    expected = np.hypot(noise, 0.05 / np.sqrt(3) * by_name(fit)["g3.stiffness"].value)
    assert total == pytest.approx(expected, rel=0.1)


def test_a_counterbalance_or_a_delay_that_is_left_out_is_flagged():
    truth = elastic_movement()
    file = truth.robot.file.model_copy(update={"counterbalances": []})
    plain = ElasticRobot(file, truth.robot.folder)
    fit = fit_deflection(plain, truth.movement, systematic=())
    assert fit.flags[0].motor == "m2"
    assert "counterbalance missing" in fit.flags[0].remark
    assert by_name(fit)["g2.stiffness"].verdict == "model error"
    assert by_name(fit)["payload.mass"].verdict == "model error"
    at = DeflectionAssumptions(delays=False)
    fit = fit_deflection(truth.robot, truth.movement, assumptions=at, systematic=())
    assert {flag.motor for flag in fit.flags} == {"m1", "m2", "m3"}
    assert "3 ms of delay" in fit.flags[0].remark


def test_a_gear_whose_deflection_noise_hides_is_not_identifiable():
    truth = elastic_movement()
    rng = np.random.default_rng(3)
    link = truth.movement.link_angle.copy()
    link[:, 0] += 1e-3 * autocorrelated(rng, len(link), 0.99)  # ten times what the gear does
    signals = {**truth.movement.signals, "link_angle": link}
    fit = fit_deflection(truth.robot, replace(truth.movement, signals=signals), systematic=())
    assert by_name(fit)["g1.stiffness"].verdict == "not identifiable"
    assert by_name(fit)["g1.stiffness"].high is None
    assert by_name(fit)["g2.stiffness"].verdict == "trustworthy"
    assert fit.robot().file.springs[0] == truth.robot.file.springs[0]


def test_joints_at_rest_are_not_identifiable():
    truth = elastic_movement()
    signals = {name: values.copy() for name, values in truth.movement.signals.items()}
    for name in ("motor_angle", "link_angle"):
        signals[name][:, 0] = 0.1
    fit = fit_deflection(truth.robot, replace(truth.movement, signals=signals), systematic=())
    found = by_name(fit)
    assert found["g1.stiffness"].verdict == "not identifiable"
    assert "hardly moves" in found["g1.stiffness"].verdict.reason
    assert found["g2.stiffness"].verdict == "trustworthy"
    for name in ("motor_angle", "link_angle"):
        signals[name][:] = signals[name][0]
    with pytest.raises(InvalidInput, match=r"payload's weight|moves faster"):
        fit_deflection(truth.robot, replace(truth.movement, signals=signals), systematic=())


def test_without_torques_stiffness_is_refused_or_conditional():
    truth = elastic_movement()
    silent = without(truth.movement, "motor_torque")
    with pytest.raises(InvalidInput, match=r"motor_torque is missing.*payload='robot file'"):
        fit_deflection(truth.robot, silent)
    fits = {
        mass: fit_deflection(loaded(mass), silent, payload="robot file", systematic=())
        for mass in (150.0, 200.0)
    }
    verdict = by_name(fits[150.0])["g3.stiffness"].verdict
    assert "for a payload of 150 kg" in verdict.reason
    stiffnesses = [by_name(fit)["g3.stiffness"].value for fit in fits.values()]
    assert stiffnesses[1] / stiffnesses[0] == pytest.approx(255 / 205, rel=0.03)


def test_torque_sensors_of_joints_need_no_payload():
    truth = elastic_movement()
    sensed = np.full_like(truth.movement.motor_angle, np.nan)
    sensed[:, :3] = truth.gears
    signals = {**truth.movement.signals, "joint_torque": sensed}
    movement = without(replace(truth.movement, signals=signals), "motor_torque")
    # The file's payload is wrong, and nothing depends on it.
    fit = fit_deflection(loaded(20.0), movement, systematic=())
    found = by_name(fit)
    for spring in truth.robot.file.springs:
        assert found[f"{spring.name}.stiffness"].value == pytest.approx(spring.stiffness, rel=0.01)
        assert "payload" not in found[f"{spring.name}.stiffness"].verdict.reason
    assert "payload.mass" not in found
    assert min(fit.explained_share(movement).values()) > 0.999


def test_a_robot_without_payload_has_none_to_estimate():
    truth = elastic_movement(mass=0.0)
    robot = ElasticRobot(truth.robot.file.model_copy(update={"payload": None}), truth.robot.folder)
    fit = fit_deflection(robot, truth.movement)
    found = by_name(fit)
    assert "payload.mass" not in found
    assert found["g3.stiffness"].value == pytest.approx(4.0999e6, rel=0.02)
    assert all("payload.mass" not in shifts for shifts in fit.systematic_shifts().values())


def autocorrelated(rng, size, correlation):
    noise = rng.standard_normal(size)
    for i in range(1, size):
        noise[i] = correlation * noise[i - 1] + np.sqrt(1 - correlation**2) * noise[i]
    return noise


def test_intervals_of_correlated_residuals_cover_and_naive_ones_do_not():
    rng, inside, naive = np.random.default_rng(4), 0, 0
    time = np.arange(1500) * 0.004
    x = np.stack([np.sin(1.3 * time), np.sin(2.1 * time)], axis=1)
    runs = 300
    for _ in range(runs):
        noise = autocorrelated(rng, len(time), np.exp(-0.004 / 0.3))
        series = Series(noise, x, np.ones((len(time), 1)), np.ones(len(time), bool), 25)
        fit = regress([series])
        inside += abs(fit.coefficients[0]) < 2 * fit.std(0)
        plain = fit.rms * np.sqrt(np.linalg.inv(x.T @ x)[0, 0])
        naive += abs(fit.coefficients[0]) < 2 * plain
    assert 0.88 < inside / runs < 1.0
    assert naive / runs < 0.5


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"joints": ("a", "b", "c", "d", "e", "f")}, "neither motor 'm1' nor its joint 'joint1'"),
        (
            {"motor_angle": np.degrees},
            "link_angle of 'm1' is up to",
        ),
        ({"link_angle": lambda x: np.full_like(x, np.nan)}, "no joint has an encoder behind"),
        (
            {"link_angle": lambda x: np.where(np.arange(len(x))[:, None] < 3, np.nan, x)},
            "some samples",
        ),
    ],
)
def test_records_that_do_not_fit(change, message):
    movement = elastic_movement().movement
    signals = {
        name: change[name](values) if name in change else values
        for name, values in movement.signals.items()
    }
    joints = change.get("joints", movement.joints)
    with pytest.raises(InvalidInput, match=message):
        fit_deflection(loaded(150.0), Movement(joints, movement.sample_time, signals))


def test_settings_that_make_no_sense():
    truth = elastic_movement()
    with pytest.raises(InvalidInput, match="low_pass: -1"):
        DeflectionAssumptions(low_pass=-1)
    with pytest.raises(InvalidInput, match="low_pass: 200 Hz"):
        fit_deflection(
            truth.robot, truth.movement, assumptions=DeflectionAssumptions(low_pass=200.0)
        )
    with pytest.raises(InvalidInput, match="payload: 'guess'"):
        fit_deflection(truth.robot, truth.movement, payload="guess")
