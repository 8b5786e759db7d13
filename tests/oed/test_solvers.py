"""What the solvers of an active set do with awkward candidates, and when one of them fails."""

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_candidates import information_set, random_set

import oed
import oed.design.active_set
from oed.design.criteria import objective
from oed.design.inner_problem import InnerProblem
from oed.design.newton import newton
from robotmodels import InvalidInput, SolverFailed


def awkward(seed, kind):
    """Rank-one, repeated, nearly equal, badly scaled or nearly collinear candidates."""
    rng = np.random.default_rng(seed)
    p, n = int(rng.integers(2, 7)), int(rng.integers(10, 60))
    J = rng.standard_normal((n, p, 1)) * np.exp(rng.standard_normal((n, 1, 1)))
    if kind == "repeated":
        J = np.repeat(J, 3, axis=0)
    elif kind == "nearly equal":
        J = np.concatenate([J, J * (1 + 1e-6 * rng.standard_normal(J.shape))])
    elif kind == "badly scaled":
        J = J * 10.0 ** rng.uniform(-5, 5, (1, p, 1))
    elif kind == "nearly collinear":
        J[:, 0] = J[:, 1] + 1e-3 * J[:, 0]
    return information_set(J @ np.swapaxes(J, 1, 2))


@pytest.mark.parametrize(
    "kind", ["rank one", "repeated", "nearly equal", "badly scaled", "nearly collinear"]
)
@settings(max_examples=5, deadline=None)
@given(seed=st.integers(0, 10**6), criterion=st.sampled_from(["D", "A", "c"]))
def test_awkward_candidates(kind, seed, criterion):
    info = awkward(seed, kind)
    wanted = criterion
    if criterion == "c":
        wanted = oed.CCriterion(np.random.default_rng(seed).standard_normal(len(info.names)))
    design = oed.optimal_design(info, wanted, solver="newton")
    assert design.gap <= 1e-6
    # The bound holds for what the certificate never saw: random designs.
    judge = objective(wanted, info.names)
    for weights in np.random.default_rng(seed).dirichlet(0.2 * np.ones(len(info)), 20):
        other = np.tensordot(weights, info.matrices, axes=1)
        assert judge.efficiency(other, design.information) <= 1 + 2e-6


def test_small_shares_of_nearly_equal_candidates_are_kept_where_they_matter():
    """Without them these gaps stay above the tolerance."""
    for seed, criterion in ((537, "A"), (125, "D"), (140, "D")):
        info = awkward(seed, "nearly equal")
        assert oed.optimal_design(info, criterion, solver="newton").gap <= 1e-6


def test_inner_problem_against_cvxpy():
    """Weights, rows' multipliers and derivative of one small problem with two rows."""
    info = random_set(3, 20, 3, 2)
    rows, bounds = np.stack([np.ones(20), np.linspace(0, 2, 20)]), np.array([1.0, 0.6])
    wanted = objective("D", info.names)
    found = newton(InnerProblem(wanted, (0.1 * np.eye(3),), (info.matrices,), rows, bounds), 1e-10)
    w = cp.Variable(20, nonneg=True)
    M = 0.1 * np.eye(3) + cp.reshape(info.matrices.reshape(20, -1).T @ w, (3, 3), order="C")
    limits = rows @ w <= bounds
    cp.Problem(cp.Maximize(cp.log_det(M) / 3), [limits]).solve(cp.CLARABEL)
    np.testing.assert_allclose(found.weights, w.value, atol=1e-4)
    np.testing.assert_allclose(found.row_multipliers, limits.dual_value, rtol=1e-3, atol=1e-5)
    np.testing.assert_allclose(found.witness[0], np.linalg.inv(M.value) / 3, rtol=1e-3, atol=1e-5)


@pytest.mark.parametrize("criterion", ["D", "A", "c", "Ds"])
def test_both_statements_of_more_parameters_than_one_cone_holds(criterion):
    """Determinants and traces fall apart into several cones; newton knows nothing of that."""
    info = random_set(2, 60, 12, 3)
    wanted = {"c": oed.CCriterion(np.arange(12.0)), "Ds": oed.DsCriterion(info.names[:10])}
    design = oed.optimal_design(info, wanted.get(criterion, criterion), solver="newton")
    for form in ("primal", "dual"):
        other = oed.optimal_design(info, wanted.get(criterion, criterion), form=form)
        assert other.solver.startswith("cvxpy, clarabel")
        assert other.gap <= 1e-6
        assert other.value == pytest.approx(design.value, rel=1e-6, abs=1e-6)


def test_scs_takes_over_from_clarabel(monkeypatch):
    solve = cp.Problem.solve

    def no_clarabel(problem, solver, **options):
        if solver == "CLARABEL":
            raise cp.SolverError("no luck")
        return solve(problem, solver=solver, **options)

    monkeypatch.setattr(cp.Problem, "solve", no_clarabel)
    info = random_set(1, 30, 3, 2)
    design = oed.optimal_design(info)
    assert design.solver.startswith("cvxpy, scs")
    assert design.gap <= 1e-6
    assert design.value == pytest.approx(oed.optimal_design(info, solver="newton").value, abs=1e-6)


def test_cvxpy_takes_over_from_newton(monkeypatch):
    def stuck(*_, **__):
        raise SolverFailed("interior-point method stopped 0.1 from its goal")

    monkeypatch.setattr(oed.design.active_set, "newton", stuck)
    design = oed.optimal_design(random_set(1, 30, 3, 2), solver="newton", tolerance=1e-5)
    assert design.solver == "interior-point method stopped 0.1 from its goal: cvxpy, clarabel"
    assert design.gap <= 1e-5


def test_cvxpy_finds_its_candidates_where_newton_is_stuck(monkeypatch):
    def stuck(*_, **__):
        raise SolverFailed("interior-point method stopped 0.1 from its goal")

    info = random_set(1, 3000, 6, 1)
    expected = oed.optimal_design(info, solver="newton").value
    monkeypatch.setattr(oed.design.active_set, "newton", stuck)
    design = oed.optimal_design(info, tolerance=1e-5)
    assert design.solver.startswith("cvxpy, clarabel")
    assert design.value == pytest.approx(expected, abs=1e-4)


def test_no_rounds_no_design():
    with pytest.raises(InvalidInput, match="max_rounds: 0; at least 1 is needed"):
        oed.optimal_design(random_set(1, 30, 3, 2), max_rounds=0)
