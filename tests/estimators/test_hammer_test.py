"""A hammer test as data: its model, fits to it, and together with motor-side data."""

import numpy as np
import pytest
import yaml
from robots import HERE, built, changed

import estimators
from robotmodels import (
    Frame,
    HammerTest,
    InvalidInput,
    RelativeNoise,
    frequency_response,
    sensitivity,
    tool_model,
)
from robotmodels.linear.response import by_ln_theta

SENSORS = [
    {"name": f"tip {axis}", "link": "tool0", "at": [0.0, 0.0, 0.1], "direction": direction}
    for axis, direction in (("x", [1.0, 0.0, 0.0]), ("z", [0.0, 0.0, 1.0]))
]
CONTENT = yaml.safe_load((HERE / "two_joints.yaml").read_text()) | {"accelerometers": SENSORS}
ROBOT = built(CONTENT)
TIP = Frame("tool0", (0.0, 0.0, 0.1), "link")
POSITIONS = np.array([[-0.8, 0.4], [-1.2, 0.9], [-0.4, -0.8]])
OMEGA = 2 * np.pi * np.geomspace(4.0, 50.0, 15)
NOISE = RelativeNoise(relative=0.03, floor=1e-4)
HAMMER = HammerTest(ROBOT, TIP, [[1.0, 0.0, 0.0], [0.0, 0.0, 2.0]])


@pytest.mark.parametrize("motors", ["clamped", "free"])
def test_responses_are_accelerances_of_the_frame(motors):
    robot = built(changed(CONTENT, gravity=[0.0, 0.0, 0.0]))  # which a tilted sensor feels
    hammer = HammerTest(robot, TIP, np.eye(3)[[0, 2]], motors)
    expected = tool_model(robot, POSITIONS, TIP).response(OMEGA, "acceleration", motors)
    response = frequency_response(hammer, POSITIONS, OMEGA)
    np.testing.assert_allclose(response, expected[:, :, [0, 2]][..., [0, 2]], rtol=1e-5)


def test_responses_to_forces_are_reciprocal_to_those_to_torques():
    robot = built(changed(CONTENT, gravity=[0.0, 0.0, 0.0]))
    hammer = HammerTest(robot, TIP, np.eye(3)[[0, 2]], "free")
    model = tool_model(robot, POSITIONS, TIP)
    by_force = model.response(OMEGA, "acceleration", "free", "motors")[..., [0, 2]]
    by_torque = frequency_response(robot, POSITIONS, OMEGA)[:, :, 2:]
    np.testing.assert_allclose(by_force, np.swapaxes(by_torque, 2, 3), rtol=1e-7)
    assert hammer.output_names == ("tip x", "tip z")


def test_derivatives_with_fixed_equilibria():
    theta = ROBOT.parameters.values
    G, J = sensitivity(HAMMER, POSITIONS, OMEGA)
    np.testing.assert_allclose(G, frequency_response(HAMMER, POSITIONS, OMEGA), rtol=1e-9)
    expected = by_ln_theta(lambda x: frequency_response(HAMMER, POSITIONS, OMEGA, x), theta)
    scale = np.abs(expected).max(axis=(0, 1, 2, 3))
    assert (np.abs(J - expected) / scale).max() < 0.05


def hits(seed: int) -> estimators.FrfEstimate:
    return estimators.simulate_frf(HAMMER, POSITIONS, OMEGA, NOISE, np.random.default_rng(seed))


def test_fits_find_springs_within_their_deviations():
    z = []
    for seed in range(4):
        fit = estimators.fit(HAMMER, hits(seed), residual="nls", weights="optimal",
                             start=ROBOT.parameters.values * 1.3)  # fmt: skip
        assert fit.converged
        known = estimators.covariance(fit)
        z.append(np.log(fit.parameters.values / ROBOT.parameters.values) / known.std)
    assert 0.4 < np.sqrt(np.mean(np.square(z))) < 1.8
    assert fit.robot().name == ROBOT.name


def test_both_kinds_of_data_together_are_as_certain_as_their_informations_say():
    motor_noise = RelativeNoise(relative=0.1, floor=0.05)
    rng = np.random.default_rng(5)
    data = estimators.simulate_frf(ROBOT, POSITIONS[:1], OMEGA, motor_noise, rng)
    first = estimators.fit(ROBOT, data, residual="nls", weights="optimal")
    before = estimators.covariance(first)
    prior = estimators.robot_prior(first.robot(covariance=before.covariance))
    both = estimators.fit(HAMMER, hits(7), residual="nls", weights="optimal", prior=prior)
    alone = estimators.fit(HAMMER, hits(7), residual="nls", weights="optimal")
    parts = (np.linalg.inv(c.covariance) for c in (before, estimators.covariance(alone)))
    expected = np.sqrt(np.diag(np.linalg.inv(sum(parts))))
    np.testing.assert_allclose(estimators.covariance(both).std, expected, rtol=0.15)


def test_mistakes_are_named():
    with pytest.raises(InvalidInput, match=r"directions \[\[.*\]\]; three finite numbers each"):
        HammerTest(ROBOT, TIP, [1.0, 0.0])
    with pytest.raises(InvalidInput, match="has no output on a link"):
        HammerTest(built(yaml.safe_load((HERE / "two_joints.yaml").read_text())), TIP, [1, 0, 0])
    with pytest.raises(InvalidInput, match="'toool' is not a link"):
        frequency_response(HammerTest(ROBOT, Frame("toool"), [1, 0, 0]), POSITIONS, OMEGA)
