"""Responses and sensitivities against closed forms, dense solves and finite differences."""

from collections.abc import Callable

import numpy as np
import pytest
from robots import CRANE, PENDULUM, built, changed

from robotmodels import (
    ElasticRobot,
    InvalidInput,
    frequency_response,
    linearize,
    load_robot,
    sensitivity,
)

OMEGA = 2 * np.pi * np.geomspace(1.0, 100.0, 7)
GRAVITY_TORQUE = 4 * 9.81 * 0.5  # of the level pendulum [N m]


def random_positions(robot: ElasticRobot, count: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.uniform(*robot.position_limits.T, (count, len(robot.motor_names)))


def central_differences(
    response: Callable[[np.ndarray], np.ndarray], theta: np.ndarray
) -> np.ndarray:
    """Return d response / d ln theta to fourth order."""
    h, columns = 1e-3, []
    for unit in np.eye(len(theta)):
        f = {k: response(theta * np.exp(k * h * unit)) for k in (-2, -1, 1, 2)}
        columns.append((8 * (f[1] - f[-1]) - (f[2] - f[-2])) / (12 * h))
    return np.stack(columns, axis=-1)


def error(found: np.ndarray, expected: np.ndarray) -> float:
    """Return the largest error, relative to the largest derivative by a parameter."""
    scale = np.abs(expected).max(axis=(1, 2, 3), keepdims=True)
    return float((np.abs(found - expected) / scale).max())


ROBOTS = {
    "ur10": lambda: load_robot("ur10"),
    "crane": lambda: built(CRANE),
}


@pytest.mark.parametrize("name", ROBOTS)
def test_sensitivities_are_derivatives_of_the_response(name: str) -> None:
    robot = ROBOTS[name]()
    positions = random_positions(robot, 2)
    theta = robot.parameters.values * np.linspace(0.9, 1.1, len(robot.parameters))
    G, J = sensitivity(robot, positions, OMEGA, theta)
    expected = central_differences(lambda t: frequency_response(robot, positions, OMEGA, t), theta)
    np.testing.assert_allclose(
        G, frequency_response(robot, positions, OMEGA, theta), rtol=1e-10, atol=1e-12
    )
    assert error(J, expected) < 1e-6


@pytest.mark.parametrize("name", ["ur10", "crane"])
def test_sensitivities_without_sag_hold_the_equilibria(name: str) -> None:
    """They are derivatives of the frozen network, and not of the whole response."""
    robot = ROBOTS[name]()
    positions = random_positions(robot, 3)
    theta = robot.parameters.values
    J = sensitivity(robot, positions, OMEGA, equilibrium_shift=False)[1]
    exact = sensitivity(robot, positions, OMEGA)[1]
    assert error(J, exact) > 1e-5
    network = robot.network(positions)
    frozen = central_differences(lambda t: network.frequency_response(OMEGA, t), theta)
    assert error(J, frozen) < 1e-6


@pytest.mark.parametrize("name", ["ur10", "crane"])
def test_response_is_the_dense_solve_of_the_linear_model(name: str) -> None:
    robot = ROBOTS[name]()
    positions = random_positions(robot, 3)
    G = frequency_response(robot, positions, OMEGA)
    for i, position in enumerate(positions):
        model = linearize(robot, position)
        M, D, K, S = model.mass, model.damping, model.stiffness, model.selector
        for j, w in enumerate(OMEGA):
            dense = -(w**2) * S.T @ np.linalg.inv(K - w**2 * M + 1j * w * D) @ S
            np.testing.assert_allclose(G[i, j], dense, rtol=0, atol=1e-10 * np.abs(dense).max())


def pendulum_response(angle: float, omega: np.ndarray) -> np.ndarray:
    """Return motor torque to motor acceleration of the sagging pendulum: a two-mass system."""
    k, c, r = 5e3, 4.0, 50.0
    rotor, inertia, d = 1e-3 * r**2, 0.2 + 4 * 0.25, 2e-3 * r**2
    sag = 0.0
    for _ in range(20):  # a contraction by 20 / 5000 a step
        sag = -GRAVITY_TORQUE / k * np.cos(angle + sag)
    gravity = -GRAVITY_TORQUE * np.sin(angle + sag)
    s = 1j * omega
    arm = inertia * s**2 + c * s + k + gravity
    motor = rotor * s**2 + (c + d) * s + k
    return r**2 * s**2 * arm / (arm * motor - (c * s + k) ** 2)


@pytest.mark.parametrize("angle", [-1.3, 0.0, 0.7, 1.5])
def test_one_axis_is_a_two_mass_system(angle: float) -> None:
    G = frequency_response(built(PENDULUM), np.array([[angle]]), OMEGA)[0, :, 0, 0]
    np.testing.assert_allclose(G, pendulum_response(angle, OMEGA), rtol=1e-10)


@pytest.mark.parametrize(("output", "order"), [("velocity", 1), ("position", 2)])
def test_other_outputs_are_integrals_of_the_acceleration(output: str, order: int) -> None:
    content = changed(PENDULUM, output=output, delay=1e-3)
    G = frequency_response(built(content), np.array([[0.7]]), OMEGA)[0, :, 0, 0]
    late = np.exp(-1e-3j * OMEGA) / (1j * OMEGA) ** order
    np.testing.assert_allclose(G, late * pendulum_response(0.7, OMEGA), rtol=1e-10)


def test_linearize_takes_one_position_or_many() -> None:
    robot = built(PENDULUM)
    many = linearize(robot, np.array([[0.1], [0.7]]))
    one = linearize(robot, np.array([0.7]))
    assert many.mass.shape == (2, 2, 2)
    for name in ("mass", "damping", "stiffness"):
        np.testing.assert_array_equal(getattr(one, name), getattr(many, name)[1])


def test_no_positions_give_no_responses() -> None:
    assert frequency_response(built(PENDULUM), np.zeros((0, 1)), OMEGA).shape == (0, 7, 1, 1)


@pytest.mark.parametrize(
    ("omega", "message"),
    [
        ([1.0, 0.0], r"omega\[1\]: 0 rad/s is not a positive frequency"),
        ([-3.0], r"omega\[0\]: -3 rad/s is not a positive"),
        ([np.nan], r"omega\[0\]: nan"),
        ([], r"omega: shape \(0,\) given"),
        ([1 + 2j], r"omega: an array of real numbers is needed, found \[\(1\+2j\)\]"),
        ([[1.0]], r"omega: shape \(1, 1\) given; a non-empty \(F,\) array"),
    ],
)
def test_frequencies_must_be_positive(omega: list, message: str) -> None:
    robot = built(PENDULUM)
    for question in (frequency_response, sensitivity):
        with pytest.raises(InvalidInput, match=message):
            question(robot, np.zeros((1, 1)), omega)


def test_parameters_must_be_positive_and_as_many_as_the_robot_has() -> None:
    robot, position = built(PENDULUM), np.zeros((1, 1))
    with pytest.raises(
        InvalidInput, match=r"shape \(3,\) was given, \(2,\) is needed, in the order g"
    ):
        frequency_response(robot, position, OMEGA, np.ones(3))
    with pytest.raises(InvalidInput, match=r"parameter g\.damping: -4 is not a positive number"):
        sensitivity(robot, position, OMEGA, np.array([5e3, -4.0]))
