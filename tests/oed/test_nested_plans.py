import numpy as np

import oed
from oed.exact.nested_plans import nested_plans


def test_the_visit_that_tells_least_comes_last():
    rows = np.diag([3.0, 2.0, 1.0])
    information = np.array([np.outer(v, v) for v in [*rows, 0.1 * rows[0]]])
    plans = nested_plans(information, np.array([1, 1, 2, 1]))
    assert plans.order[-1] == 3
    assert sorted(plans.order.tolist()) == [0, 1, 2, 2, 3]
    expected = [1 / np.sqrt(9.09), 1 / 2, 1 / np.sqrt(2)]
    np.testing.assert_allclose(plans.std[-1], expected, rtol=1e-9)
    assert np.isinf(plans.std[1]).sum() == 1
    assert (np.diff(np.where(np.isinf(plans.std), 1e9, plans.std), axis=0) <= 1e-12).all()


def test_each_step_takes_off_the_best_visit_by_brute_force():
    rng = np.random.default_rng(4)
    information = np.array([a.T @ a for a in rng.standard_normal((6, 2, 3))])
    counts = np.array([2, 1, 1, 1, 1, 1])
    order = nested_plans(information, counts).order.tolist()
    for visit in reversed(order[3:]):
        remaining = {
            q: np.linalg.det(np.tensordot(counts - np.eye(6)[q], information, 1))
            for q in np.flatnonzero(counts)
        }
        assert remaining[visit] == max(remaining.values())
        counts[visit] -= 1


def test_the_efficiency_of_the_whole_plan_is_the_exact_designs():
    rng = np.random.default_rng(7)
    factors = rng.standard_normal((30, 2, 3))
    matrices = np.swapaxes(factors, 1, 2) @ factors
    info = oed.InformationSet(rng.standard_normal((30, 2)), matrices, ("a", "b", "c"))
    design = oed.optimal_design(info)
    exact = oed.exact_design(info, 8, design=design)
    used = np.flatnonzero(exact.repetitions)
    plans = nested_plans(np.asarray(info.matrices)[used], exact.repetitions[used])
    efficiency = plans.efficiency(design)
    np.testing.assert_allclose(efficiency[-1], exact.efficiency, rtol=1e-9)
    assert np.isnan(efficiency[0])  # two rows for three parameters
    assert (efficiency[1:] <= 1).all()
