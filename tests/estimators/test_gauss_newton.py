"""Gauss-Newton steps against the search in a trust region, which is their judge."""

import numpy as np
import pytest
from test_least_squares import MODEL, TRUTH, noisy

from estimators import FrfExperiment, simulate_frf
from estimators.fitting.fixed_equilibrium_search import can_compile, cost_kernel
from estimators.fitting.frf_problem import frf_problem
from estimators.fitting.gauss_newton import (
    damped_gauss_newton,
    damped_step,
    gauss_newton,
    predicted_change,
)
from estimators.fitting.search import exact_search, search
from estimators.fitting.trust_region import Residuals
from estimators.validation.simulated_experiment import RunSettings
from robotmodels import InvalidInput, RelativeNoise, load_robot
from robotmodels.linear.derived_models import with_fixed_equilibria
from robotmodels.linear.normal_equations import NormalEquations

NOISE = RelativeNoise(0.03, 0.01)


@pytest.fixture(scope="module")
def robot():
    return load_robot("ur10")


@pytest.fixture(scope="module")
def estimate(robot):
    """FRFs that are enough for compiled code."""
    rng = np.random.default_rng(0)
    low, high = robot.position_limits.T
    positions = low + (high - low) * rng.uniform(0.2, 0.8, (5, len(low)))
    return simulate_frf(robot, positions, 2 * np.pi * np.geomspace(3.0, 60.0, 20), NOISE, rng)


def standard_deviations(problem, values):
    _, slope = problem.evaluate(values)
    return np.sqrt(np.diagonal(np.linalg.inv(slope.T @ slope)))


@pytest.mark.parametrize("residual", ["nls", "lls", "lls_magnitude"])
def test_from_the_truth_it_ends_where_a_trust_region_does(residual):
    for seed in range(4):
        problem = frf_problem(MODEL, noisy(seed), residual, "optimal")
        expected = exact_search(problem, TRUTH, 200, 1e-12)
        outcome = exact_search(problem, TRUTH, 200, 1e-10, gauss_newton)
        apart = np.log(outcome.values / expected.values) / standard_deviations(problem, TRUTH)
        assert np.abs(apart).max() < 1e-4
        assert outcome.cost == pytest.approx(expected.cost, rel=1e-9)
        assert outcome.status > 0
        assert outcome.evaluations <= 4


def test_fixed_equilibria_are_searched_once(robot, estimate):
    model = with_fixed_equilibria(robot, estimate.positions)
    problem = frf_problem(model, estimate, "nls", "optimal")
    assert can_compile(problem, model.fixed)
    truth = robot.parameters.values
    exact = exact_search(problem, truth, 200, 1e-12)
    std = standard_deviations(problem, truth)
    evaluations = []
    for minimise in (damped_gauss_newton, gauss_newton):
        outcome = search(problem, truth, 200, 1e-10, minimise)
        assert np.abs(np.log(outcome.values / exact.values) / std).max() < 1e-3
        assert outcome.cost == pytest.approx(exact.cost, rel=1e-9)
        evaluations.append(outcome.evaluations)
    assert evaluations[1] < evaluations[0]


@pytest.mark.parametrize("factor", [3.0, 0.2])
def test_damped_steps_go_on_from_far_starts(factor):
    problem = frf_problem(MODEL, noisy(), "nls", "optimal")
    start = TRUTH * factor ** np.array([1, -1, 1, -1, 1, -1])
    expected = exact_search(problem, start, 200, 1e-10)
    outcome = exact_search(problem, start, 200, 1e-10, gauss_newton)
    assert outcome.cost == pytest.approx(expected.cost, rel=1e-8)


def test_bounds_hold():
    bounds = np.array([TRUTH * 0.999, TRUTH * 1.001])
    bounds[0, 0], bounds[1, 0] = TRUTH[0] * 1.05, TRUTH[0] * 1.2
    problem = frf_problem(MODEL, noisy(), "nls", "optimal", bounds)
    start = np.sqrt(bounds[0] * bounds[1])
    expected = exact_search(problem, start, 200, 1e-10)
    outcome = exact_search(problem, start, 200, 1e-10, gauss_newton)
    assert outcome.values == pytest.approx(expected.values, rel=1e-6)
    assert outcome.values[0] == pytest.approx(bounds[0, 0], rel=1e-6)


def test_few_evaluations_end_it():
    problem = frf_problem(MODEL, noisy(), "nls", "optimal")
    outcome = exact_search(problem, 1.5 * TRUTH, 2, 1e-10, gauss_newton)
    assert outcome.status == 0


class Plain:
    """The squares of an exact problem as normal equations, which are minimised by damped steps."""

    def __init__(self, problem):
        self.normal_equations = Residuals(problem.evaluate).normal_equations


@pytest.mark.parametrize("residual", ["nls", "lls"])
@pytest.mark.parametrize("seed", range(3))
def test_damped_steps_end_where_a_trust_region_does(residual, seed):
    problem = frf_problem(MODEL, noisy(seed), residual, "optimal")
    start = TRUTH * np.exp(np.random.default_rng(seed).uniform(-0.7, 0.7, len(TRUTH)))
    expected = exact_search(problem, start, 200, 1e-12)
    outcome = damped_gauss_newton(problem, Plain(problem), start, 200, 1e-12)
    assert outcome.status == 2
    assert outcome.cost == pytest.approx(expected.cost, rel=1e-9)
    apart = np.log(outcome.values / expected.values) / standard_deviations(problem, TRUTH)
    assert np.abs(apart).max() < 1e-4


def test_damped_steps_end_at_bounds_where_a_trust_region_does():
    bounds = np.outer([0.5, 2.0], TRUTH)
    bounds[0, 0], bounds[1, 3] = 1.1 * TRUTH[0], 0.95 * TRUTH[3]
    problem = frf_problem(MODEL, noisy(), "nls", "optimal", bounds)
    start = np.sqrt(bounds[0] * bounds[1])
    expected = exact_search(problem, start, 500, 1e-12)
    outcome = damped_gauss_newton(problem, Plain(problem), start, 500, 1e-12)
    assert outcome.values[[0, 3]] == pytest.approx([bounds[0, 0], bounds[1, 3]])
    assert outcome.values == pytest.approx(expected.values, rel=1e-5)
    assert outcome.message.endswith(f"at a bound: {problem.names[0]}, {problem.names[3]}")


@pytest.mark.parametrize("seed", range(30))
@pytest.mark.parametrize("minimise", [damped_gauss_newton, gauss_newton])
def test_the_minimum_in_a_narrow_box_is_that_of_a_trust_region(seed, minimise):
    rng = np.random.default_rng(seed)
    half = np.exp(rng.uniform(0.001, 0.4, len(TRUTH)))
    centre = TRUTH * np.exp(0.2 * rng.standard_normal(len(TRUTH)))
    bounds = np.array([centre / half, centre * half])
    problem = frf_problem(MODEL, noisy(seed % 5), "nls", "optimal", bounds)
    start = centre * half ** rng.uniform(-0.99, 0.99, len(TRUTH))
    expected = exact_search(problem, start, 500, 1e-12)
    outcome = minimise(problem, Plain(problem), start, 500, 1e-12)
    assert outcome.status == 2
    assert outcome.cost == pytest.approx(expected.cost, rel=1e-7)
    assert ((bounds[0] <= outcome.values) & (outcome.values <= bounds[1])).all()


def test_steps_are_those_of_the_normal_equations_unless_damped():
    rng = np.random.default_rng(0)
    slope, residual = rng.standard_normal((20, 4)), rng.standard_normal(20)
    slope[:, 3] = 0.0  # not seen by the data
    slope[:, 1] *= 1e6
    normal = NormalEquations(residual @ residual, 2 * slope.T @ residual, 2 * slope.T @ slope)
    everyone = np.full(4, True)
    step = damped_step(normal, 0.0, everyone)
    expected = np.linalg.lstsq(slope[:, :3], -residual)[0]
    assert step == pytest.approx([*expected, 0.0], rel=1e-9)
    ends = [residual @ residual, np.sum((residual + slope @ step) ** 2)]
    assert predicted_change(normal, step) == pytest.approx(ends[1] - ends[0])
    held = damped_step(normal, 0.0, np.array([True, False, True, True]))
    expected = np.linalg.lstsq(slope[:, [0, 2]], -residual)[0]
    assert held == pytest.approx([expected[0], 0.0, expected[1], 0.0], rel=1e-9)


def test_far_away_no_parameter_by_itself_moves_further_than_damping_lets_it():
    gradient, curvature = np.array([1e3, -1e9, 1e-9]), np.array([1.0, 1e2, 1e3])
    normal = NormalEquations(1.0, gradient, np.diag(curvature))
    step = damped_step(normal, 0.5, np.full(3, True))
    assert step[:2] == pytest.approx([-2.0, 2.0], rel=1e-2)
    assert step[2] == pytest.approx(-1e-12)  # where slopes are small, steps are full


def test_runs_that_share_a_kernel_give_the_same_bits(robot, estimate):
    model = with_fixed_equilibria(robot, estimate.positions)
    experiment = FrfExperiment(model, estimate.positions, estimate.omega, NOISE)
    settings = RunSettings(experiment, model, "nls", "optimal", (), 0.95, "known")
    together = settings.several(range(3))
    for seed, run in enumerate(together):
        (alone,) = settings.several([seed])
        assert (alone["estimates"] == run["estimates"]).all()
        assert alone["costs"] == run["costs"]


def test_a_kernel_of_other_data_is_that_of_a_new_one(robot, estimate):
    values = 1.1 * robot.parameters.values
    network = robot.network(estimate.positions)
    for residual in ("nls", "lls", "lls_magnitude"):
        problem = frf_problem(robot, estimate, residual, "optimal")
        kernel = cost_kernel(problem, network)
        other, weights = 1.1 * estimate.response, 2 * np.asarray(problem.weights)
        moved = kernel.of_data(other, weights)
        fresh = type(kernel)(network, estimate.omega, other, weights, residual)
        assert (moved(values) == fresh(values)).all()
        assert (moved.gradient(values)[1] == fresh.gradient(values)[1]).all()
        assert kernel(values) != moved(values)
        with pytest.raises(InvalidInput, match="a finite FRF"):
            kernel.of_data(np.nan * other, weights)
