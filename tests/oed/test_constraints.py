import warnings

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from random_candidates import information_set, random_set
from scipy.optimize import linprog

from oed import Constraints, Group, optimal_design, optimality_gap
from oed.design.polytope import Polytope
from robotmodels import InvalidInput

Q = 120
INFO = random_set(3, Q, 5, 3)
RNG = np.random.default_rng(1)
DURATIONS = RNG.uniform(10, 60, Q)
CASES = {
    "experiments": Constraints(experiments=15),
    "one each": Constraints(experiments=15, most=1.0),
    "own most": Constraints(experiments=15, most=RNG.uniform(0.2, 3, Q)),
    "time": Constraints(time=100, durations=DURATIONS),
    "time and experiments": Constraints(experiments=15, time=400, durations=DURATIONS),
    "time and most": Constraints(time=600, durations=DURATIONS, most=2),
    "groups": Constraints(
        experiments=15,
        groups={"left": Group(range(30), least=6), "right": Group(range(50, 100), most=1)},
        forbidden=range(100, 110),
        mandatory={3: 2.5},
    ),
    "linear": Constraints(experiments=15, linear={"tilt": (RNG.normal(size=Q), -2.0)}),
    "no odd ones": Constraints(experiments=15, linear={"odd": (np.arange(Q) % 2, 0.0)}),
    "all": Constraints(
        experiments=15,
        time=500,
        durations=DURATIONS,
        most=2,
        groups={"left": Group(range(30), least=6)},
        forbidden=range(100, 110),
        mandatory={3: 1.5},
        linear={"thirds": (np.arange(Q) % 3, 9.0)},
    ),
}


def judged(constraints, criterion):
    """State everything at once, in cvxpy's own words; return a range that holds the best value.

    The judge judges itself: its weights give a lower bound, and the tangent there an upper one.
    """
    p = len(INFO.names)
    flat = INFO.matrices.reshape(Q, -1)
    w = cp.Variable(Q, nonneg=True)
    M = cp.reshape(flat.T @ w, (p, p), order="C")
    rules = [] if constraints.experiments is None else [cp.sum(w) <= constraints.experiments]
    if constraints.time is not None:
        rules.append(DURATIONS @ w <= constraints.time)
    if constraints.most is not None:
        rules.append(w <= constraints.most)
    rules += [w[i] >= least for i, least in constraints.mandatory.items()]
    rules += [w[i] == 0 for i in constraints.forbidden]
    for group in constraints.groups.values():
        rules.append(cp.sum(w[list(group.members)]) >= group.least)
        if np.isfinite(group.most):
            rules.append(cp.sum(w[list(group.members)]) <= group.most)
    rules += [a @ w <= b for a, b in constraints.linear.values()]
    goal = cp.log_det(M) if criterion == "D" else -cp.matrix_frac(np.eye(p), M)
    best = cp.Problem(cp.Maximize(goal), rules)
    with warnings.catch_warnings():  # the tangent tells how inaccurate it is
        warnings.filterwarnings("ignore", "Solution may be inaccurate", UserWarning)
        best.solve(solver=cp.CLARABEL)
    assert best.status in ("optimal", "optimal_inaccurate")
    M = (np.maximum(w.value, 0) @ flat).reshape(p, p)
    inverse = np.linalg.inv(M)
    value = np.linalg.slogdet(M).logabsdet if criterion == "D" else -np.trace(inverse)
    slope = flat @ (inverse if criterion == "D" else inverse @ inverse).ravel()
    linear = cp.Problem(cp.Maximize(slope @ w), rules)
    linear.solve(solver=cp.HIGHS)
    assert linear.status == "optimal"
    tangent = linear.value - (p if criterion == "D" else np.trace(inverse))
    return value, value + tangent


@pytest.mark.parametrize("name", CASES)
def test_constrained_design_equals_one_convex_problem(name):
    constraints = CASES[name]
    low, high = judged(constraints, "D")
    assert high - low < 1e-2
    # Each of cvxpy's kinds of rules once; they are stated for both solvers alike.
    for solver in ("newton", "cvxpy") if name in ("own most", "all") else ("newton",):
        design = optimal_design(INFO, "D", constraints, solver=solver)
        assert low - 1e-4 <= design.value <= high + 1e-4
        check_obeyed(constraints, design.weights)
        assert design.gap <= 1e-6


@pytest.mark.parametrize("name", ["own most", "all"])
def test_constrained_a_design(name):
    design = optimal_design(INFO, "A", CASES[name], solver="newton")
    low, high = judged(CASES[name], "A")
    assert high - low < 1e-2 * abs(low)
    assert low - 1e-4 * abs(low) <= design.value <= high + 1e-4 * abs(low)


@pytest.mark.parametrize("seed", [0, 2])
def test_limits_are_met_to_rounding_whatever_the_solver_takes_for_met(seed):
    durations = np.random.default_rng(seed).uniform(5, 10, 40)
    rules = Constraints(time=100, experiments=8, durations=durations, most=4)
    design = optimal_design(random_set(seed, 40, 4, 1), "A", rules, form="dual")
    assert rules.polytope(40).violation(design.weights) < 1e-14
    assert 0 <= design.gap <= 1e-6


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_rounding_at_bounds_of_zero_is_no_violation(scale):
    """Nor is it at limits of zero; a real excess is one at any scale, also beyond a small bound."""
    zero, free = np.zeros(3), np.full(3, np.inf)
    rows, bounds = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, 0.0]]), np.array([1.0, 0.0])
    weights = scale * np.array([0.2, 0.2, 0.6])
    weights[0] = np.nextafter(weights[0], np.inf)
    assert rows[1] @ weights > 0

    def violation(weights, bounds=bounds, upper=free, lower=zero):
        allowed = Polytope(rows, scale * bounds, scale * lower, scale * upper, ("sum", "pair"))
        return allowed.violation(weights)

    assert violation(weights) < 1e-15
    assert violation(weights - scale * np.array([0, 1e-3, 0])) == pytest.approx(1e-3, rel=2e-3)
    assert violation(weights, bounds=np.array([0.99, 0.0])) == pytest.approx(0.01 / 0.99)
    assert violation(weights, upper=np.array([0.3, 0.3, 0.59])) == pytest.approx(0.01 / 0.59)
    assert violation(weights, lower=np.array([0.2, 0.21, 0.0])) == pytest.approx(0.01 / 0.6)
    assert violation(scale * np.array([0.0, 0.0, 1e-17]), upper=np.array([1.0, 1.0, 0.0])) > 0.5
    tiny = scale * np.array([0.2, 0.2, 1e-17])
    assert violation(tiny, upper=np.array([1.0, 1.0, 0.0])) < 1e-15
    assert violation(zero) <= 0
    assert violation(zero, lower=np.array([0.0, 0.1, 0.0])) > 0


def check_obeyed(constraints, w):
    slack = 1e-6
    assert w.min() >= 0
    if constraints.experiments is not None:
        assert w.sum() <= constraints.experiments * (1 + slack)
    if constraints.time is not None:
        assert w @ DURATIONS <= constraints.time * (1 + slack)
    if constraints.most is not None:
        assert (w <= np.asarray(constraints.most) + slack).all()
    assert all(w[i] >= least - slack for i, least in constraints.mandatory.items())
    assert not w[list(constraints.forbidden)].any()
    for group in constraints.groups.values():
        assert group.least - slack <= w[list(group.members)].sum() <= group.most + slack
    assert all(a @ w <= b + slack * 10 for a, b in constraints.linear.values())


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10**6), rows=st.integers(1, 3), limited=st.booleans())
def test_the_most_a_price_can_reach(seed, rows, limited):
    """Sorting and multipliers against a linear program, and random multipliers above it."""
    rng = np.random.default_rng(seed)
    n = 12
    R = np.concatenate([rng.uniform(0.5, 2, (1, n)), rng.normal(size=(rows - 1, n))])
    lower = np.where(rng.random(n) < 0.3, 0.05, 0.0)
    upper = np.where(rng.random(n) < 0.5, 0.3, 2.0) if limited else np.full(n, np.inf)
    b = np.maximum(R @ lower, 0) + 1.0
    allowed = Polytope(R, b, lower, upper, tuple("abc"[:rows]))
    prices = rng.normal(size=n)
    limits = list(zip(lower, upper, strict=True))
    best = -linprog(-prices, A_ub=R, b_ub=b, bounds=limits).fun
    assert allowed.upper_bound(prices) == pytest.approx(best, abs=1e-8)
    assert allowed.upper_bound(prices, rng.uniform(0, 1, rows)) >= best - 1e-9


@pytest.mark.parametrize("name", ["own most", "groups", "time and experiments"])
def test_certificate_without_the_solver(name):
    """Weights alone are certified, by a linear program where there are several rows."""
    constraints = CASES[name]
    design = optimal_design(INFO, "D", constraints, solver="newton")
    gap = optimality_gap(design.weights, INFO.matrices, "D", constraints)
    assert 0 <= gap + 1e-12 <= 2e-6
    # Negative control: the best shares, scaled to obey, are not the best under the constraints.
    shares = optimal_design(INFO, solver="newton").weights
    other = constraints.polytope(Q).best_extreme_point(shares)[0]
    assert optimality_gap(other, INFO.matrices, "D", constraints) > 1e-3


def test_multipliers_are_the_worth_of_a_bound():
    constraints = CASES["time and experiments"]
    design = optimal_design(INFO, "D", constraints, solver="newton")
    longer = Constraints(experiments=15, time=401, durations=DURATIONS)
    gained = optimal_design(INFO, "D", longer, solver="newton").value - design.value
    worth = design.multipliers["time (400 s)"] * len(INFO.names)
    assert gained == pytest.approx(worth, rel=0.02)


def test_limits_of_one_keep_duplicates_apart():
    twice = information_set(np.repeat(INFO.matrices[:20], 2, axis=0))
    single = optimal_design(
        information_set(INFO.matrices[:20]), "D", Constraints(experiments=8, most=2)
    )
    double = optimal_design(twice, "D", Constraints(experiments=8, most=1))
    assert double.value == pytest.approx(single.value, abs=1e-6)


@pytest.mark.parametrize(
    ("constraints", "message"),
    [
        (Constraints(experiments=-1), "constraints: experiments: -1 is not a number > 0"),
        (Constraints(time=100), "constraints: time needs durations"),
        (Constraints(time=100, durations=0.0), "durations: 0 s of candidate 0 is not > 0"),
        (Constraints(most=[1, 2]), r"constraints: most: shape \(2,\)"),
        (Constraints(most=-1.0), "constraints: most: numbers >= 0"),
        (Constraints(forbidden=[Q]), r"constraints: forbidden: candidate 120 is not in 0\.\.119"),
        (Constraints(mandatory={3: -1.0}), "constraints: mandatory: -1.0 experiments"),
        (
            Constraints(experiments=5, mandatory={3: 1.0}, forbidden=[3]),
            "candidate 3: mandatory 1 experiments, but it is forbidden",
        ),
        (
            Constraints(experiments=5, mandatory={3: 3.0}, most=2),
            "candidate 3: mandatory 3 experiments, but most is 2",
        ),
        (
            Constraints(experiments=2, mandatory={3: 3.0}),
            r"mandatory experiments do not fit into experiments \(2\)",
        ),
        (
            Constraints(experiments=15, most=0.1),
            r"experiments \(15\): most and forbidden leave room for 12",
        ),
        (
            Constraints(experiments=5, groups={"wrist": Group([1, 2], least=6)}),
            r"no design satisfies experiments \(5\) together with groups: wrist \(least 6\)",
        ),
        (
            Constraints(
                experiments=9,
                groups={"all": Group(range(Q), most=3), "wrist": Group([1, 2], least=6)},
            ),
            r"no design satisfies groups: all \(most 3\) together with groups: wrist \(least 6\)$",
        ),
        (
            Constraints(groups={"wrist": Group([1, Q])}),
            "constraints: groups: wrist: candidate 120 is not in",
        ),
        (Constraints(linear={"a": (np.ones(3), 1.0)}), r"constraints: linear: a: shape \(3,\)"),
        (Constraints(linear={"a": (np.ones(Q), np.nan)}), "linear: a: bound nan is not a number"),
    ],
)
def test_constraints_that_do_not_fit(constraints, message):
    with pytest.raises(InvalidInput, match=message):
        optimal_design(INFO, "D", constraints)


def test_weights_that_violate_constraints_have_no_gap():
    with pytest.raises(InvalidInput, match="weights: they violate the constraints"):
        optimality_gap(np.ones(Q), INFO.matrices, "D", Constraints(experiments=5))
