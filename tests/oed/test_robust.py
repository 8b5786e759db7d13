from functools import cache

import cvxpy as cp
import numpy as np
import pytest
from random_candidates import information_set, random_set

import oed
from oed.criteria.criteria import objective_of
from robotmodels import InvalidInput

P, Q, K = 4, 60, 3


def sets(seed=0):
    """Information of the same candidates at K values of the parameters."""
    rng = np.random.default_rng(seed)
    base = rng.standard_normal((Q, P, 3))
    moved = [base + 0.6 * rng.standard_normal(base.shape) for _ in range(K)]
    return [information_set(J @ np.swapaxes(J, 1, 2)) for J in moved]


SETS = sets()


@cache
def best_by_cvxpy(kind):
    w = cp.Variable(Q, nonneg=True)
    log_dets = [
        cp.log_det(cp.reshape(one.matrices.reshape(Q, -1).T @ w, (P, P), order="C")) for one in SETS
    ]
    goal = sum(log_dets) / K if kind == "average" else cp.minimum(*log_dets)
    return cp.Problem(cp.Maximize(goal), [cp.sum(w) == 1]).solve(cp.CLARABEL)


@pytest.mark.parametrize("solver", ["newton", "cvxpy"])
@pytest.mark.parametrize("form", ["primal", "dual"])
def test_average_against_one_convex_problem(solver, form):
    best = best_by_cvxpy("average")
    design = oed.optimal_design(
        oed.InformationSamples(SETS), oed.AverageCriterion("D"), solver=solver, form=form
    )
    assert design.value * P == pytest.approx(best, abs=1e-5)
    assert design.gap <= 1e-6
    assert design.information.shape == (K, P, P)


def test_a_plain_criterion_is_averaged_over_samples():
    samples = oed.InformationSamples(SETS)
    for criterion in ("A", oed.DsCriterion(("k0", "k1"))):
        plain = oed.optimal_design(samples, criterion, solver="newton")
        stated = oed.optimal_design(samples, oed.AverageCriterion(criterion), solver="newton")
        np.testing.assert_allclose(plain.weights, stated.weights, atol=1e-7)
        assert plain.value == pytest.approx(stated.value, abs=1e-9)
    # It is not the design of the first sample.
    design, first = (oed.optimal_design(one, solver="newton") for one in (samples, SETS[0]))
    assert design.criterion == "D"
    assert oed.optimality_gap(design.weights, samples.matrices) <= 2e-6
    assert oed.optimality_gap(first.weights, samples.matrices) > 0.01
    assert oed.exact_design(samples, 12, design).efficiency > 0.9


@pytest.mark.parametrize("solver", ["newton", "cvxpy"])
def test_maximin_against_one_convex_problem(solver):
    best = best_by_cvxpy("maximin")
    design = oed.optimal_design(
        oed.InformationSamples(SETS), oed.MaximinCriterion("D"), solver=solver
    )
    assert design.value * P == pytest.approx(best, abs=1e-5)
    assert design.gap <= 1e-6


@pytest.mark.parametrize("criterion", ["D", "A", oed.DsCriterion(("k0", "k1"))])
def test_maximin_efficiencies_are_the_best_of_the_worst(criterion):
    robust = oed.robust_design(SETS, criterion, "maximin", solver="newton")
    average = oed.robust_design(SETS, criterion, "average", solver="newton")
    worst = robust.efficiency.min()
    assert worst >= average.efficiency.min() - 1e-6
    assert worst > robust.nominal_efficiency.min() + 0.02
    assert np.log(worst) == pytest.approx(robust.design.value, abs=1e-9)
    assert robust.nominal_efficiency[0] == pytest.approx(1.0, abs=1e-6)
    assert np.log(average.efficiency).mean() >= np.log(robust.efficiency).mean() - 1e-6
    # By another route: no random mixture of the samples' own designs has a better worst case.
    base = objective_of(criterion, SETS[0].names)
    local = [oed.optimal_design(one, criterion, solver="newton") for one in SETS]
    rng = np.random.default_rng(0)
    for shares in rng.dirichlet(np.ones(K), 50):
        weights = sum(s * d.weights for s, d in zip(shares, local, strict=True))
        efficiencies = [
            base.efficiency(np.tensordot(weights, one.matrices, axes=1), own.information)
            for one, own in zip(SETS, local, strict=True)
        ]
        assert min(efficiencies) <= worst + 1e-6


def test_e_at_worst():
    robust = oed.robust_design(SETS, "E", "maximin")
    assert robust.design.gap <= 1e-6
    smallest = [np.linalg.eigvalsh(M)[0] for M in robust.design.information]
    own = [oed.optimal_design(one, "E").value for one in SETS]
    np.testing.assert_allclose(np.divide(smallest, own), robust.efficiency, rtol=1e-6)


def test_equal_samples_need_no_robustness():
    robust = oed.robust_design([SETS[0]] * 2, solver="newton")
    np.testing.assert_allclose(robust.efficiency, 1.0, atol=1e-6)
    np.testing.assert_allclose(robust.design.weights, robust.nominal.weights, atol=1e-5)


def test_a_single_sample_is_the_plain_design():
    robust = oed.robust_design(SETS[:1], solver="newton")
    np.testing.assert_allclose(robust.design.weights, robust.nominal.weights, atol=1e-9)
    np.testing.assert_allclose([*robust.efficiency, *robust.nominal_efficiency], 1.0, rtol=1e-9)
    samples = oed.InformationSamples(SETS[:1])
    plan = oed.exact_design(samples, 8, robust.design, criterion=oed.MaximinCriterion("D"))
    np.testing.assert_array_equal(plan.repetitions, oed.exact_design(SETS[0], 8).repetitions)


def test_a_sample_of_no_share_is_refused_and_shares_matter():
    heavy = oed.robust_design(SETS, "D", "average", shares=[1e6, 1, 1], solver="newton")
    np.testing.assert_allclose(heavy.efficiency, heavy.nominal_efficiency, atol=1e-4)
    with pytest.raises(InvalidInput, match="3 positive numbers are needed"):
        oed.robust_design(SETS, "D", "average", shares=[0, 1, 1])


def test_robust_designs_obey_constraints():
    rules = oed.Constraints(experiments=10, most=1.0)
    robust = oed.robust_design(SETS, "D", "maximin", constraints=rules, solver="newton")
    assert robust.design.gap <= 1e-6
    assert robust.design.weights.max() <= 1 + 1e-9
    assert robust.design.weights.sum() == pytest.approx(10, rel=1e-8)
    assert robust.efficiency.max() <= 1 + 1e-6


@pytest.mark.parametrize(
    ("run", "message"),
    [
        (
            lambda: oed.robust_design(SETS, "D", "maximum"),
            "kind 'maximum' .*did you mean 'maximin'",
        ),
        (lambda: oed.robust_design([]), "samples: no information set"),
        (
            lambda: oed.robust_design(SETS, "D", "maximin", shares=[1, 2, 1]),
            'shares: they weigh an average; kind "maximin" has none',
        ),
        (
            lambda: oed.robust_design([SETS[0], random_set(0, 5, P, 2)]),
            "samples: set 1 has 5 candidates .* set 0 has 60",
        ),
        (
            lambda: oed.optimal_design(
                oed.InformationSamples(SETS), oed.MaximinCriterion("D", [1.0])
            ),
            "criterion maximin D: references .*; 3 numbers are needed",
        ),
        (
            lambda: oed.robust_design(SETS, oed.MaximinCriterion("D"), "average"),
            "is robust already",
        ),
    ],
)
def test_robust_mistakes(run, message):
    with pytest.raises(InvalidInput, match=message):
        run()
