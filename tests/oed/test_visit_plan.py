"""Whole visits within minutes and to targets, against every plan there is."""

from itertools import pairwise, product

import numpy as np
import pytest

import oed
from oed.exact.visit_bound import VisitBound
from robotmodels import InvalidInput, NotIdentifiable

NAMES = ("g1.stiffness", "g1.damping")
TIMING = oed.VisitTiming(period=10.0, transient=5.0, settle=4.0, move=6.0)
TARGETS = {"stiffness": 0.02, "damping": 0.05}
GOALS = np.array([0.02, 0.05])


def candidates(seed, q=3, periods=(1, 2), p=2):
    """Visits of one run each in q positions, of a random information a period."""
    rng = np.random.default_rng(seed)
    J = rng.standard_normal((q, p, p)) * np.array([15.0, 6.0, 3.0])[:p, None]
    matrices = J @ np.swapaxes(J, 1, 2)
    names = (*NAMES, "g2.damping")[:p]
    positions = np.arange(2.0 * q).reshape(q, 2)
    repeated = np.concatenate([count * matrices for count in periods])
    return oed.ExperimentCandidates(
        positions,
        (oed.Zippered(),),
        periods,
        TIMING,
        oed.InformationSet(np.tile(positions, (len(periods), 1)), repeated, names),
        np.repeat([TIMING.duration(1, count) for count in periods], q),
    )


def every_plan(table, most):
    """Return information and time of all plans of up to `most` periods in each position."""
    q = len(table.positions)
    periods = np.array(list(product(range(most + 1), repeat=q)))
    visits = -(-periods // max(table.periods))
    total = np.tensordot(periods, table.information.matrices[:q], axes=1)
    return total, (15.0 * visits + 10 * periods).sum(axis=1)


@pytest.mark.parametrize("seed", range(4))
def test_plans_within_a_time_against_every_plan(seed):
    table, time = candidates(seed), 130.0
    plan = oed.visit_plan(table, time)
    information, times = every_plan(table, 9)
    best = np.log(np.linalg.det(information[times <= time]).max())
    reached = np.exp((np.linalg.slogdet(plan.information).logabsdet - best) / 2)
    assert plan.duration <= time
    assert plan.efficiency - 1e-6 <= reached <= 1 + 1e-9
    assert reached > 0.93
    assert plan.duration == sum(TIMING.duration(1, count) for _, _, count in plan.visits)
    np.testing.assert_allclose(plan.std, np.sqrt(np.diag(np.linalg.inv(plan.information))))
    assert "visits in 2.17 min" in str(plan) or plan.duration < 130


@pytest.mark.parametrize("seed", range(4))
def test_plans_to_targets_against_every_plan(seed):
    table = candidates(seed)
    plan = oed.fastest_visit_plan(table, TARGETS)
    assert (plan.std <= GOALS * (1 + 1e-9)).all()
    information, times = every_plan(table, 14)
    some = np.linalg.cond(information) < 1e12
    variances = np.einsum("iaa->ia", np.linalg.inv(information[some]))
    least = times[some][(variances <= GOALS**2).all(axis=1)].min()
    assert plan.efficiency <= min(least, plan.duration) / plan.duration + 1e-9
    assert plan.duration <= 1.2 * least
    relaxed = oed.fastest_design(table.information, table.duration, TARGETS)
    assert plan.efficiency >= relaxed.bound / plan.duration - 1e-6


def test_visits_in_one_position_need_one_move():
    plan = oed.visit_plan(candidates(1), 400.0)
    positions = [position for position, _, _ in plan.visits]
    moves = 1 + sum(one != other for one, other in pairwise(positions))
    assert moves < len(positions)
    measured = sum(TIMING.duration(1, count) - TIMING.move for _, _, count in plan.visits)
    assert plan.duration - plan.shared_moves == pytest.approx(measured + moves * TIMING.move)
    assert "s less where visits share a position" in str(plan)


@pytest.mark.parametrize("seed", range(4))
def test_whole_visits_are_bounded_by_whole_periods(seed):
    """In 130 s, 35 s for visits of two periods: 7 whole periods, or 7.43."""
    table = candidates(seed)
    plan = oed.visit_plan(table, 130.0)
    limits = oed.Constraints(time=130.0, durations=table.duration)
    relaxed = oed.optimal_design(table.information, "D", limits, solver="newton")
    divisible = np.exp((np.linalg.slogdet(plan.information).logabsdet - relaxed.value) / 2)
    assert plan.efficiency == pytest.approx(min(1.0, divisible * 2 * 130 / 35 / 7), rel=1e-5)


@pytest.mark.parametrize("seed", range(5))
def test_bound_of_visits_against_every_number_of_them(seed):
    rng = np.random.default_rng(seed)
    gains, setup, period = rng.uniform(0.2, 1, 2), rng.uniform(5, 15, 2), rng.uniform(5, 15, 2)
    bound = VisitBound(gains, setup, period, 3, before=0.4, log_polar=np.log(5.0))
    visits, periods = np.meshgrid(np.arange(9), np.arange(28), indexing="ij")
    reach = periods <= 3 * visits
    one = [(s * visits + t * periods)[reach] for s, t in zip(setup, period, strict=True)]
    each = [(g * periods)[reach] for g in gains]
    times, values = np.add.outer(*one), 0.4 + np.add.outer(*each)
    for time in (40.0, 90.0, 120.0):
        assert bound.log_value(time) == pytest.approx(
            np.log(values[times <= time].max() / 5), abs=1e-5
        )
    assert bound.least_time() == pytest.approx(times[values >= 5].min(), rel=1e-5)


def test_what_is_reached_already_takes_no_time():
    plan = oed.fastest_visit_plan(candidates(0), TARGETS, prior=2 * np.diag(1 / GOALS**2))
    assert plan.duration == 0.0
    assert plan.efficiency == 1.0
    assert plan.visits == []
    part = oed.fastest_visit_plan(candidates(0), TARGETS, prior=0.5 * np.diag(1 / GOALS**2))
    assert 0 < part.duration < oed.fastest_visit_plan(candidates(0), TARGETS).duration


def test_more_minutes_buy_accuracy():
    table = candidates(1, q=12, periods=(1, 4), p=3)
    curve = oed.time_curve(table, [120.0, 480.0, 1920.0])
    assert curve.std.shape == (3, 3)
    assert (np.diff(curve.std.max(axis=1)) < 0).all()
    # The bound is that of a continuum of visits, so long plans come close to it.
    assert curve.plans[-1].efficiency > 0.95
    assert str(curve).count("min: ") == 3
    targeted = oed.time_curve(table, [480.0], oed.TargetCriterion(0.1)).plans[0]
    assert targeted.std.max() <= curve.plans[1].std.max() * (1 + 1e-9)


def test_times_that_do_not_fit():
    table = candidates(0)
    with pytest.raises(
        InvalidInput, match=r"time: 20 s is less than the shortest visit, 25 s \(zippered, 1 per"
    ):
        oed.visit_plan(table, 20.0)
    with pytest.raises(InvalidInput, match="times: none given"):
        oed.time_curve(table, [])
    with pytest.raises(InvalidInput, match=r"time \[s\]: -1.0"):
        oed.visit_plan(table, -1.0)
    blind = table.information.matrices * np.array([1.0, 0.0])[:, None] * np.array([1.0, 0.0])
    info = oed.InformationSet(table.information.positions, blind, NAMES)
    table = oed.ExperimentCandidates(
        table.positions, table.excitations, table.periods, TIMING, info, table.duration
    )
    with pytest.raises(NotIdentifiable, match=r"g1\.damping"):
        oed.fastest_visit_plan(table, TARGETS)


def of_samples(seed):
    """The same visits for three values of the parameters."""
    return oed.ExperimentCandidates.of_samples([candidates(seed + 10 * k) for k in range(3)])


@pytest.mark.parametrize("kind", ["average", "maximin"])
@pytest.mark.parametrize("seed", range(3))
def test_plans_over_samples_of_theta_against_every_plan(seed, kind):
    table, time = of_samples(seed), 130.0
    plan = oed.visit_plan(table, time, kind=kind)
    assert plan.information.shape == (3, 2, 2)
    parts = [every_plan(candidates(seed + 10 * k), 9) for k in range(3)]
    fits = parts[0][1] <= time
    values = np.stack([np.linalg.slogdet(total[fits]).logabsdet / 2 for total, _ in parts])
    limits = oed.Constraints(time=time, durations=table.duration)
    best = [
        oed.optimal_design(
            candidates(seed + 10 * k).information, "D", limits, solver="newton"
        ).value
        for k in range(3)
    ]
    efficiencies = values - np.array(best)[:, None] / 2
    own = np.linalg.slogdet(plan.information).logabsdet / 2 - np.array(best) / 2
    combine = np.mean if kind == "average" else np.min
    reached = np.exp(combine(own) - combine(efficiencies, axis=0).max())
    assert plan.duration <= time
    assert plan.efficiency - 1e-6 <= reached <= 1 + 1e-9
    assert reached > 0.93


@pytest.mark.parametrize("kind", ["maximin", "average"])
@pytest.mark.parametrize("seed", range(3))
def test_targets_are_reached_at_every_sample_of_theta_or_on_average(seed, kind):
    def reach(variances):  # (K, n, 2)
        ratio = variances / GOALS**2
        over = ratio.max(axis=0) if kind == "maximin" else np.exp(np.log(ratio).mean(axis=0))
        return (over <= 1 + 1e-9).all(axis=1)

    targets = oed.TargetCriterion(TARGETS, kind=kind)
    plan = oed.fastest_visit_plan(of_samples(seed), targets)
    assert reach(np.linalg.inv(plan.information).diagonal(axis1=1, axis2=2)[:, None]).all()
    parts = [every_plan(candidates(seed + 10 * k), 14) for k in range(3)]
    totals = np.stack([total for total, _ in parts])
    some = (np.linalg.cond(totals) < 1e12).all(axis=0)
    reached = reach(np.einsum("kiaa->kia", np.linalg.inv(totals[:, some])))
    least = parts[0][1][some][reached].min()
    assert plan.efficiency <= min(least, plan.duration) / plan.duration + 1e-9
    assert plan.duration <= 1.2 * least
    relaxed = oed.fastest_design(plan.candidates.information, plan.candidates.duration, targets)
    assert relaxed.gap <= 1e-6
    assert relaxed.bound <= least * (1 + 1e-9)


def test_samples_that_do_not_fit():
    with pytest.raises(InvalidInput, match="samples: tables of other visits"):
        oed.ExperimentCandidates.of_samples([candidates(0), candidates(0, q=2)])
    with pytest.raises(InvalidInput, match="samples: no table given"):
        oed.ExperimentCandidates.of_samples([])
    with pytest.raises(InvalidInput, match="kind 'worst' is unknown"):
        oed.visit_plan(of_samples(0), 130.0, kind="worst")
    with pytest.raises(InvalidInput, match="kind 'mean' is unknown"):
        oed.fastest_visit_plan(of_samples(0), oed.TargetCriterion(0.1, kind="mean"))
    with pytest.raises(InvalidInput, match="the least of several values, which holds at every"):
        oed.visit_plan(of_samples(0), 130.0, oed.TargetCriterion(TARGETS), kind="maximin")
