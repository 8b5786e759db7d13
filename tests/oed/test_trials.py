"""Plans beside alternatives in simulated experiments, against closed forms and brute force."""

from dataclasses import replace

import numpy as np
import pytest
from two_axes import TwoAxes

import oed
from estimators import MonteCarlo
from oed.criteria.criteria import objective_of
from oed.plan_comparison.plan_comparison import (
    SimulatedPlan,
    clearly_smaller,
    ratio_interval,
    std_interval,
)
from robotmodels import InvalidInput, NotIdentifiable, RelativeNoise, SolverFailed, load_robot
from robotmodels.linear.derived_models import FixedEquilibriumModel, with_fixed_equilibria
from robotmodels.linear.response import frequency_response

OMEGA = 2 * np.pi * np.geomspace(3.0, 30.0, 8)
NOISE = RelativeNoise(0.03, 0.01)
GRID = np.stack(np.meshgrid(np.linspace(-1, 1, 3), np.linspace(-2, 2, 9)), -1).reshape(-1, 2)


def test_random_plans_use_each_candidate_once_where_there_are_enough():
    rng = np.random.default_rng(1)
    plan = oed.random_plan(20, 15, rng)
    assert sorted(plan) == [0] * 5 + [1] * 15
    assert not np.array_equal(plan, oed.random_plan(20, 15, rng))
    assert sorted(oed.random_plan(4, 10, rng)) == [2, 2, 3, 3]


def test_even_plans_start_in_the_middle_and_go_farthest_from_all_before():
    plan = oed.even_plan(GRID, 5)
    chosen = GRID[plan > 0]
    # The middle, then the corners: by brute force no four others are as far apart.
    assert {tuple(p) for p in chosen} == {(0, 0), (-1, -2), (-1, 2), (1, -2), (1, 2)}
    assert oed.even_plan(GRID[:2], 5).tolist() == [3, 2]
    # Ranges count, not units.
    assert np.array_equal(oed.even_plan(GRID * [1.0, 100.0], 7), oed.even_plan(GRID, 7))


def test_even_plans_leave_a_joint_of_one_angle_alone():
    line = np.column_stack([np.full(5, 0.3), np.linspace(0, 1, 5)])
    assert np.flatnonzero(oed.even_plan(line, 3)).tolist() == [0, 2, 4]


def test_a_grid_by_hand_takes_the_nearest_candidates_and_repeats_in_order():
    plan = oed.grid_plan(GRID, 5, {"b": 3}, ("a", "b"))
    used = {tuple(GRID[i]): int(plan[i]) for i in np.flatnonzero(plan)}
    assert used == {(0.0, -2.0): 2, (0.0, 0.0): 2, (0.0, 2.0): 1}


@pytest.mark.parametrize(
    ("grid", "words"),
    [
        ({"c": 2}, "'c' is not a driven joint"),
        ({"a": 0}, "0 points of 'a'"),
        ({"a": 3, "b": 2}, "6 points for 5 experiments"),
    ],
)
def test_grids_that_do_not_fit(grid, words):
    with pytest.raises(InvalidInput, match=words):
        oed.grid_plan(GRID, 5, grid, ("a", "b"))


def test_plans_of_nothing():
    with pytest.raises(InvalidInput, match="0 experiments in 3 candidates"):
        oed.random_plan(3, 0, np.random.default_rng(0))
    with pytest.raises(InvalidInput, match="at least one of each"):
        oed.even_plan(np.zeros((0, 2)), 3)


def test_held_equilibria_give_the_networks_own_responses_at_other_values():
    robot, positions = load_robot("manutec_r3"), np.array([[0.1, 0.4, -0.9, 0.2, 0.5, 0.0]])
    found = with_fixed_equilibria(robot, positions)
    assert isinstance(found, FixedEquilibriumModel)
    own = frequency_response(robot, positions, OMEGA)
    np.testing.assert_array_equal(frequency_response(found, positions, OMEGA), own)
    values = robot.parameters.values * np.linspace(0.8, 1.3, len(robot.parameters))
    expected = robot.network(positions).frequency_response(OMEGA, values)
    response = frequency_response(found, positions, OMEGA, values)
    np.testing.assert_allclose(response, expected, rtol=1e-10)
    # Its gears harden: their slopes follow the load.
    hardening = load_robot("manutec_r3_hardening")
    assert with_fixed_equilibria(hardening, positions) is hardening


def scattered(covariance, n, rng):
    """Return n normal estimates as repeated experiments."""
    names = tuple("abc"[: len(covariance)])
    estimates = rng.multivariate_normal(np.zeros(len(covariance)), covariance, n)
    empty = np.zeros((n, 0, len(names)))
    return MonteCarlo(
        names, np.ones(len(names)), (), 0.95, estimates, empty, empty[..., None], np.ones(n), ()
    )


SHAPE = np.array([[1.0, 0.6, 0.0], [0.6, 2.0, -0.3], [0.0, -0.3, 0.5]])


def coverage(criterion, n, seed):
    """Return how often intervals of an efficiency hold it, and how often a third of each does."""
    rng, wanted = np.random.default_rng(seed), objective_of(criterion, "abc")
    truth = wanted.efficiency(np.linalg.inv(1.5 * SHAPE), np.linalg.inv(SHAPE))
    assert truth == pytest.approx(2 / 3)
    inside = np.zeros((n, 2))
    for k in range(n):
        pair = scattered(1.5 * SHAPE, 25, rng), scattered(SHAPE, 25, rng)
        value, low, high = ratio_interval(wanted, *pair, 0.95)
        apart = np.log([low / value, truth / value, high / value])
        inside[k] = [apart[0] <= apart[1] / part <= apart[2] for part in (1, 1 / 3)]
    return inside.mean(axis=0)


def test_intervals_of_efficiencies_hold_the_truth(monkeypatch):
    monkeypatch.setattr("oed.plan_comparison.plan_comparison.DRAWS", 100)
    whole, third = coverage("D", 10, 4)
    assert whole >= 0.8
    assert third <= 0.6


@pytest.mark.slow
@pytest.mark.parametrize("criterion", ["D", "A"])
def test_intervals_of_efficiencies_hold_the_truth_as_often_as_they_say(criterion):
    # Exact for D; variances are more skewed than the logarithm of a determinant.
    whole, third = coverage(criterion, 200, 5)
    assert 0.88 < whole < 0.985
    assert third < 0.65


def test_intervals_of_standard_deviations_are_those_of_chi_square():
    # 10 degrees of freedom, 95 %: 20.483 and 3.247.
    ends = std_interval(np.array([2.0]), 11, 0.95)
    assert ends == pytest.approx(2 * np.sqrt([[10 / 20.483, 10 / 3.247]]), rel=1e-4)


def test_what_is_clearly_smaller_is_so_in_one_case_of_twenty_by_chance():
    rng = np.random.default_rng(2)
    wrong = [
        clearly_smaller(scattered(SHAPE, 20, rng), scattered(SHAPE, 20, rng), 0.95)
        for _ in range(200)
    ]
    assert 0.02 < np.mean(wrong) < 0.09
    assert clearly_smaller(scattered(SHAPE, 40, rng), scattered(9 * SHAPE, 40, rng), 0.95).all()


@pytest.fixture(scope="module")
def axes():
    info = oed.information(TwoAxes(), GRID, OMEGA, NOISE)
    best = oed.exact_design(info, n_experiments=4)
    return info, best.repetitions


def compared(info, plans, **options):
    rng = np.random.default_rng(6)
    return oed.compare_plans(TwoAxes(), info, GRID, plans, OMEGA, NOISE, rng=rng, **options)


def test_scatter_is_what_theorem_1_promises_and_the_better_plan_wins(axes):
    info, best = axes
    once = np.zeros(len(GRID), dtype=int)
    once[np.argmin(info.directional_derivatives(np.linalg.inv(info.total)))] = 1
    told = []
    found = compared(
        info,
        {"best": best, "one": once, "twin": best, "ninefold": 9 * best},
        runs=30,
        progress=lambda done, of: told.append((done, of)),
    )
    assert found.worse == ("one",)
    assert found.better == ("ninefold",)
    assert found.predicted[2:].tolist() == pytest.approx([1.0, 9.0])
    assert told[-1] == (120, 120)
    for trial in found.plans:
        ends = trial.std_interval()
        # Two parameters of four plans: one of them outside would be chance.
        assert (
            (0.85 * ends[:, 0] < trial.predicted.std) & (trial.predicted.std < 1.2 * ends[:, 1])
        ).all()
    assert found.more_certain(1)[1] == 2
    assert found.more_certain(3) == (0, 0, 2)
    assert "best better than 1 of 3 alternatives by D, worse than ninefold, " in str(found)
    assert found.fixed_equilibria


def test_an_alternative_that_leaves_parameters_open_is_worth_nothing():
    H = np.array([np.diag([4.0, 0.0]), np.diag([1.0, 1.0])])
    info = oed.InformationSet(np.array([[0.1, 0.2], [0.3, 0.4]]), 1e4 * H, ("k1", "k2"))
    plans = {"both": np.array([0, 2]), "blind": np.array([2, 0])}
    rng = np.random.default_rng(1)
    found = oed.compare_plans(TwoAxes(), info, info.positions, plans, OMEGA, NOISE, rng=rng, runs=6)
    blind = found.plans[1]
    assert blind.unidentified == ("k2",)
    assert found.worse == ("blind",)
    assert found.more_certain(1) == (2, 2, 0)
    assert isinstance(blind, oed.UnidentifiedPlan)
    assert "blind        does not identify k2" in str(found)
    plans = {"blind": plans["blind"]}
    with pytest.raises(NotIdentifiable, match="k2; blind: measure elsewhere"):
        oed.compare_plans(TwoAxes(), info, info.positions, plans, OMEGA, NOISE, rng=rng, runs=6)


def test_comparisons_that_cannot_be_made(axes):
    info, best = axes
    with pytest.raises(InvalidInput, match="runs: 4; at least 5 are needed for 2 parameters"):
        compared(info, {"best": best}, runs=4)
    with pytest.raises(InvalidInput, match="plan 'empty'"):
        compared(info, {"best": best, "empty": 0 * best}, runs=5)


def test_a_plan_whose_experiments_cannot_be_fitted_is_named(axes, monkeypatch):
    info, best = axes
    few = scattered(SHAPE[:2, :2], 4, np.random.default_rng(3))
    few = replace(few, failures=("no equilibrium",))
    monkeypatch.setattr(
        "oed.plan_comparison.compare_plans.monte_carlo", lambda *args, **options: few
    )
    with pytest.raises(SolverFailed, match=r"plan 'best': 4 of 9 .* 5 are needed; no equilibrium"):
        compared(info, {"best": best}, runs=9)


def test_an_interrupted_comparison_goes_on_and_ends_alike(axes, tmp_path):
    info, best = axes
    plans = {"best": best, "even": oed.even_plan(GRID, 4)}
    whole = compared(info, plans, runs=6)

    def interrupt(done, of):
        if done == 12:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        compared(info, plans, runs=6, store=tmp_path, progress=interrupt)
    assert {p.name for p in tmp_path.iterdir()} == {"plan_00.h5", "plan_01.h5"}
    again = compared(info, plans, runs=6, store=tmp_path)
    for one, other in zip(whole.plans, again.plans, strict=True):
        np.testing.assert_array_equal(one.simulation.estimates, other.simulation.estimates)
    assert isinstance(again.plans[0], SimulatedPlan)
