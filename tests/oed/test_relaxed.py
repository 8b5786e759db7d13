import pickle

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from random_candidates import information_set, quadratic_regression, random_set

from oed import optimal_design
from oed.design.coordinates import whiten
from oed.design.whitening import distinct
from robotmodels import InvalidInput, NotIdentifiable, SolverFailed

SOLVERS = ["cvxpy", "newton"]


def plain_gap(weights, matrices):
    M = np.tensordot(weights, matrices, axes=1)
    return max(np.trace(np.linalg.solve(M, H)) for H in matrices) / len(M) - 1


def monolithic_value(matrices):
    """Return the largest log det by one convex problem over all candidates."""
    w = cp.Variable(len(matrices), nonneg=True)
    information = sum(w[i] * H for i, H in enumerate(matrices))
    problem = cp.Problem(cp.Maximize(cp.log_det(information)), [cp.sum(w) == 1])
    value = problem.solve(solver=cp.CLARABEL)
    assert problem.status == "optimal"
    return value


@settings(max_examples=10, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    p=st.integers(1, 4),
    spare=st.integers(0, 12),
    rank=st.integers(1, 4),
    solver=st.sampled_from(SOLVERS),
)
def test_design_equals_one_convex_problem(seed, p, spare, rank, solver):
    info = random_set(seed, p + spare, p, rank)
    design = optimal_design(info, solver=solver)
    reference = whiten(info.matrices, info.total)
    shift = np.linalg.slogdet(info.total).logabsdet
    assert design.value == pytest.approx(monolithic_value(reference) + shift, abs=1e-5)


@settings(max_examples=20, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    p=st.integers(1, 8),
    spare=st.integers(0, 100),
    rank=st.integers(1, 8),
)
def test_certificate_by_plain_numpy(seed, p, spare, rank):
    info = random_set(seed, p + spare, p, rank)
    design = optimal_design(info, solver="newton")
    assert plain_gap(design.weights, info.matrices) < 2e-6
    assert design.gap <= 1e-6
    assert design.weights.sum() == pytest.approx(1.0, abs=1e-12)
    assert design.weights.min() == 0.0 or len(design.support) == len(info)
    np.testing.assert_array_equal(design.support, np.flatnonzero(design.weights))
    np.testing.assert_allclose(
        design.information, np.tensordot(design.weights, info.matrices, axes=1)
    )


@pytest.mark.parametrize("solver", SOLVERS)
def test_quadratic_regression_measures_ends_and_middle(solver):
    points = np.linspace(-1, 1, 2001)
    design = optimal_design(quadratic_regression(points), solver=solver, tolerance=1e-9)
    np.testing.assert_allclose(points[design.support], [-1, 0, 1], atol=1e-12)
    np.testing.assert_allclose(design.weights[design.support], 1 / 3, atol=1e-8)
    # M = [[1, 0, 2/3], [0, 2/3, 0], [2/3, 0, 2/3]]
    assert design.value == pytest.approx(np.log(4 / 27), abs=1e-8)
    assert design.efficiency == pytest.approx(1.0, abs=1e-8)
    assert design.criterion == "D"
    assert design.solver.startswith(solver)


def test_duplicates_share_one_place():
    info = random_set(5, 30, 4, 3)
    rng = np.random.default_rng(0)
    order = rng.permutation(np.repeat(np.arange(30), 5))
    noisy = info.matrices[order] * (1 + 1e-14 * rng.standard_normal((150, 1, 1)))
    single = optimal_design(info, solver="newton")
    repeated = optimal_design(information_set(noisy), solver="newton")
    assert len(repeated.support) == len(single.support)
    by_original = np.bincount(order, repeated.weights, minlength=30)
    np.testing.assert_allclose(by_original, single.weights, atol=1e-7)


def test_distinct_compares_matrices_not_projections():
    base = np.zeros((4, 3))
    base[1, 0] = base[3, 0] = 1.0
    base[2, 0] = 1.0 + 1e-6
    assert distinct(base).tolist() == [0, 1, 2]


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("seed", range(3))
def test_units_do_not_change_the_design(seed, solver):
    info = random_set(seed, 60, 5, 3)
    scale = 10.0 ** np.random.default_rng(seed).uniform(-6, 6, 5)
    scaled = information_set(scale[:, None] * info.matrices * scale)
    plain, other = optimal_design(info, solver=solver), optimal_design(scaled, solver=solver)
    np.testing.assert_allclose(other.weights, plain.weights, atol=1e-5)
    assert other.value == pytest.approx(plain.value + 2 * np.log(scale).sum(), abs=1e-6)


def test_overall_scale_of_the_information_does_not_matter():
    info = random_set(1, 40, 4, 2)
    for factor in (1e-30, 1e30):
        other = optimal_design(information_set(factor * info.matrices), solver="newton")
        np.testing.assert_allclose(other.weights, optimal_design(info, solver="newton").weights)


def test_largest_traces_alone_may_identify_nothing():
    """The 2p candidates of largest trace all inform on one parameter only."""
    strong = [np.diag([1e3 + i, 0, 0]) for i in range(50)]
    weak = [np.diag([0, 1.0 + i, 0]) for i in range(3)] + [
        np.diag([0, 0, 1.0 + i]) for i in range(3)
    ]
    design = optimal_design(information_set(strong + weak), solver="newton")
    assert design.support.tolist() == [49, 52, 55]
    np.testing.assert_allclose(design.weights[design.support], 1 / 3, atol=1e-8)


def test_some_candidates_inform_on_nothing():
    matrices = random_set(1, 20, 3, 2).matrices.copy()
    matrices[::2] = 0.0
    assert (optimal_design(information_set(matrices), solver="newton").support % 2 == 1).all()


def test_single_candidate():
    design = optimal_design(random_set(0, 1, 3, 3))
    assert design.weights.tolist() == [1.0]
    assert abs(design.gap) < 1e-9


@pytest.mark.parametrize(("n_candidates", "solver"), [(2000, "cvxpy"), (4000, "newton")])
def test_thousands_of_candidates(n_candidates, solver):
    info = random_set(7, n_candidates, 26, 30)
    design = optimal_design(info, solver=solver)
    assert plain_gap(design.weights, info.matrices) <= 1e-6


def test_not_identifiable_names_the_parameters():
    J = np.random.default_rng(0).standard_normal((50, 4, 3))
    J[:, 2] = 0.5 * J[:, 0]
    info = information_set(J @ np.swapaxes(J, 1, 2))
    said = r"not identifiable: k0, k2 \(open: -0.5 k0 \+ k2\); add positions"
    with pytest.raises(NotIdentifiable, match=said) as caught:
        optimal_design(info)
    assert caught.value.names == ("k0", "k2")
    again = pickle.loads(pickle.dumps(caught.value))
    assert (again.combinations, str(again)) == (("-0.5 k0 + k2",), str(caught.value))


def test_unknown_choices():
    info = random_set(0, 5, 2, 2)
    with pytest.raises(InvalidInput, match=r"solver 'cvxpi' .*did you mean 'cvxpy'"):
        optimal_design(info, solver="cvxpi")
    with pytest.raises(InvalidInput, match=r"form 'dul' .*did you mean 'dual'"):
        optimal_design(info, form="dul")
    with pytest.raises(InvalidInput, match="criterion 'X' is not known"):
        optimal_design(info, criterion="X")
    for tolerance in (0.0, -1e-6, np.nan):
        with pytest.raises(InvalidInput, match=r"tolerance: .* is not a number > 0"):
            optimal_design(info, tolerance=tolerance)


def test_a_gap_above_tolerance_is_an_error():
    """No floating-point design comes that near."""
    with pytest.raises(
        SolverFailed, match=r"certified gap is .* rounds, above the tolerance 1e-18"
    ):
        optimal_design(random_set(7, 300, 8, 1), tolerance=1e-18, solver="newton")


@pytest.mark.parametrize("tolerance", [0.5, 2.0, 20.0])
def test_coarse_designs_keep_weights(tolerance):
    design = optimal_design(random_set(3, 40, 5, 3), tolerance=tolerance, solver="newton")
    assert len(design.support)
    assert 0 <= design.gap <= tolerance


def test_a_design_has_the_gap_of_every_round():
    info = random_set(7, 400, 6, 2)
    design = optimal_design(info, solver="newton")
    assert len(design.gaps) == design.rounds > 1
    assert (design.gaps > -1e-9).all()
    assert design.gaps.min() <= 1e-6 < design.gaps[0]
    first = optimal_design(info, solver="newton", tolerance=2 * design.gaps[0], max_rounds=1)
    assert first.rounds == 1
    assert first.gap == pytest.approx(plain_gap(first.weights, info.matrices), rel=1e-6)
