"""Optima of every criterion: published designs, closed forms, and other ways to find them."""

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from random_candidates import information_set, quadratic_regression, random_set
from scipy.optimize import minimize

import oed
from oed.criteria.criteria import objective_of
from robotmodels import InvalidInput, NotIdentifiable

SOLVERS = [("newton", "primal"), ("cvxpy", "primal"), ("cvxpy", "dual")]
CVXPY = SOLVERS[1:]
POINTS = np.linspace(-1, 1, 201)
REGRESSION = quadratic_regression(POINTS)
# The mean of f f' over [-1, 1] for f = (1, x, x^2).
MEAN = np.array([[1, 0, 1 / 3], [0, 1 / 3, 0], [1 / 3, 0, 1 / 5]])


@pytest.mark.parametrize(("solver", "form"), SOLVERS)
@pytest.mark.parametrize(
    ("criterion", "shares", "value"),
    [
        ("A", [1 / 4, 1 / 2, 1 / 4], -8.0),
        (oed.ICriterion(MEAN), [1 / 4, 1 / 2, 1 / 4], -32 / 15),
        (oed.DsCriterion(("k2",)), [1 / 4, 1 / 2, 1 / 4], -np.log(4)),
        (oed.AsCriterion(("k2",)), [1 / 4, 1 / 2, 1 / 4], -4.0),
        # Extrapolation to x = 2, shares as |L_i(2)| (Hoel and Levine 1964).
        (oed.CCriterion(np.array([1.0, 2.0, 4.0])), [1 / 7, 3 / 7, 3 / 7], -49.0),
        ("E", [1 / 5, 3 / 5, 1 / 5], 1 / 5),
    ],
    ids=["A", "I", "Ds", "As", "c", "E"],
)
def test_published_quadratic_regression(criterion, shares, value, solver, form):
    if criterion == "E" and solver == "newton":
        pytest.skip("E is not smooth")
    design = oed.optimal_design(REGRESSION, criterion, solver=solver, form=form)
    near = [design.weights[np.abs(POINTS - x) < 0.025].sum() for x in (-1, 0, 1)]
    np.testing.assert_allclose(near, shares, atol=1e-4)
    assert design.value == pytest.approx(value, abs=2e-5 * abs(value))
    assert design.gap <= 1e-6


def test_cubic_regression_measures_at_the_extrema_of_legendre_polynomials():
    """D-optimal for a cubic: the zeros of (1 - x^2) P_3'(x) (Guest 1958)."""
    points = np.sort(np.append(np.linspace(-1, 1, 101), [-np.sqrt(0.2), np.sqrt(0.2)]))
    f = np.stack([points**k for k in range(4)], axis=1)
    info = information_set(f[:, :, None] * f[:, None, :])
    design = oed.optimal_design(info, solver="newton", tolerance=1e-9)
    np.testing.assert_allclose(points[design.support], [-1, -np.sqrt(0.2), np.sqrt(0.2), 1])
    np.testing.assert_allclose(design.weights[design.support], 1 / 4, atol=1e-8)


@pytest.mark.parametrize(("solver", "form"), SOLVERS)
def test_one_point_suffices_for_its_own_mean(solver, form):
    """c = f(0): every experiment at zero, where the information is singular (Elfving 1952)."""
    design = oed.optimal_design(
        REGRESSION, oed.CCriterion(np.array([1.0, 0.0, 0.0])), solver=solver, form=form
    )
    assert design.value == pytest.approx(-1.0, rel=1e-5)
    assert design.gap <= 1e-6
    assert design.weights[100] > 0.99


def plain_values(kind, matrix, rng):
    """Return a value by textbook formulas, and the criterion."""
    p = len(matrix)
    inverse = np.linalg.inv
    c = rng.standard_normal(p)
    L = np.diag(rng.uniform(0, 1, p)) + np.outer(c, c)
    half = [f"k{i}" for i in range((p + 1) // 2)]
    n = len(half)

    def ds(M):
        return np.linalg.slogdet(M).logabsdet - np.linalg.slogdet(M[n:, n:]).logabsdet

    return {
        "D": ("D", lambda M: np.linalg.slogdet(M).logabsdet),
        "A": ("A", lambda M: -np.trace(inverse(M))),
        "c": (oed.CCriterion(c), lambda M: -(c @ inverse(M) @ c)),
        "Ds": (oed.DsCriterion(tuple(half)), ds),
        "As": (oed.AsCriterion(tuple(half)), lambda M: -np.trace(inverse(M)[:n, :n])),
        "I": (oed.ICriterion(L), lambda M: -np.trace(L @ inverse(M))),
        "mixture": (
            oed.MixtureCriterion(["D", "A"], [3, 1]),
            lambda M: (
                0.75 * np.linalg.slogdet(M).logabsdet / p - 0.25 * np.log(np.trace(inverse(M)))
            ),
        ),
    }[kind]


SMOOTH = ["D", "A", "c", "Ds", "As", "I", "mixture"]


@pytest.mark.parametrize("kind", SMOOTH)
@settings(max_examples=2, deadline=None)
@given(seed=st.integers(0, 10**6), p=st.integers(2, 4), rank=st.integers(1, 4))
def test_best_of_a_search_by_scipy(kind, seed, p, rank):
    """A simplex search on the textbook formula never does better, and gets near."""
    info = random_set(seed, p + 3, p, max(rank, 2))
    criterion, value = plain_values(kind, info.matrices[0], np.random.default_rng(seed))

    flat = info.matrices.reshape(len(info), -1)

    def cost(logits):
        weights = np.exp(logits - logits.max())
        M = (weights / weights.sum() @ flat).reshape(p, p)
        low, *_, high = np.linalg.eigvalsh(M)
        return -value(M) if low > 1e-12 * high else 1e12

    options = {"maxiter": 1000, "adaptive": True}
    found = minimize(cost, np.zeros(len(info)), method="Nelder-Mead", options=options).fun
    design = oed.optimal_design(info, criterion, solver="newton")
    # Where the optimum is singular, a little of all candidates lets the textbook formula be.
    regular = design.information + 1e-9 * info.matrices.mean(axis=0)
    assert design.value == pytest.approx(value(regular), rel=1e-6, abs=1e-6)
    assert design.value >= -found - 1e-6 * abs(found)
    # The search may stop early, so this only rules out that both are far off.
    assert design.value == pytest.approx(-found, rel=0.2, abs=0.1)


@pytest.mark.parametrize("kind", SMOOTH)
@pytest.mark.parametrize(("solver", "form"), CVXPY)
def test_solvers_agree(kind, solver, form):
    info = random_set(11, 80, 5, 3)
    criterion, _ = plain_values(kind, info.matrices[0], np.random.default_rng(2))
    fast = oed.optimal_design(info, criterion, solver="newton")
    other = oed.optimal_design(info, criterion, solver=solver, form=form)
    assert other.value == pytest.approx(fast.value, rel=2e-6)
    assert other.solver.startswith("cvxpy")
    assert fast.solver.startswith("newton")


@settings(max_examples=4, deadline=None)
@given(seed=st.integers(0, 10**6), p=st.integers(2, 4))
def test_e_against_the_smallest_eigenvalue_maximised_by_cvxpy(seed, p):
    info = random_set(seed, 3 * p, p, 2)
    w = cp.Variable(len(info), nonneg=True)
    M = cp.reshape(info.matrices.reshape(len(info), -1).T @ w, (p, p), order="C")
    problem = cp.Problem(cp.Maximize(cp.lambda_min(M)), [cp.sum(w) == 1])
    best = problem.solve(solver=cp.CLARABEL)
    assert problem.status == "optimal"
    design = oed.optimal_design(info, "E")
    assert design.value == pytest.approx(best, rel=1e-5)
    assert design.value == pytest.approx(np.linalg.eigvalsh(design.information)[0], rel=1e-9)


@pytest.mark.parametrize("form", ["primal", "dual"])
def test_mixtures_with_e(form):
    for seed in range(6):
        matrices = random_set(0, 30, 4, 2).matrices + random_set(seed, 30, 4, 1).matrices
        mixture = oed.MixtureCriterion(("D", "E"))
        design = oed.optimal_design(information_set(matrices), mixture, form=form)
        assert design.gap <= 1e-6


def test_an_eigenvector_does_not_certify_a_multiple_eigenvalue():
    """Negative control: without the dual matrix W the same design looks far from optimal."""
    info = random_set(5, 100, 4, 3)
    design = oed.optimal_design(info, "E")
    eigenvalues = np.linalg.eigvalsh(design.information)
    assert eigenvalues[1] == pytest.approx(eigenvalues[0], rel=1e-4)
    with_dual = oed.optimality_gap(design.weights, info.matrices, "E", witness=design.witness)
    assert with_dual <= 1e-6
    assert oed.optimality_gap(design.weights, info.matrices, "E") > 0.01


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6), kind=st.sampled_from(SMOOTH))
def test_no_design_beats_the_certificate(seed, kind):
    """A bound from any design's derivative holds for the optimum found by another route."""
    info = random_set(seed, 7, 3, 2)
    rng = np.random.default_rng(seed)
    criterion, _ = plain_values(kind, info.matrices[0], rng)
    wanted = objective_of(criterion, info.names)
    weights = rng.dirichlet(np.ones(7))
    gap = oed.optimality_gap(weights, info.matrices, wanted)
    for other in rng.dirichlet(0.3 * np.ones(7), 60):
        ratio = wanted.efficiency(
            np.tensordot(other, info.matrices, axes=1), np.tensordot(weights, info.matrices, axes=1)
        )
        assert ratio <= (1 + gap) * (1 + 1e-9)


@pytest.mark.parametrize("kind", SMOOTH)
def test_gradients_are_directional_derivatives(kind):
    first, second = random_set(3, 2, 4, 6).matrices
    criterion, value = plain_values(kind, first, np.random.default_rng(4))
    wanted = objective_of(criterion, tuple(f"k{i}" for i in range(4)))
    assert wanted.value(first) == pytest.approx(value(first), rel=1e-9)
    h = 1e-7
    difference = (value(first + h * second) - value(first - h * second)) / (2 * h)
    assert np.vdot(wanted.gradient(first), second) == pytest.approx(difference, rel=1e-5)


def test_nuisance_that_nothing_identifies_does_not_matter():
    info = random_set(2, 30, 3, 3)
    matrices = np.zeros((30, 4, 4))
    matrices[:, :3, :3] = info.matrices
    wider = information_set(matrices)
    interest = oed.DsCriterion(("k0", "k1"))
    narrow = oed.optimal_design(info, interest, solver="newton")
    design = oed.optimal_design(wider, interest, solver="newton")
    assert design.value == pytest.approx(narrow.value, abs=1e-6)
    for criterion in ("D", oed.DsCriterion(("k3",)), oed.CCriterion(np.ones(4))):
        with pytest.raises(NotIdentifiable, match="not identifiable: k3; add positions"):
            oed.optimal_design(wider, criterion)


def test_prior_information_is_added():
    info = random_set(1, 40, 3, 2)
    design = oed.optimal_design(info, prior=1e4 * np.diag([1.0, 1.0, 0.0]), solver="newton")
    alone = oed.optimal_design(info, oed.CCriterion(np.array([0.0, 0.0, 1.0])), solver="newton")
    # What is known already leaves the third parameter alone to be measured.
    third = design.information[2, 2] - design.information[2, :2] @ np.linalg.solve(
        design.information[:2, :2], design.information[:2, 2]
    )
    assert third >= 1 / -alone.value * (1 - 1e-9)
    assert design.gap <= 1e-6
    rising = oed.optimal_design(info, prior=design.information, solver="newton")
    assert rising.value > design.value


def test_prior_makes_a_single_experiment_designable():
    info = random_set(1, 40, 5, 1)
    design = oed.optimal_design(
        information_set(info.matrices[:3]), prior=np.eye(5), solver="newton"
    )
    assert design.gap <= 1e-6


@pytest.mark.parametrize(
    ("prior", "message"),
    [
        (np.eye(2), r"prior: shape \(2, 2\)"),
        (np.full((3, 3), np.nan), "prior: shape .* finite numbers"),
        (np.array([[1.0, 1, 0], [0, 1, 0], [0, 0, 1]]), "prior: the matrix is not symmetric"),
        (-np.eye(3), "prior: the matrix is not positive semidefinite"),
    ],
)
def test_priors_that_are_none(prior, message):
    with pytest.raises(InvalidInput, match=message):
        oed.optimal_design(random_set(0, 10, 3, 2), prior=prior)


@pytest.mark.parametrize(
    ("criterion", "message"),
    [
        (oed.CCriterion(np.zeros(3)), r"criterion c: vector of shape \(3,\)"),
        (oed.CCriterion(np.ones(2)), r"criterion c: vector of shape \(2,\)"),
        (oed.DsCriterion(("k9",)), r"criterion D_s: parameter 'k9' is unknown"),
        (oed.DsCriterion(("k0", "k0")), "distinct names needed"),
        (oed.AsCriterion(()), "criterion A_s: interest"),
        (oed.ICriterion(np.eye(2)), r"criterion I: matrix of shape \(2, 2\)"),
        (oed.ICriterion(-np.eye(3)), "not symmetric, positive semidefinite"),
        (oed.MixtureCriterion([]), "criterion mixture: criteria: none given"),
        (oed.MixtureCriterion(["D", "A"], [1, -1]), "2 positive numbers are needed"),
        (oed.MixtureCriterion(["D", oed.MaximinCriterion()]), "cannot be part of a mixture"),
        (3, "criterion 3 is neither a name nor a criterion"),
    ],
)
def test_criteria_that_do_not_fit(criterion, message):
    info = random_set(0, 10, 3, 2)
    if isinstance(criterion, oed.MixtureCriterion) and "cannot" in message:
        info = oed.InformationSamples((info, info))
    with pytest.raises(InvalidInput, match=message):
        oed.optimal_design(info, criterion)


def test_newton_refuses_what_is_not_smooth():
    with pytest.raises(InvalidInput, match=r'criterion E is not smooth: use solver="cvxpy"'):
        oed.optimal_design(random_set(0, 10, 3, 2), "E", solver="newton")
