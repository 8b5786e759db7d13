"""What the solvers of an active set do with awkward candidates, and when one of them fails."""

from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from random_candidates import information_set, random_set
from scipy.optimize import minimize, nnls

import oed
from oed.criteria.criteria import objective_of
from oed.design.problem import ScaledProblem, SolverAnswer
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
    judge = objective_of(wanted, info.names)
    for weights in np.random.default_rng(seed).dirichlet(0.2 * np.ones(len(info)), 20):
        other = np.tensordot(weights, info.matrices, axes=1)
        assert judge.efficiency(other, design.information) <= 1 + 2e-6


def test_barrier_method_against_cvxpy():
    """Weights, rows' multipliers and derivative of one small problem with two rows and caps."""
    info = random_set(3, 20, 3, 2)
    rows, bounds = np.stack([np.ones(20), np.linspace(0, 2, 20)]) / [[1], [2]], np.array([1.0, 0.3])
    caps = np.where(np.arange(20) % 2, 0.1, np.inf)
    wanted, base = objective_of("D", info.names), 0.1 * np.eye(3)
    start = np.full(20, 0.02)
    problem = ScaledProblem(wanted, (base,), (info.matrices,), rows, bounds, caps, start)
    answer = oed.Newton().solve(problem, 1e-9)
    w = cp.Variable(20, nonneg=True)
    M = base + cp.reshape(info.matrices.reshape(20, -1).T @ w, (3, 3), order="C")
    limits = rows @ w <= bounds
    judge = cp.Problem(cp.Maximize(cp.log_det(M) / 3), [limits, w[1::2] <= 0.1])
    tight = {"tol_gap_abs": 1e-11, "tol_gap_rel": 1e-11, "tol_feas": 1e-11}
    judge.solve(cp.CLARABEL, **tight)
    assert judge.status == "optimal"
    np.testing.assert_allclose(answer.weights, w.value, atol=1e-5)
    np.testing.assert_allclose(answer.row_multipliers, limits.dual_value, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(answer.witness[0], np.linalg.inv(M.value) / 3, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("criterion", ["D", "A", "c", "Ds"])
def test_both_statements_of_more_parameters_than_one_cone_holds(criterion):
    """Determinants and traces fall apart into several cones; newton knows nothing of that."""
    info = random_set(2, 60, 12, 3)
    wanted = {"c": oed.CCriterion(np.arange(12.0)), "Ds": oed.DsCriterion(info.names[:10])}
    design = oed.optimal_design(info, wanted.get(criterion, criterion), solver="newton")
    for form in ("primal", "dual"):
        solver = oed.Cvxpy(form, solver="clarabel")
        other = oed.optimal_design(info, wanted.get(criterion, criterion), solver=solver)
        assert other.solver.startswith("cvxpy, clarabel")
        assert other.gap <= 1e-6
        assert other.value == pytest.approx(design.value, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("first", ["fails", "is imprecise"])
def test_clarabel_takes_over_from_scs(monkeypatch, first):
    solve = cp.Problem.solve

    def poor_scs(problem, solver, **options):
        if solver == "SCS":
            if first == "fails":
                raise cp.SolverError("no luck")
            options = {"eps": 1e-2}
        return solve(problem, solver=solver, **options)

    monkeypatch.setattr(cp.Problem, "solve", poor_scs)
    info = random_set(1, 30, 3, 2)
    design = oed.optimal_design(info, solver="cvxpy")
    assert "cvxpy, clarabel" in design.solver
    assert "newton" not in design.solver
    assert design.gap <= 1e-6
    assert design.value == pytest.approx(oed.optimal_design(info, solver="newton").value, abs=1e-6)


@pytest.mark.parametrize("criterion", ["D", "E"])
def test_the_barrier_method_goes_on_where_cvxpy_gives_no_answer(monkeypatch, criterion):
    info = random_set(1, 30, 3, 2)
    expected = oed.optimal_design(info, criterion).value

    def refuse(problem, **options):
        raise cp.SolverError("no luck")

    monkeypatch.setattr(cp.Problem, "solve", refuse)
    design = oed.optimal_design(info, criterion, solver="cvxpy")
    assert design.solver.startswith("newton")
    assert design.value == pytest.approx(expected, rel=2e-6)
    monkeypatch.setattr(cp.Problem, "solve", lambda problem, **options: None)
    assert "cvxpy" not in oed.optimal_design(info, criterion).solver


@pytest.mark.parametrize("criterion", ["D", "A"])
def test_a_smooth_criterion_needs_no_conic_solver(monkeypatch, criterion):
    """Unless the barrier method stalls."""
    info = random_set(1, 30, 3, 2)
    asked = []
    solve = cp.Problem.solve

    def conic(problem, **options):
        asked.append(options["solver"])
        return solve(problem, **options)

    def stuck(*_):
        raise SolverFailed("barrier method: no room between the constraints")

    monkeypatch.setattr(cp.Problem, "solve", conic)
    design = oed.optimal_design(info, criterion)
    assert design.solver.startswith("newton")
    assert not asked
    oed.optimal_design(info, criterion, form="dual")
    assert asked
    monkeypatch.setattr(oed.Newton, "solve", stuck)
    other = oed.optimal_design(info, criterion)
    assert other.solver.startswith("cvxpy, scs")
    assert other.value == pytest.approx(design.value, rel=1e-6)


def test_no_method_with_an_answer_says_why(monkeypatch):
    def stuck(*_):
        raise SolverFailed("barrier method: no room between the constraints")

    def refuse(problem, **options):
        raise cp.SolverError("no luck")

    monkeypatch.setattr(oed.Newton, "solve", stuck)
    with pytest.raises(SolverFailed, match="optimal design: barrier method: no room"):
        oed.optimal_design(random_set(1, 30, 3, 2), solver="newton")
    monkeypatch.setattr(cp.Problem, "solve", refuse)
    with pytest.raises(SolverFailed, match="SCS: no luck; CLARABEL: no luck; barrier method: no"):
        oed.optimal_design(random_set(1, 30, 3, 2), solver="cvxpy")


@pytest.mark.parametrize("criterion", ["D", "A", "c", "E"])
def test_cvxpy_is_a_judge_of_its_own(monkeypatch, criterion):
    """It never runs the barrier method, nor begins with its candidates, unless it stalls."""

    def forbidden(*_):
        raise AssertionError("the barrier method ran")

    info = random_set(1, 3000, 6, 1)
    wanted = oed.CCriterion(np.arange(6.0)) if criterion == "c" else criterion
    fast = None if criterion == "E" else oed.optimal_design(info, wanted, solver="newton").value
    monkeypatch.setattr(oed.Newton, "solve", forbidden)
    design = oed.optimal_design(info, wanted, tolerance=1e-5, solver="cvxpy")
    assert "newton" not in design.solver
    assert ("multiplicative" in design.solver) == (criterion != "E")
    assert fast is None or design.value == pytest.approx(fast, rel=1e-5)


def test_no_rounds_no_design():
    with pytest.raises(InvalidInput, match="max_rounds: 0; at least 1 is needed"):
        oed.optimal_design(random_set(1, 30, 3, 2), max_rounds=0)


class Slsqp:
    """A solver of somebody else: SciPy's sequential quadratic programming."""

    first_goal = 0.0

    def __init__(self, spoil=lambda answer: answer):
        self.spoil, self.calls = spoil, 0

    def check(self, objective):
        if not objective.smooth:
            raise InvalidInput(f"criterion {objective.name}: SLSQP needs derivatives")

    def solve(self, problem, goal, near=None):
        self.calls += 1

        def prices(weights):
            W = problem.objective.witness(problem.information(weights))
            return np.einsum("nij,ji->n", problem.matrices[0], W[0]), W

        result = minimize(
            lambda w: -problem.objective.log_value(problem.information(w)),
            problem.start,
            jac=lambda w: -prices(w)[0],
            bounds=[(1e-9, cap) for cap in problem.caps],
            constraints={
                "type": "ineq",
                "fun": lambda w: problem.bounds - problem.rows @ w,
                "jac": lambda w: -problem.rows,
            },
            method="SLSQP",
            options={"ftol": 1e-12, "maxiter": 500},
        )
        worth, witness = prices(result.x)
        free = (result.x > 1e-6) & (result.x < problem.caps - 1e-6)
        multipliers = nnls(problem.rows[:, free].T, worth[free])[0]
        return self.spoil(SolverAnswer(result.x, multipliers, witness, "SLSQP"))


@pytest.mark.parametrize("criterion", ["D", "A"])
@pytest.mark.parametrize(
    "constraints",
    [None, oed.Constraints(experiments=9, most=2, groups={"first": oed.Group(range(20), most=3)})],
)
def test_a_solver_of_ones_own(criterion, constraints):
    info, solver = random_set(5, 40, 3, 2), Slsqp()
    design = oed.optimal_design(info, criterion, constraints, solver=solver)
    judge = oed.optimal_design(info, criterion, constraints, solver="newton")
    assert solver.calls
    assert design.solver.startswith("SLSQP")
    assert design.gap <= 1e-6
    assert design.value == pytest.approx(judge.value, rel=1e-6, abs=2e-6)
    with pytest.raises(InvalidInput, match="criterion E: SLSQP needs derivatives"):
        oed.optimal_design(info, "E", solver=solver)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda answer: replace(answer, weights=np.full(answer.weights.shape, np.nan)),
        lambda answer: replace(answer, weights=answer.weights[1:]),
        lambda answer: replace(answer, weights=np.ones(answer.weights.shape)),
        lambda answer: replace(answer, witness=(-answer.witness[0],)),
        lambda answer: replace(answer, row_multipliers=-answer.row_multipliers),
    ],
)
def test_a_wrong_answer_costs_time_and_never_the_certificate(spoil):
    info = random_set(5, 40, 3, 2)
    design = oed.optimal_design(info, solver=Slsqp(spoil))
    assert design.gap <= 1e-6
    best = oed.optimal_design(info, solver="newton", tolerance=1e-9).value
    assert best - 3e-6 <= design.value <= best + 3e-9


def test_solvers_say_what_they_do_not_know():
    info = random_set(0, 5, 2, 2)
    with pytest.raises(InvalidInput, match="solver 3 is neither a name nor a `DesignSolver`"):
        oed.optimal_design(info, solver=3)
    with pytest.raises(InvalidInput, match=r"solver 'scz' .*did you mean 'scs'"):
        oed.Cvxpy(solver="scz")
    with pytest.raises(InvalidInput, match="first_goal: nan; a number >= 0 is needed"):
        oed.Newton(first_goal=np.nan)
