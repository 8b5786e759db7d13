from itertools import combinations_with_replacement

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from random_candidates import quadratic_regression, random_set

from oed import Constraints, Group, best_plans
from oed.criteria.criteria import objective_of
from robotmodels import InvalidInput


def values_of_all(info, n_experiments, criterion="D", allowed=lambda counts: True):
    """Return the log values of all plans, largest first."""
    wanted, n = objective_of(criterion, info.names), len(info)
    values = []
    for plan in combinations_with_replacement(range(n), n_experiments):
        counts = np.bincount(plan, minlength=n)
        if allowed(counts):
            values.append(wanted.log_value(np.tensordot(counts, info.matrices, axes=1)))
    return sorted(values, reverse=True)


@settings(max_examples=5, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    p=st.integers(2, 3),
    n_candidates=st.integers(4, 7),
    n_experiments=st.integers(3, 5),
    criterion=st.sampled_from(["D", "A"]),
)
def test_the_best_three_plans(seed, p, n_candidates, n_experiments, criterion):
    info = random_set(seed, n_candidates, p, 2)
    best = best_plans(info, n_experiments, 3, criterion=criterion)
    wanted = objective_of(criterion, info.names)
    found = [wanted.log_value(plan.information) for plan in best.plans]
    expected = values_of_all(info, n_experiments, criterion)[:3]
    np.testing.assert_allclose(found, expected, atol=1e-6)
    assert best.proven
    assert best.efficiency == 1.0
    assert len({plan.repetitions.tobytes() for plan in best.plans}) == 3
    ratios = np.exp(np.array(found) - found[0])
    np.testing.assert_allclose([plan.efficiency for plan in best.plans], ratios, atol=1e-6)


def test_within_constraints():
    info = random_set(3, 6, 3, 2)
    constraints = Constraints(most=2, groups={"ends": Group([0, 5], most=1)})
    best = best_plans(info, 4, 2, constraints=constraints)

    def allowed(counts):
        return counts.max() <= 2 and counts[0] + counts[5] <= 1

    expected = values_of_all(info, 4, allowed=allowed)[:2]
    wanted = objective_of("D", info.names)
    found = [wanted.log_value(plan.information) for plan in best.plans]
    np.testing.assert_allclose(found, expected, atol=1e-6)
    assert best.proven


def test_the_first_bound_leaves_few_candidates():
    info = random_set(2, 400, 4, 3)
    best = best_plans(info, 12, max_nodes=400)
    assert best.considered < len(info) // 2
    assert best.proven


def test_without_enough_nodes_it_says_so():
    info = random_set(2, 60, 5, 2)
    seen = []
    best = best_plans(info, 6, max_nodes=2, progress=lambda done, total: seen.append((done, total)))
    assert not best.proven
    assert best.nodes == 2
    assert best.efficiency < 1.0
    assert seen == [(1, 2), (2, 2)]
    proof = best_plans(info, 6, max_nodes=2000)
    assert proof.proven
    wanted = objective_of("D", info.names)
    values = [wanted.log_value(b.plans[0].information) for b in (best, proof)]
    assert best.efficiency <= np.exp(values[0] - values[1]) + 1e-9


def test_fewer_plans_than_asked_for():
    info = quadratic_regression(np.array([-1.0, 0.0, 1.0]))
    best = best_plans(info, 3, 50)
    assert best.proven
    assert len(best.plans) == 1  # any other plan of three leaves a parameter open


def test_number_of_plans():
    with pytest.raises(InvalidInput, match="plans: 0; at least one is needed"):
        best_plans(quadratic_regression(np.linspace(-1, 1, 5)), 4, 0)
