"""The least time to stated standard deviations, against one convex problem and by its dual."""

import cvxpy as cp
import numpy as np
import pytest

import oed
from oed.criteria.targets import by_name_or_kind
from robotmodels import InvalidInput, NotIdentifiable

NAMES = ("g1.stiffness", "g2.stiffness", "g1.damping", "g2.damping")
TARGETS = {"stiffness": 0.01, "damping": 0.05}
GOALS = np.array([0.01, 0.01, 0.05, 0.05])


def problem(seed, q=40):
    rng = np.random.default_rng(seed)
    J = rng.standard_normal((q, 4, 3)) * np.array([30.0, 10.0, 3.0, 1.0])[:, None]
    matrices = J @ np.swapaxes(J, 1, 2)
    return oed.InformationSet(np.zeros((q, 1)), matrices, NAMES), rng.uniform(20, 200, q)


def least_time(info, duration, prior):
    """One problem by Clarabel: Schur complements of every target."""
    w = cp.Variable(len(info), nonneg=True)
    units = np.diag(GOALS)
    H = np.array([units @ one @ units for one in info.matrices])
    M = cp.reshape(H.reshape(len(H), -1).T @ w, (4, 4), order="C") + units @ prior @ units
    rules = []
    for i in range(4):
        e = np.eye(4)[:, [i]]
        rules.append(cp.bmat([[0.5 * (M + M.T), e], [e.T, np.ones((1, 1))]]) >> 0)
    return cp.Problem(cp.Minimize(duration @ w), rules).solve(cp.CLARABEL)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("before", [0.0, 0.3, 0.9])
def test_least_time_is_that_of_one_convex_problem(seed, before):
    info, duration = problem(seed)
    prior = before * np.diag(1 / GOALS**2)
    design = oed.fastest_design(info, duration, TARGETS, prior=prior)
    assert design.time == pytest.approx(least_time(info, duration, prior), rel=1e-5)
    assert design.bound <= design.time <= (1 + 1e-6) * design.bound
    M = np.einsum("q,qab->ab", design.weights, info.matrices) + prior
    std = np.sqrt(np.diag(np.linalg.inv(M)))
    assert (std / GOALS).max() == pytest.approx(1.0, abs=1e-9)
    assert duration @ design.weights == pytest.approx(design.time)
    assert "min, no visits do in less than" in str(design)


@pytest.mark.parametrize("share", [0.0, 1e-20])
def test_targets_that_only_the_prior_tells(share):
    """No time adds to what the prior says of a parameter that no candidate shows."""
    matrices = np.array([np.diag([1.0, share]), np.diag([2.0, share])])
    info = oed.InformationSet(np.zeros((2, 1)), matrices, ("g1.stiffness", "g2.stiffness"))
    prior = np.diag([4.0, 4.0])
    message = r"g2.stiffness \(not below 0.5, 0.1 asked for\); no time suffices"
    with pytest.raises(NotIdentifiable, match=message):
        oed.fastest_design(info, 1.0, {"stiffness": 0.1}, prior)
    reached = oed.fastest_design(info, 1.0, {"g1.stiffness": 0.1, "g2.stiffness": 0.6}, prior)
    assert reached.time == pytest.approx((100 - 4) / 2)


@pytest.mark.parametrize("seed", range(3))
def test_any_dual_point_bounds_the_time_from_below(seed):
    """T >= sum mu (2 x_ii - s_i^2) / max sum mu x' H x / t at random mu and x: never above."""
    info, duration = problem(seed)
    design = oed.fastest_design(info, duration, TARGETS)
    rng = np.random.default_rng(seed)
    C = np.linalg.inv(design.information)
    for spread in (0.0, 0.1, 1.0):
        X = C * np.exp(spread * rng.standard_normal((4, 4)))
        mu = rng.uniform(0, 1, 4) / GOALS**2
        above = mu @ (2 * np.diag(X) - GOALS**2)
        below = np.einsum("i,ai,qab,bi->q", mu, X, info.matrices, X) / duration
        assert above / below.max() <= design.time * (1 + 1e-9)


def test_nothing_is_left_to_do_and_nuisance_does_not_count():
    info, duration = problem(0)
    reached = oed.fastest_design(info, duration, TARGETS, prior=2 * np.diag(1 / GOALS**2))
    assert reached.time == reached.gap == 0.0
    assert not len(reached.support)
    some = oed.fastest_design(info, duration, {"g1.stiffness": 0.01})
    assert some.time < oed.fastest_design(info, duration, TARGETS).time
    blind = np.array(info.matrices)
    blind[:, 3, :] = blind[:, :, 3] = 0.0
    blind = oed.InformationSet(info.positions, blind, NAMES)
    assert oed.fastest_design(blind, duration, {"g1.stiffness": 0.01}).gap < 1e-6
    with pytest.raises(NotIdentifiable, match=r"g2\.damping"):
        oed.fastest_design(blind, duration, TARGETS)


def test_every_sample_of_theta_has_its_targets():
    first, duration = problem(0)
    second, _ = problem(1)
    both = oed.InformationSamples((first, second))
    design = oed.fastest_design(both, duration, TARGETS)
    for info in (first, second):
        M = np.einsum("q,qab->ab", design.weights, info.matrices)
        assert (np.sqrt(np.diag(np.linalg.inv(M))) / GOALS).max() <= 1 + 1e-9
        assert oed.fastest_design(info, duration, TARGETS).time <= design.time * (1 + 1e-6)


def test_targets_by_name_kind_and_pattern():
    values = {"g1.*": 3.0, "damping": 2.0, "g1.stiffness": 1.0}
    assert by_name_or_kind(values, NAMES, "x")[[0, 3]].tolist() == [1.0, 2.0]
    assert np.isnan(by_name_or_kind({"damping": 1.0}, NAMES, "x")[:2]).all()
    info, duration = problem(0)
    for targets, message in (
        ({"stifness": 0.1}, "targets: 'stifness' is no free parameter and no kind of them.*stiffn"),
        ({"g1.stiffness": 0.0}, "targets: g1.stiffness: 0.0"),
        ({}, "targets: none given"),
        (-1.0, "targets: -1.0"),
    ):
        with pytest.raises(InvalidInput, match=message):
            oed.fastest_design(info, duration, targets)
    with pytest.raises(InvalidInput, match="durations: 0 s of candidate 0"):
        oed.fastest_design(info, 0.0 * duration, TARGETS)
