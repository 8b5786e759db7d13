import cvxpy as cp
import numpy as np
import pytest

import oed
from oed import LineLimit, line_information, optimal_spectrum, speed_cost
from robotmodels import InvalidInput, NotIdentifiable, RelativeNoise, load_robot

Q, F, P = 6, 8, 3
RNG = np.random.default_rng(0)
NAMES = ("a", "b", "c")
LIMITS = {
    "power": LineLimit(np.ones(F), 1.0),
    "torque": LineLimit(RNG.uniform(0.1, 2, F), 0.7),
    "speed": LineLimit(np.exp(RNG.standard_normal((Q, F))), 0.6),
}


def random_lines(q, f, p, rank):
    J = RNG.standard_normal((q, f, p, rank)) * np.exp(RNG.standard_normal((q, f, 1, 1)))
    return J @ np.swapaxes(J, 2, 3)


LINES = random_lines(Q, F, P, 1)


def one_problem(limits, criterion, line_most=np.inf, prior=0.0):
    """Shares and powers at once: powers times shares are the variables."""
    w, power = cp.Variable(Q, nonneg=True), cp.Variable((Q, F), nonneg=True)
    flat = LINES.reshape(Q * F, -1)
    M = prior + cp.reshape(flat.T @ cp.vec(power, order="C"), (P, P), order="C")
    rules = [cp.sum(w) == 1]
    for limit in limits.values():
        cost = np.broadcast_to(limit.cost, (Q, F))
        rules.append(cp.sum(cp.multiply(cost, power), axis=1) <= limit.most * w)
    if np.isfinite(line_most):
        rules += [power[:, f] <= line_most * w for f in range(F)]
    goals = {
        "D": cp.log_det(M),
        "A": -cp.matrix_frac(np.eye(P), M),
        "E": cp.lambda_min(0.5 * (M + M.T)),
    }
    return cp.Problem(cp.Maximize(goals[criterion]), rules).solve(cp.CLARABEL)


@pytest.mark.parametrize("criterion", ["D", "A"])
@pytest.mark.parametrize("line_most", [np.inf, 0.3])
@pytest.mark.parametrize("names", [("power",), ("power", "torque", "speed")])
def test_spectra_against_one_convex_problem(names, line_most, criterion):
    limits = {name: LIMITS[name] for name in names}
    design = optimal_spectrum(LINES, NAMES, limits, criterion, line_most)
    best = one_problem(limits, criterion, line_most)
    assert design.value == pytest.approx(best, rel=2e-5)
    assert design.gap <= 1e-5
    assert design.weights.sum() == pytest.approx(1.0)
    used = design.weights > 0
    for limit in limits.values():
        cost = np.broadcast_to(limit.cost, (Q, F))
        assert (np.sum(cost * design.power, axis=1)[used] <= limit.most * (1 + 1e-6)).all()
    assert design.power.max() <= line_most * (1 + 1e-6)
    assert not design.power[~used].any()
    np.testing.assert_allclose(
        np.einsum("q,qf,qfab->ab", design.weights, design.power, LINES), design.information
    )
    np.testing.assert_allclose(design.amplitude**2 / 2, design.power)


@pytest.mark.parametrize("criterion", ["D", "E"])
@pytest.mark.parametrize("known", [0.0, 2.0])
def test_spectra_after_experiments_there_are_and_for_the_worst_combination(criterion, known):
    prior = known * np.diag([1.0, 0.1, 0.0])
    design = optimal_spectrum(LINES, NAMES, LIMITS, criterion, prior=prior)
    best = one_problem(LIMITS, criterion, prior=prior)
    assert design.value == pytest.approx(best, rel=2e-5, abs=2e-5)
    assert design.gap <= 1e-5
    assert f"{criterion}-optimal spectra in " in str(design)


def test_a_free_spectrum_beats_a_flat_one():
    design = optimal_spectrum(LINES, NAMES, LIMITS)
    assert 0.05 < design.uniform_efficiency < 0.9
    # Lines that are all alike leave nothing to choose.
    alike = np.repeat(LINES[:, :1], F, axis=1) + np.eye(P)
    same = optimal_spectrum(alike, NAMES, {"power": LIMITS["power"]})
    assert same.uniform_efficiency == pytest.approx(1.0, abs=1e-5)


def test_no_random_spectrum_is_better():
    """By another route: random spectra, scaled to the limits, in random shares."""
    design = optimal_spectrum(LINES, NAMES, LIMITS)
    costs = [np.broadcast_to(limit.cost / limit.most, (Q, F)) for limit in LIMITS.values()]
    for _ in range(100):
        power = RNG.dirichlet(0.3 * np.ones(F), Q)
        sums = [
            (c * power).sum(axis=1) / v.most for c, v in zip(costs, LIMITS.values(), strict=True)
        ]
        power /= np.max(sums, axis=0)[:, None]
        M = np.einsum("q,qf,qfab->ab", RNG.dirichlet(np.ones(Q)), power, LINES)
        assert np.linalg.slogdet(M).logabsdet <= design.value + 1e-6


def test_lines_of_a_robot():
    robot = load_robot("manutec_r3")
    positions = RNG.uniform(-1, 1, (3, 6))
    omega = 2 * np.pi * np.linspace(3, 40, 6)
    lines = line_information(robot, positions, omega, RelativeNoise())
    whole = oed.information(robot, positions, omega, RelativeNoise())
    np.testing.assert_allclose(lines.sum(axis=1), whole.matrices, rtol=1e-9, atol=1e-9)
    speed = speed_cost(robot, positions, omega)
    assert speed.shape == (6, 3, 6)
    limits = {"power": LineLimit(np.ones(6), 6.0), "speed": LineLimit(speed[0], speed[0].mean())}
    design = optimal_spectrum(lines, whole.names, limits)
    assert design.gap <= 1e-5
    assert design.uniform_efficiency < 1.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"lines": LINES[0]}, r"lines: shape \(8, 3, 3\); \(Q, F, 3, 3\) is needed"),
        ({"lines": -LINES}, "candidate 0 has a matrix that is not positive semidefinite"),
        ({"limits": {"x": LineLimit(np.ones(3), 1.0)}}, r"limits: x: cost of shape \(3,\)"),
        ({"limits": {"x": LineLimit(-np.ones(F), 1.0)}}, "limits: x: cost .* numbers >= 0"),
        ({"limits": {"x": LineLimit(np.ones(F), 0.0)}}, "limits: x: most: 0.0 is not a number > 0"),
        (
            {"limits": {"x": LineLimit(np.arange(F), 1.0)}},
            "limits: none holds for line 0 in position 0",
        ),
        ({"line_most": -1.0}, "line_most: -1.0 is not a number > 0"),
        ({"prior": np.eye(2)}, r"prior: shape \(2, 2\); finite numbers of shape \(3, 3\)"),
        ({"max_rounds": 0}, "max_rounds: 0; at least 1 is needed"),
    ],
)
def test_spectra_that_do_not_fit(change, message):
    arguments = {"lines": LINES, "names": NAMES, "limits": LIMITS} | change
    with pytest.raises(InvalidInput, match=message):
        optimal_spectrum(**arguments)


def test_lines_that_identify_nothing_are_named():
    blind = LINES.copy()
    blind[..., 1, :] = blind[..., :, 1] = 0.0
    with pytest.raises(NotIdentifiable, match="not identifiable: b; add positions or lines"):
        optimal_spectrum(blind, NAMES, LIMITS)
