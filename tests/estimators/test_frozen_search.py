from dataclasses import replace

import numpy as np
import pytest
from test_least_squares import MODEL, noisy

from estimators import Prior, fit, simulate_frf
from estimators.fitting.fixed_equilibrium_search import (
    CorrectedModel,
    can_compile,
    frozen_search,
    hardens,
    network_and_shift,
)
from estimators.fitting.frf_problem import frf_problem
from estimators.fitting.gauss_newton import damped_gauss_newton
from estimators.fitting.search import MINIMISERS, exact_search, search
from robotmodels import InvalidInput, RelativeNoise, SolverFailed, load_robot
from robotmodels.linear.normal_equations import NormalEquations

BOUNDS = (1e-3, 1e3)
OMEGA = 2 * np.pi * np.geomspace(3.0, 60.0, 12)


@pytest.fixture(scope="module")
def robot():
    return load_robot("ur10")


@pytest.fixture(scope="module")
def estimate(robot):
    rng = np.random.default_rng(0)
    low, high = robot.position_limits.T
    positions = low + (high - low) * rng.uniform(0.2, 0.8, (3, len(low)))
    return simulate_frf(robot, positions, OMEGA, RelativeNoise(0.03, 0.01), rng)


def far(robot, seed=1, decades=0.5):
    exponents = np.random.default_rng(seed).uniform(-decades, decades, len(robot.parameters))
    return robot.parameters.values * 10**exponents


def known(robot):
    names = robot.parameters.names[:2]
    return Prior(names, 1.1 * robot.parameters.values[:2], np.array([0.01, 0.02]))


def frozen(problem, start, evaluations=200, tolerance=1e-10):
    network = problem.model.network(problem.positions, start)
    return frozen_search(problem, start, network, evaluations, tolerance)


@pytest.mark.parametrize("residual", ["nls", "lls", "lls_magnitude"])
def test_cost_and_gradient_are_those_of_the_whitened_residuals(robot, estimate, residual):
    problem = frf_problem(robot, estimate, residual, "user", BOUNDS, None, known(robot))
    values = far(robot)
    f, slope = problem.evaluate(values)
    network, equilibrium_shift = network_and_shift(problem, values)
    normal = CorrectedModel(problem, network, equilibrium_shift).normal_equations(values)
    assert np.isclose(normal.cost, f @ f, rtol=1e-12)
    gradient = 2 * slope.T @ f
    assert np.abs(normal.gradient - gradient).max() < 1e-9 * np.abs(gradient).max()
    # Frozen equilibria give the same cost, and a gradient that lacks the shift.
    normal = CorrectedModel(problem, network, None).normal_equations(values)
    assert np.isclose(normal.cost, f @ f, rtol=1e-12)
    apart = np.abs(normal.gradient - gradient).max() / np.abs(gradient).max()
    assert 1e-6 < apart < 0.05


def test_the_gradient_alone_is_that_of_the_corrected_cost(robot, estimate):
    problem = frf_problem(robot, estimate, "lls", "user", BOUNDS, None, known(robot))
    model = CorrectedModel(problem, *network_and_shift(problem, far(robot)))
    values, step = far(robot, seed=2), 1e-6
    _, gradient = model.gradient(values)
    ends = [
        [model.gradient(values * np.exp(h * e))[0] for h in (step, -step)]
        for e in np.eye(len(values))
    ]
    differences = np.diff(ends).ravel() / (-2 * step)
    assert np.abs(gradient - differences).max() < 1e-5 * np.abs(gradient).max()


def test_corrections_never_pay_for_going_far(robot, estimate):
    """A correction that grew with the distance would take the cost below zero."""
    problem = frf_problem(robot, estimate, "lls", "user", BOUNDS)
    network, shift = network_and_shift(problem, far(robot))
    plain, model = CorrectedModel(problem, network, None), CorrectedModel(problem, network, shift)
    most = np.abs(model.shift).sum()
    assert most > 0
    for reach in (0.1, 1.0, 5.0):
        values = model.centre * np.exp(-reach * np.sign(model.shift))
        correction = model.gradient(values)[0] - plain.gradient(values)[0]
        assert -most <= correction < 0


@pytest.mark.parametrize("residual", ["nls", "lls"])
def test_bfgs_ends_where_gauss_newton_does_and_renews_equilibria(robot, estimate, residual):
    problem = frf_problem(robot, estimate, residual, "user", BOUNDS)
    start = far(robot, decades=0.05)
    network = robot.network(estimate.positions, start)
    ends = [
        frozen_search(problem, start, network, 1000, 1e-12, MINIMISERS[name])
        for name in ("trust_region", "quasi_newton")
    ]
    assert np.isclose(ends[0].cost, ends[1].cost, rtol=1e-6)
    assert stands(problem, ends[1])


@pytest.mark.parametrize(
    ("residual", "weights"), [("nls", "optimal"), ("lls", "user"), ("lls_magnitude", "combined")]
)
def test_the_exact_search_finds_nothing_better(robot, estimate, residual, weights):
    problem = frf_problem(robot, estimate, residual, weights, BOUNDS, None, known(robot))
    fast = frozen(problem, far(robot, decades=0.15), 200, 1e-12)
    assert fast.status > 0
    slow = exact_search(problem, fast.values, 4, 1e-12)
    assert np.isclose(slow.cost, fast.cost, rtol=1e-9)
    assert stands(problem, fast)


def stands(problem, found):
    """Tell whether a step of Gauss and Newton, derivatives exact, is small beside the noise."""
    f, slope = problem.evaluate(found.values)
    free = (found.values > 1.001 * problem.bounds[0]) & (found.values < 0.999 * problem.bounds[1])
    step = np.linalg.lstsq(slope[:, free], f)[0]
    return np.linalg.norm(slope[:, free] @ step) < 1e-2 * np.sqrt(found.cost / len(f))


def test_a_point_beside_the_minimum_does_not_stand(robot, estimate):
    problem = frf_problem(robot, estimate, "lls", "user", BOUNDS)
    fast = frozen(problem, robot.parameters.values)
    assert stands(problem, fast)
    assert not stands(problem, replace(fast, values=fast.values * 1.001))


def test_shifts_of_equilibria_carry_to_a_point_nearby(robot, estimate):
    problem = frf_problem(robot, estimate, "lls", "user", BOUNDS)
    values = robot.parameters.values
    near = values * np.exp(0.03 * np.random.default_rng(3).uniform(-1, 1, len(values)))
    _, equilibrium_shift = network_and_shift(problem, values)
    network, exact = network_and_shift(problem, near)
    assert equilibrium_shift.near(near)
    kernel = CorrectedModel(problem, network, None).kernel
    expected = exact.gradient(network, kernel)
    apart = (
        np.abs(equilibrium_shift.gradient(network, kernel) - expected).max()
        / np.abs(expected).max()
    )
    assert apart < 2e-3  # of equilibria's part of the gradient
    stiff, damped = (np.array([end in n for n in robot.parameters.names]) for end in (".st", ".da"))
    assert not equilibrium_shift.near(np.where(stiff, 1.2, 1.0) * values)
    assert equilibrium_shift.near(np.where(damped, 9.0, 1.0) * values)  # dampers shift nothing


def test_large_problems_of_springs_are_compiled(robot, estimate):
    rng = np.random.default_rng(1)
    omega = 2 * np.pi * np.geomspace(3.0, 60.0, 30)
    large = simulate_frf(robot, estimate.positions, omega, RelativeNoise(0.03, 0.01), rng)
    network = robot.network(large.positions)
    assert not hardens(network)
    problem = frf_problem(robot, large, "nls", "optimal", BOUNDS)
    assert can_compile(problem, network)
    assert not can_compile(frf_problem(robot, estimate, "nls", "optimal", BOUNDS), network)
    assert not can_compile(
        frf_problem(robot, large, "nls", "optimal", BOUNDS, loss="huber"), network
    )
    full = np.broadcast_to(np.eye(36) + 0j, (3, 30, 36, 36))
    assert not can_compile(frf_problem(robot, large, "nls", full, BOUNDS), network)
    fast = fit(robot, large, "nls", "optimal", 1.1 * robot.parameters.values)
    assert fast.converged
    slow = exact_search(problem, fast.parameters.values, 10, 1e-12)
    assert np.isclose(fast.cost, slow.cost, rtol=1e-9)


def test_far_searches_begin_with_every_eighth_line(robot, estimate):
    rng = np.random.default_rng(2)
    omega = 2 * np.pi * np.geomspace(3.0, 60.0, 121)
    dense = simulate_frf(robot, estimate.positions, omega, RelativeNoise(0.03, 0.01), rng)
    priors = known(robot)
    problem = frf_problem(robot, dense, "lls", "optimal", BOUNDS, None, priors)
    rough = problem.rough
    assert np.array_equal(rough.omega, omega[::8])
    assert rough.rough is rough
    start = far(robot, decades=0.3)
    costs = [p.residuals(start)[0].ravel() for p in (problem, rough)]
    assert np.vdot(costs[1], costs[1]) == pytest.approx(np.vdot(costs[0], costs[0]), rel=0.1)

    lines = []

    def spying(problem, objective, *arguments):
        lines.append(len(objective.problem.omega))
        return damped_gauss_newton(problem, objective, *arguments)

    found = search(problem, start, 200, 1e-12, spying)
    assert lines[0] == 16
    assert set(lines[1:]) == {121}
    assert stands(problem, found)
    exact = exact_search(problem, found.values, 10, 1e-12)
    assert found.cost == pytest.approx(exact.cost, rel=1e-9)
    lines.clear()
    search(problem, found.values, 200, 1e-12, spying)  # a start nearby needs no rough search
    assert set(lines) == {121}


@pytest.mark.parametrize(
    ("residual", "weights"),
    [("nls", "optimal"), pytest.param("lls", "user", marks=pytest.mark.slow)],
)
def test_hardening_gears_are_searched_with_equilibria_found_anew(residual, weights, monkeypatch):
    robot = load_robot("manutec_r3_hardening")
    rng = np.random.default_rng(0)
    low, high = robot.position_limits.T
    positions = low + (high - low) * rng.uniform(0.2, 0.8, (2, len(low)))
    frfs = simulate_frf(robot, positions, OMEGA, RelativeNoise(), rng)
    assert hardens(robot.network(positions))
    problem = frf_problem(robot, frfs, residual, weights, BOUNDS, None, None)
    start = far(robot, decades=0.05)
    monkeypatch.setattr("estimators.fitting.fixed_equilibrium_search.WORTHWHILE", 0)
    fast = search(problem, start, 200, 1e-12)
    assert fast.status > 0
    assert stands(problem, fast)


def test_bounds_hold_and_are_told(robot, estimate):
    bounds = np.outer([0.1, 10.0], robot.parameters.values)
    bounds[:, 0] = robot.parameters.values[0] * np.array([1.3, 10.0])
    problem = frf_problem(robot, estimate, "nls", "optimal", bounds)
    found = frozen(problem, robot.parameters.values * 1.5)
    name = robot.parameters.names[0]
    assert found.values[0] >= bounds[0, 0]
    assert f"at a bound: {name}" in found.message


def test_running_out_of_evaluations_is_told(robot, estimate):
    problem = frf_problem(robot, estimate, "nls", "optimal", BOUNDS)
    for limit in (2, 3, 7):
        found = frozen(problem, far(robot), limit)
        assert found.status == 0
        assert found.evaluations <= limit


class Misleading:
    """Springs whose equilibria shift with the first one, though it does not say so."""

    parameters = MODEL.parameters

    def __init__(self):
        self.visited = []

    def network(self, positions, parameters=None):
        values = self.parameters.check(parameters)
        self.visited.append(values)
        network = MODEL.network(positions, values)
        away = np.log(values[0] / self.parameters.values[0])
        shift = 300 * np.sin(30 * away) * np.diag([0, 0, 1, 1])
        return replace(network, stiffness=network.stiffness + shift)


@pytest.mark.parametrize("evaluations", [10, 20, 30, 200])
@pytest.mark.parametrize("seed", range(6))
def test_no_point_on_the_way_is_better_than_the_end(seed, evaluations):
    """Where equilibria are frozen, a step may lose when they are found anew."""
    model = Misleading()
    problem = frf_problem(model, noisy(), "nls", "optimal", BOUNDS)
    end = frozen(problem, far(MODEL, seed, 0.2), evaluations)
    costs = []
    for values in (end.values, *model.visited.copy()):
        residuals, _ = problem.evaluate(values)
        costs.append(residuals @ residuals)
    # The cost is the one about its own equilibria, not those of a point before.
    assert end.cost == pytest.approx(costs[0], rel=1e-6)
    assert costs[0] <= min(costs) * (1 + 1e-6)


class Weak:
    """A robot that has no equilibrium where its first spring is weaker than `weakest`."""

    def __init__(self, robot, weakest):
        self.robot, self.weakest = robot, weakest
        self.parameters, self.refused = robot.parameters, 0

    def network(self, positions, parameters=None):
        from robotmodels import NoEquilibrium

        if parameters is not None and parameters[0] < self.weakest:
            self.refused += 1
            raise NoEquilibrium("gives way")
        return self.robot.network(positions, parameters)

    def tangents(self, positions, parameters=None, *, equilibrium_shift=True):
        return self.robot.tangents(positions, parameters, equilibrium_shift=equilibrium_shift)


def test_where_there_is_no_equilibrium_the_way_is_halved(robot, estimate):
    truth = robot.parameters.values
    # The optimum lies beyond what the robot can bear.
    weak = Weak(robot, 1.2 * truth[0])
    problem = frf_problem(weak, estimate, "nls", "optimal", BOUNDS)
    found = frozen(problem, 2.0 * truth)
    assert weak.refused
    assert 1.2 <= found.values[0] / truth[0] < 1.3


def test_numbers_that_are_not_finite_are_refused(robot, estimate, monkeypatch):
    problem = frf_problem(robot, estimate, "nls", "optimal", BOUNDS)
    values = robot.parameters.values
    model = CorrectedModel(problem, robot.network(estimate.positions), None)
    broken = NormalEquations(np.nan, np.zeros(len(values)), np.eye(len(values)))
    monkeypatch.setattr(model.kernel, "normal_equations", lambda _: broken)
    with pytest.raises(SolverFailed, match="not finite"):
        model.normal_equations(values)


def test_models_that_do_not_sag_need_no_correction(monkeypatch):
    monkeypatch.setattr("estimators.fitting.fixed_equilibrium_search.WORTHWHILE", 0)
    start = 1.3 * MODEL.parameters.values
    fast = fit(MODEL, noisy(), "nls", "optimal", start=start)
    monkeypatch.undo()
    slow = fit(MODEL, noisy(), "nls", "optimal", start=start)
    assert np.isclose(fast.cost, slow.cost, rtol=1e-10)
    assert np.allclose(fast.parameters.values, slow.parameters.values, rtol=1e-5)


def test_priors_are_checked(robot):
    for arguments, message in (
        ((("g1",), np.ones(1), np.zeros(1)), r"prior\.std: 0 for g1"),
        ((("g1",), np.ones(2), np.ones(1)), r"prior\.values: shape \(2,\)"),
        (((), np.ones(0), np.ones(0)), "one or more different"),
        ((("g1", "g1"), np.ones(2), np.ones(2)), "one or more different"),
    ):
        with pytest.raises(InvalidInput, match=message):
            Prior(*arguments)
    with pytest.raises(InvalidInput, match="prior: 'k9' is not a free parameter"):
        fit(MODEL, noisy(), prior=Prior(("k9",), np.ones(1), np.ones(1)))
