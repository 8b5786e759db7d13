import numpy as np
import pytest
from collision_arm import arm

from oed import InformationSet, candidate_positions, exact_design, information, optimal_design
from oed.exact.local_ascent import Region
from oed.exact.off_grid import refined_design, refined_over
from robotmodels import InvalidInput, RelativeNoise, surroundings

COARSE = np.array([-1.0, -0.7, -0.3, 0.25, 0.6, 0.9])[:, None]
FINE = np.linspace(-1, 1, 201)[:, None]


def regression(positions):
    """Return the information of 1, x, x^2."""
    x = positions[:, 0]
    f = np.stack([np.ones_like(x), x, x**2], axis=1)
    return f[:, :, None] * f[:, None, :]


def anywhere(positions):
    return np.ones(len(positions), dtype=bool)


def line(usable=anywhere):
    return Region(np.array([[-1.0, 1.0]]), regression, usable)


def coarse():
    return InformationSet(COARSE, regression(COARSE), ("a", "b", "c"))


def test_quadratic_regression_finds_its_three_points():
    result = refined_over(coarse(), line(), FINE, tolerance=1e-4)
    support = np.sort(result.candidates.positions[result.design.support, 0])
    np.testing.assert_allclose(support, [-1, 0, 1], atol=0.02)
    best = np.log(4 / 27)
    assert result.converged
    assert 0 <= best - result.design.value < 1e-3
    grid = optimal_design(coarse()).value
    assert result.gain == pytest.approx(np.exp((result.design.value - grid) / 3) - 1)
    assert result.gain == pytest.approx(np.exp((best - grid) / 3) - 1, abs=1e-4)
    assert 0 <= result.gap < 1e-4
    assert result.checked == 201
    exact = exact_design(result.candidates, 3, result.design)
    assert exact.efficiency > 0.999


def test_it_stays_in_usable_places():
    """Without (-0.2, 0.2) the middle point goes to an edge of the gap."""
    result = refined_over(coarse(), line(lambda q: np.abs(q[:, 0]) >= 0.2), FINE, tolerance=1e-3)
    used = result.candidates.positions[result.design.support, 0]
    assert (np.abs(used) >= 0.2).all()
    finer = np.abs(FINE[:, 0]) >= 0.2
    assert result.checked == finer.sum()
    points = FINE[finer]
    best = optimal_design(InformationSet(points, regression(points), ("a", "b", "c"))).value
    assert abs(result.design.value - best) < 0.01


def test_prior_information_moves_the_support():
    prior = 5 * regression(np.array([[-1.0], [0.0]])).sum(axis=0)
    result = refined_over(coarse(), line(), FINE, prior=prior)
    used = result.candidates.positions[result.design.support, 0]
    assert used[np.argmax(result.design.weights[result.design.support])] == pytest.approx(1.0)


def test_e_with_two_equal_eigenvalues_at_its_optimum():
    """A linear function of two variables on a square: the corners, where M is the identity."""

    def linear(x):
        return x[:, :, None] * x[:, None, :]

    angle = np.linspace(0, np.pi, 7)[:-1]
    within = 0.6 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    square = Region(np.array([[-1.0, 1.0]] * 2), linear, anywhere)
    axis = np.linspace(-1, 1, 9)
    finer = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    info = InformationSet(within, linear(within), ("a", "b"))
    result = refined_over(info, square, finer, criterion="E")
    assert result.converged
    assert result.design.value == pytest.approx(1.0, abs=1e-6)
    support = result.candidates.positions[result.design.support]
    np.testing.assert_allclose(np.abs(support), 1.0, atol=1e-6)


def test_nothing_to_gain_on_a_fine_grid():
    info = InformationSet(FINE, regression(FINE), ("a", "b", "c"))
    result = refined_over(info, line(), FINE)
    assert result.rounds == 1
    assert result.gain == pytest.approx(0.0, abs=1e-9)
    assert result.converged


def test_a_robot_above_the_floor(tmp_path):
    """No random position the robot can take promises more than the stated bounds."""
    robot = arm(tmp_path)
    omega, noise = 2 * np.pi * np.geomspace(2, 60, 6), RelativeNoise(0.03, 0.01)
    around = surroundings(robot, floor=0.0)
    grid = candidate_positions(robot, (3, 3, 3), 0.5 * robot.position_limits)
    grid = grid[~around.touching(grid).any(axis=1)]
    info = information(robot, grid, omega, noise)
    seen = []
    result = refined_design(
        robot,
        info,
        omega,
        noise,
        surroundings=around,
        finer=16,
        tolerance=0.05,
        max_rounds=2,
        rng=np.random.default_rng(1),
        progress=lambda done, total: seen.append((done, total)),
    )
    assert result.gain > 0.01
    assert seen[-1] == (result.rounds, 2)
    used = result.candidates.positions[result.design.support]
    assert not around.touching(used).any()
    places = np.random.default_rng(5).uniform(*robot.position_limits.T, (400, 3))
    places = places[~around.touching(places).any(axis=1)]
    prices = information(robot, places, omega, noise).directional_derivatives(
        np.linalg.inv(result.design.information)
    )
    p = len(info.names)
    assert prices.max() / p - 1 <= max(result.gap, result.beyond) + 0.01


def test_torque_limits_that_do_not_fit_are_said(tmp_path):
    robot, omega, noise = arm(tmp_path), np.array([30.0]), RelativeNoise(0.03, 0.01)
    names = robot.parameters.names
    info = InformationSet(np.zeros((1, 3)), np.eye(len(names))[None], names)
    with pytest.raises(InvalidInput, match=r"torque_limits: shape \(2,\)"):
        refined_design(robot, info, omega, noise, torque_limits=np.ones(2), finer=4)


@pytest.mark.parametrize("entries", [{"max_rounds": 0}, {"tolerance": 0.0}])
def test_bad_input(entries):
    with pytest.raises(InvalidInput, match=r"refine: max_rounds .* must be positive"):
        refined_over(coarse(), line(), FINE, **entries)
