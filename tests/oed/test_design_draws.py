"""Any problem, criterion, solver and form: an answer whose gap holds in 60 digits, or a refusal."""

import os
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np
import pytest
from design_draws import Draw, check_design, information, judged
from random_candidates import information_set, quadratic_regression, random_set

import oed
from robotmodels import NotIdentifiable

PERTURBATIONS = [0.0, 1e-13]
VANISHING_SHARE = 570
"""One of two candidates is all that the optimum needs."""
BEYOND_LIMITS = (154, 451, 575, 1729)
"""Rough first answers of conic solvers lie outside equations, with values above the optimum's."""
SEEDS = (VANISHING_SHARE, *BEYOND_LIMITS)
WAYS = [("newton", "primal"), ("cvxpy", "primal"), ("cvxpy", "dual")]


def failures(outcomes):
    return [f"{outcome.label}: {outcome.failure}" for outcome in outcomes if outcome.failure]


@pytest.mark.parametrize("perturbation", PERTURBATIONS)
def test_draws(perturbation):
    outcomes = [check_design(seed, perturbation) for seed in (*range(14), *SEEDS)]
    assert not failures(outcomes)


@pytest.mark.slow
@pytest.mark.parametrize("perturbation", PERTURBATIONS)
def test_two_thousand_draws(perturbation):
    check = partial(check_design, perturbation=perturbation)
    with ProcessPoolExecutor(min(os.cpu_count() or 1, 8)) as pool:
        outcomes = list(pool.map(check, range(2000), chunksize=20))
    assert not failures(outcomes)
    assert sum(outcome.refused for outcome in outcomes) < 100
    assert sum(outcome.singular for outcome in outcomes) > 20


def test_a_judge_that_is_fooled_judges_nothing():
    """Negative control: weights a percent off, and the witness of another design."""
    info = random_set(3, 30, 4, 2)
    options = {"solver": "newton", "form": "primal"}
    draw = Draw(0, "random", info.matrices, "D", [(1.0, "D", np.eye(4))], options)
    design = oed.optimal_design(info, **options)
    assert judged(draw, design)[0] == ""
    other = 0.99 * design.weights + 0.01 / len(info)
    object.__setattr__(design, "weights", other)
    assert "true gap" in judged(draw, design)[0]
    draw = Draw(0, "random", info.matrices, "E", [(1.0, "E", np.eye(4))], options)
    design = oed.optimal_design(info, "E")
    assert judged(draw, design)[0] == ""
    object.__setattr__(design, "witness", (np.eye(4) / 4,))
    assert "true gap" in judged(draw, design)[0]


# Each of these ended in an error, or in a wrong answer.


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("seed", range(3))
def test_nuisance_that_the_optimum_does_not_measure(way, seed):
    """Half of the candidates inform on the interest alone, and better."""
    rng = np.random.default_rng(seed)
    J = rng.standard_normal((40, 5, 1))
    J[:20, 2:] = 0.0
    J[:20] *= 10.0
    info = information_set(J @ np.swapaxes(J, 1, 2))
    for criterion in (oed.DsCriterion(("k0", "k1")), oed.AsCriterion(("k0", "k1"))):
        design = oed.optimal_design(info, criterion, solver=way[0], form=way[1])
        narrow = information_set(info.matrices[:20, :2, :2])
        alone = oed.optimal_design(narrow, criterion.name[0], solver="newton")
        assert design.value == pytest.approx(alone.value, rel=2e-6, abs=2e-6)
        assert design.weights[:20].sum() > 1 - 1e-4


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("factor", [1e-60, 1e60])
@pytest.mark.parametrize("kind", ["D", "A", "E", "D + E"])
def test_units_of_everything(way, factor, kind):
    info = random_set(4, 40, 4, 2)
    if "E" in kind and way[0] == "newton":
        pytest.skip("E is not smooth")
    criterion = oed.MixtureCriterion(("D", "E")) if kind == "D + E" else kind
    scaled = information_set(factor * info.matrices)
    one, other = (
        oed.optimal_design(each, criterion, solver=way[0], form=way[1]) for each in (info, scaled)
    )
    np.testing.assert_allclose(other.weights, one.weights, atol=1e-4)
    assert other.gap <= 1e-6


def spread(ratio, seed=0):
    """Return candidates with a nuisance parameter of sensitivity smaller by a ratio."""
    J = np.random.default_rng(seed).standard_normal((30, 3, 2))
    J[:, 2] /= ratio
    return information_set(J @ np.swapaxes(J, 1, 2))


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(
    "criterion", ["D", "A", oed.DsCriterion(("k0",)), oed.CCriterion([1, 1, 0])]
)
def test_sensitivities_that_rounding_hides_are_refused(way, criterion):
    said = "not identifiable: k2; sensitivities more than 2.8e.14 times smaller .* other units"
    with pytest.raises(NotIdentifiable, match=said):
        oed.optimal_design(spread(1e15), criterion, solver=way[0], form=way[1])
    design = oed.optimal_design(spread(1e14), criterion, solver=way[0], form=way[1])
    assert design.gap <= 1e-6
    if criterion != "A":  # whose units these are
        plain = oed.optimal_design(spread(1.0), criterion, solver="newton")
        np.testing.assert_allclose(design.weights, plain.weights, atol=1e-3)


def collinear(condition, seed=0):
    """Return candidates on two parameters that all together tell apart by so little."""
    rng = np.random.default_rng(seed)
    J = rng.standard_normal((30, 3, 1))
    J[:, 1] = J[:, 0] + J[:, 1] * 2 / np.sqrt(condition)
    return J @ np.swapaxes(J, 1, 2)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("criterion", ["D", oed.DsCriterion(("k2",))])
def test_parameters_that_cannot_be_told_apart_are_refused(way, criterion):
    said = r"not identifiable: k0, k1; all candidates together determine .* by less than 1/1e\+10"
    with pytest.raises(NotIdentifiable, match=said):
        oed.optimal_design(information(collinear(1e11)), criterion, solver=way[0], form=way[1])


@pytest.mark.parametrize("seed", range(5))
def test_as_far_as_certificates_reach(seed):
    """At a condition of some 1e9 gaps still hold in 60 digits."""
    H = collinear(1e9, seed)
    options = {"solver": "newton", "form": "primal"}
    for criterion, part in (
        ("D", ("D", np.eye(3))),
        (oed.DsCriterion(("k2",)), ("D", np.eye(3)[:, 2:])),
        (oed.CCriterion([1.0, 1.0, 0.0]), ("A", np.array([[1.0], [1.0], [0.0]]))),
    ):
        design = oed.optimal_design(information(H), criterion, **options)
        failure, gap, _ = judged(Draw(seed, "", H, criterion, [(1.0, *part)], options), design)
        assert not failure
        assert gap <= 1e-6


@pytest.mark.parametrize("way", WAYS)
def test_elfving_at_every_point(way):
    """c = f(x) of a cubic: at the ends of the interval, inside and outside of it."""
    x = np.linspace(-1, 1, 81)
    f = np.stack([x**k for k in range(4)], axis=1)
    info = information_set(f[:, :, None] * f[:, None, :])
    for at in (-1.0, -0.5, 0.0, 0.975, 1.0, 1.5):
        c = oed.CCriterion(np.array([at**k for k in range(4)]))
        design = oed.optimal_design(info, c, solver=way[0], form=way[1])
        assert design.gap <= 1e-6
        if abs(at) <= 1:  # one experiment there tells the mean there with variance one
            assert design.value >= -1 - 1e-6


def test_one_point_has_one_weight():
    """The full design's small weights go where the optimum is singular."""
    info = quadratic_regression(np.linspace(-1, 1, 201))
    design = oed.optimal_design(info, oed.CCriterion(np.array([1.0, 0, 0])), solver="newton")
    assert design.support.tolist() == [100]
    assert design.value == pytest.approx(-1.0, rel=1e-9)
    witnessed = oed.optimality_gap(
        design.weights, info.matrices, oed.CCriterion(np.array([1.0, 0, 0])), witness=design.witness
    )
    assert witnessed <= 1e-6
