from dataclasses import replace
from itertools import combinations_with_replacement

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from random_candidates import information_set, quadratic_regression, random_set

from oed import (
    Constraints,
    best_plans,
    exact_design,
    experiments_needed,
    next_experiments,
    optimal_design,
)
from oed.exact.exact_design import efficient_rounding
from robotmodels import InvalidInput, NotIdentifiable


def log_det(matrix):
    return np.linalg.slogdet(matrix).logabsdet


def best_of_all(matrices, n_experiments):
    """Return the largest log det per experiment over every plan."""
    plans = combinations_with_replacement(range(len(matrices)), n_experiments)
    return max(log_det(matrices[list(plan)].sum(axis=0) / n_experiments) for plan in plans)


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    p=st.integers(2, 3),
    n_candidates=st.integers(4, 6),
    n_experiments=st.integers(3, 5),
    rank=st.integers(1, 3),
)
def test_exact_design_against_every_plan(seed, p, n_candidates, n_experiments, rank):
    info = random_set(seed, n_candidates, p, rank)
    design = optimal_design(info, solver="newton")
    exact = exact_design(info, n_experiments, design)
    best = best_of_all(info.matrices, n_experiments)
    assert exact.n_experiments == exact.repetitions.sum() == n_experiments
    assert exact.value <= best + 1e-9
    # Exchanges of one experiment end in a local optimum, on so few candidates a very good one.
    assert exact.value >= best - p * 0.02
    true_efficiency = np.exp((exact.value - design.value) / p)
    assert true_efficiency * (1 - 2e-6) <= exact.efficiency <= true_efficiency * (1 + 1e-9)


def test_exact_design_is_the_best_of_all_plans_most_of_the_time():
    hits = 0
    for seed in range(20):
        info = random_set(seed, 8, 3, 2)
        hits += exact_design(info, 4, optimal_design(info, solver="newton")).value > (
            best_of_all(info.matrices, 4) - 1e-9
        )
    assert hits >= 12  # ties and local optima differ by rounding


def test_no_exchange_improves_the_plan():
    info = random_set(3, 300, 6, 4)
    exact = exact_design(info, 9, optimal_design(info, solver="newton"))
    for leaving in exact.support:
        rest = exact.information - info.matrices[leaving]
        assert log_det(rest + info.matrices).max() <= log_det(exact.information) + 1e-8


def test_quadratic_regression_in_six_experiments_is_the_relaxed_design():
    exact = exact_design(quadratic_regression(np.linspace(-1, 1, 21)), 6)
    assert exact.support.tolist() == [0, 10, 20]
    assert exact.repetitions[exact.support].tolist() == [2, 2, 2]
    assert exact.efficiency == pytest.approx(1.0, abs=2e-6)
    assert exact.value == pytest.approx(np.log(4 / 27))
    np.testing.assert_allclose(
        exact.information / 6, [[1, 0, 2 / 3], [0, 2 / 3, 0], [2 / 3, 0, 2 / 3]]
    )


def test_efficiency_is_certified_even_for_a_poor_relaxed_design():
    """Equal shares are no optimum; their gap must be counted, not believed away."""
    info = random_set(4, 50, 4, 3)
    good = optimal_design(info, solver="newton")
    poor = replace(good, weights=np.full(50, 1 / 50), gap=0.0)
    exact = exact_design(info, 60, poor)
    assert exact.efficiency <= np.exp((exact.value - good.value) / 4) * (1 + 1e-9)


def test_many_experiments_approach_the_relaxed_design():
    info = random_set(2, 100, 5, 3)
    design = optimal_design(info, solver="newton")
    efficiencies = [exact_design(info, n, design).efficiency for n in (5, 15, 100)]
    assert efficiencies == sorted(efficiencies)
    assert efficiencies[-1] > 0.999


@given(seed=st.integers(0, 10**6), size=st.integers(1, 8), spare=st.integers(0, 30))
def test_rounding_is_efficient(seed, size, spare):
    weights = np.random.default_rng(seed).dirichlet(np.ones(size))
    n = size + spare
    counts = efficient_rounding(weights, n)
    assert counts.sum() == n
    assert counts.min() >= 1
    # Pukelsheim and Rieder 1992: exactly the roundings with max (n_i - 1)/w_i <= min n_i/w_i.
    assert ((counts - 1) / weights).max() <= (counts / weights).min() * (1 + 1e-12)


def test_rounding_of_a_known_design():
    assert efficient_rounding(np.array([0.5, 0.0, 0.3, 0.2]), 7).tolist() == [3, 0, 2, 2]


def test_rounding_needs_one_experiment_per_position():
    with pytest.raises(InvalidInput, match=r"2 cannot be shared by 3 positions.*at least 3"):
        efficient_rounding(np.full(3, 1 / 3), 2)


def test_fewer_experiments_than_supported_positions():
    info = random_set(0, 200, 8, 6)
    design = optimal_design(info, solver="newton")
    assert len(design.support) > 4
    exact = exact_design(info, 4, design)
    assert exact.n_experiments == 4
    assert 0.3 < exact.efficiency < 1.0


def test_too_few_experiments_say_how_many_are_needed():
    info = quadratic_regression(np.linspace(-1, 1, 21))
    with pytest.raises(NotIdentifiable, match="2 experiments are too few, 3 are needed") as caught:
        exact_design(info, 2)
    # A parabola through both points, (x - a)(x - b), stays open: its leading coefficient is one.
    assert "k2" in caught.value.names
    assert 2 <= len(set(caught.value.names) & {"k0", "k1", "k2"}) == len(caught.value.names)
    assert exact_design(info, 3).repetitions.sum() == 3


def test_too_few_experiments_by_more_than_ranks():
    """Ranks ask for two experiments, but no two of these identify all four parameters."""
    pairs = [(0, 1), (0, 2), (0, 3)]
    info = information_set([np.diag(np.isin(range(4), pair).astype(float)) for pair in pairs])
    with pytest.raises(
        NotIdentifiable, match="1 experiment is too few, at least 2 are needed and 3 suffice"
    ):
        exact_design(info, 1)
    with pytest.raises(NotIdentifiable, match=r"k[123]; 2 experiments are too few, 3 suffice"):
        exact_design(info, 2)


def test_enough_experiments_kept_from_where_they_would_tell():
    info = information_set([np.diag([1.0, 0.0]), np.diag([0.0, 1.0]), np.diag([2.0, 0.0])])
    limits = Constraints(linear={"short": ([0.0, 1.0, 0.0], 0.5)})
    with pytest.raises(NotIdentifiable, match="k1; in other positions 2 experiments suffice"):
        exact_design(info, 4, constraints=limits)


@pytest.mark.parametrize("n_experiments", [0, -3, 2.5, True, "15"])
def test_number_of_experiments(n_experiments):
    with pytest.raises(InvalidInput, match=r"n_experiments: .*; a whole number >= 1 is needed"):
        exact_design(quadratic_regression(np.linspace(-1, 1, 5)), n_experiments)


@pytest.mark.parametrize("search", [exact_design, best_plans])
def test_numbers_that_contradict_are_refused(search):
    info = quadratic_regression(np.linspace(-1, 1, 5))
    five = Constraints(experiments=5)
    said = r"n_experiments: 7 contradicts the constraints, which say experiments=5; leave out one"
    with pytest.raises(InvalidInput, match=said):
        search(info, n_experiments=7, constraints=five)
    with pytest.raises(InvalidInput, match="n_experiments: 7 contradicts"):
        next_experiments(info, 7, np.eye(3), constraints=five)
    with pytest.raises(InvalidInput, match="n_experiments: 1 contradicts"):
        experiments_needed(info, 0.1, constraints=five)
    assert exact_design(info, n_experiments=5, constraints=five).n_experiments == 5
    assert exact_design(info, constraints=five).n_experiments == 5
    assert exact_design(info).n_experiments == 15
    # Beside a time a number is a limit too.
    hour = Constraints(time=3600, durations=10.0)
    assert exact_design(info, n_experiments=7, constraints=hour).n_experiments == 7
    assert exact_design(info, constraints=hour).n_experiments == 360


def test_a_design_of_other_candidates_or_a_singular_one():
    info = quadratic_regression(np.linspace(-1, 1, 5))
    design = optimal_design(info, solver="newton")
    with pytest.raises(InvalidInput, match="one weight for each of 3 candidates"):
        exact_design(quadratic_regression(np.linspace(-1, 1, 3)), 15, design)
    singular = replace(design, weights=np.array([0.5, 0.5, 0.0, 0.0, 0.0]))
    with pytest.raises(NotIdentifiable, match="the relaxed design is singular"):
        exact_design(info, 15, singular)
