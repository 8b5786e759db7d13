from itertools import combinations_with_replacement, product

import numpy as np
import pytest
from random_candidates import information_set, quadratic_regression, random_set

from oed import (
    AverageCriterion,
    CCriterion,
    Constraints,
    DsCriterion,
    Group,
    InformationSamples,
    exact_design,
    optimal_design,
)
from oed.criteria.criteria import objective_of
from oed.exact.gain_bounds import log_values
from oed.information_sets.stored_information import write_store
from robotmodels import InvalidInput, NotIdentifiable

CRITERIA = {
    "D": "D",
    "A": "A",
    "E": "E",
    "c": CCriterion(np.array([1.0, -0.5, 2.0])),
    "D_s": DsCriterion(("k0", "k2")),
}


def every_plan(n_candidates, n_experiments):
    for plan in combinations_with_replacement(range(n_candidates), n_experiments):
        yield np.bincount(plan, minlength=n_candidates)


def log_value(info, criterion, counts, prior=0.0):
    total = np.tensordot(counts, info.matrices, axes=1) + prior
    return objective_of(criterion, info.names).log_value(total)


@pytest.mark.parametrize("name", CRITERIA)
def test_against_every_plan(name):
    criterion, hits = CRITERIA[name], 0
    for seed in range(3):
        info = random_set(seed, 6, 3, 2)
        exact = exact_design(info, 4, criterion=criterion)
        best = max(log_value(info, criterion, counts) for counts in every_plan(6, 4))
        found = log_value(info, criterion, exact.repetitions)
        assert found <= best + 1e-9
        assert exact.efficiency <= np.exp(found - best) + 1e-9
        hits += found > best - 1e-6
    assert hits >= 2


def test_prior_information_changes_the_plan():
    """Quadratic regression with much known at -1 and 0 needs the other end only."""
    info = quadratic_regression(np.linspace(-1, 1, 5))
    prior = 50 * (info.matrices[0] + info.matrices[2])
    exact = exact_design(info, 4, prior=prior)
    best = max(every_plan(5, 4), key=lambda counts: log_value(info, "D", counts, prior))
    np.testing.assert_array_equal(exact.repetitions, best)
    assert exact.repetitions[4] == 4
    np.testing.assert_allclose(exact.information, prior + 4 * info.matrices[4])


def test_a_design_of_another_criterion_needs_it_named():
    info = random_set(1, 8, 3, 2)
    design = optimal_design(info, CRITERIA["c"])
    with pytest.raises(InvalidInput, match="design: it is for criterion c; give the same one"):
        exact_design(info, 5, design)
    exact = exact_design(info, 5, design, criterion=CRITERIA["c"])
    assert exact.criterion == "c"
    assert exact.efficiency > 0.5


N = 5
EVERY = np.array([c for c in product(range(N + 1), repeat=6) if 2 < sum(c) <= N])
CONSTRAINTS = {
    "most": Constraints(most=1.0),
    "mandatory": Constraints(mandatory={0: 2, 3: 1}),
    "forbidden": Constraints(forbidden=[1, 4]),
    "groups": Constraints(groups={"left": Group([0, 1, 2], most=1), "last": Group([5], least=2)}),
    "time": Constraints(time=16.0, durations=[3.0, 5.0, 4.0, 7.0, 6.0, 3.0]),
    "linear": Constraints(linear={"own": ([1.0, 0, 2.0, 0, 0, 1.0], 3.0)}),
}


@pytest.mark.parametrize("name", CONSTRAINTS)
def test_within_constraints_against_every_plan(name):
    """Exchanges end in a local optimum: mostly the best plan, never one that is not allowed."""
    constraints, ratios = CONSTRAINTS[name], []
    for seed in range(2):
        info = random_set(seed, 6, 3, 2)
        exact = exact_design(info, N, constraints=constraints)
        counted = Constraints(**{**vars(constraints), "experiments": None if name == "time" else N})
        allowed = counted.polytope(6)
        assert allowed.violation(exact.repetitions.astype(float)) < 1e-9
        best = max(
            log_value(info, "D", c) for c in EVERY if allowed.violation(c.astype(float)) < 1e-9
        )
        ratios.append(np.exp(log_value(info, "D", exact.repetitions) - best))
        assert exact.efficiency <= ratios[-1] + 1e-9
    assert min(ratios) > 0.9
    assert max(ratios) == pytest.approx(1.0, abs=1e-6)


def test_no_whole_plan_satisfies_the_constraints():
    info = random_set(0, 6, 3, 2)
    halves = Constraints(experiments=4, groups={"few": Group([0, 1], most=0.5, least=0.5)})
    with pytest.raises(InvalidInput, match=r"no plan of whole experiments .* groups: few"):
        exact_design(info, constraints=halves)


def test_samples_of_theta():
    sets = [random_set(seed, 6, 3, 2) for seed in (1, 2)]
    samples = InformationSamples(tuple(sets))
    exact = exact_design(samples, 4, criterion=AverageCriterion())
    best = max(every_plan(6, 4), key=lambda c: sum(log_value(info, "D", c) for info in sets))
    np.testing.assert_array_equal(exact.repetitions, best)
    assert exact.information.shape == (2, 3, 3)


def test_exchange_looks_beyond_its_first_pool():
    """The best plan of few experiments uses candidates that the relaxed design does not favour."""
    info = random_set(5, 3000, 4, 2)
    exact = exact_design(info, 3)
    for leaving in exact.support:
        rest = exact.information - info.matrices[leaving]
        best = np.linalg.slogdet(rest + info.matrices).logabsdet.max()
        assert best <= np.linalg.slogdet(exact.information).logabsdet + 1e-7


def test_few_experiments_for_a_criterion_that_asks_for_little():
    info = information_set([np.diag([1.0, 0.0]), np.diag([0.0, 1.0])])
    exact = exact_design(info, 1, criterion=DsCriterion(("k1",)))
    np.testing.assert_array_equal(exact.repetitions, [0, 1])
    with pytest.raises(NotIdentifiable, match=r"k[01]; 1 experiment is too few"):
        exact_design(info_of_two(), 1)


def info_of_two():
    return information_set([np.diag([1.0, 0.0]), np.diag([0.0, 2.0])])


@pytest.mark.parametrize("name", CRITERIA)
def test_many_values_at_a_time_are_those_of_one(name):
    info = random_set(8, 5, 3, 3)
    wanted = objective_of(CRITERIA[name], info.names)
    one_by_one = [wanted.log_value(matrix) for matrix in info.matrices]
    np.testing.assert_allclose(log_values(wanted, info.matrices), one_by_one, rtol=1e-9)
    open_one = info.matrices.copy()
    open_one[2, 0] = open_one[2, :, 0] = 0.0
    one_by_one = [wanted.log_value(matrix) for matrix in open_one]
    np.testing.assert_allclose(log_values(wanted, open_one), one_by_one, rtol=1e-9)


def test_candidates_in_a_store(tmp_path):
    info = random_set(6, 400, 4, 3)
    store = write_store(tmp_path / "a.store", info.positions, info.names, [info.matrices])
    for name in ("D", "A"):
        stored, held = (exact_design(one, 7, criterion=name) for one in (store, info))
        np.testing.assert_array_equal(stored.repetitions, held.repetitions)
        assert stored.efficiency == pytest.approx(held.efficiency, abs=1e-5)
