"""Arguments that few callers give: prior information, limits and criteria, one judge for each."""

from itertools import combinations_with_replacement

import numpy as np
import pytest
from collision_arm import arm
from random_candidates import random_set

import oed
from robotmodels import RelativeNoise

P = 3
INFO = random_set(5, 12, P, 2)
PRIOR = np.diag([4.0, 1.0, 9.0])


def log_det(counts, prior=PRIOR):
    return np.linalg.slogdet(prior + np.tensordot(counts, INFO.matrices, axes=1)).logabsdet


def test_the_gap_of_a_design_after_earlier_experiments():
    """Kiefer and Wolfowitz with a prior: max tr(M^-1 H) + tr(M^-1 M_0) = p at the optimum."""
    design = oed.optimal_design(INFO, "D", prior=PRIOR, solver="newton")
    M_inverse = np.linalg.inv(PRIOR + np.tensordot(design.weights, INFO.matrices, axes=1))
    largest = np.einsum("ab,iba->i", M_inverse, INFO.matrices).max()
    expected = (largest + np.trace(M_inverse @ PRIOR)) / P - 1
    gap = oed.optimality_gap(design.weights, INFO.matrices, prior=PRIOR)
    assert gap == pytest.approx(expected, abs=1e-9)
    assert gap < 1e-6
    assert oed.optimality_gap(design.weights, INFO.matrices) > 1e-3


def test_the_best_plan_after_earlier_experiments_is_that_of_enumeration():
    plans = [
        np.bincount(plan, minlength=len(INFO))
        for plan in combinations_with_replacement(range(len(INFO)), 2)
    ]
    best = max(plans, key=log_det)
    found = oed.best_plans(INFO, 2, prior=PRIOR)
    assert found.proven
    assert found.plans[0].repetitions.tolist() == best.tolist()
    assert max(plans, key=lambda plan: log_det(plan, 1e-9 * PRIOR)).tolist() != best.tolist()


def test_a_score_counts_earlier_experiments():
    score = oed.score(INFO, [1, 4], prior=PRIOR)
    total = PRIOR + INFO.matrices[1] + INFO.matrices[4]
    np.testing.assert_allclose(score.std, np.sqrt(np.diag(np.linalg.inv(total))), rtol=1e-10)


def test_a_score_takes_the_relaxed_design_that_there_is():
    design = oed.optimal_design(INFO, "D", solver="newton")
    with_design = oed.score(INFO, [1, 4, 7], design=design)
    assert with_design.efficiency == pytest.approx(oed.score(INFO, [1, 4, 7]).efficiency, rel=1e-5)


def test_a_curve_has_the_plans_of_its_numbers():
    limits = oed.Constraints(most=1)
    calls = []
    curve = oed.experiment_curve(
        INFO,
        [4, 2],
        PRIOR,
        criterion="A",
        constraints=limits,
        progress=lambda done, total: calls.append((done, total)),
    )
    assert calls == [(1, 2), (2, 2)]
    assert curve.counts.tolist() == [2, 4]
    for plan, n in zip(curve.plans, (2, 4), strict=True):
        assert plan.n_experiments == n
        assert plan.repetitions.max() == 1
        total = PRIOR + np.tensordot(plan.repetitions, INFO.matrices, axes=1)
        np.testing.assert_allclose(plan.information, total)
        assert plan.criterion == "A"
    assert (np.diff(curve.std, axis=0) < 0).all()


@pytest.mark.parametrize("tolerance", [1e-2, 1e-7])
def test_sensors_are_chosen_with_designs_of_the_tolerance(tolerance):
    added = oed.InformationSet(INFO.positions, random_set(6, 12, P, 1).matrices, INFO.names)
    chosen = oed.optimal_sensors(INFO, {"a": oed.Sensor(added)}, 1.0, tolerance=tolerance)
    assert chosen.design.gap <= tolerance


def test_a_refined_design_keeps_to_ranges_criterion_and_earlier_experiments(tmp_path):
    robot, omega, noise = arm(tmp_path), 2 * np.pi * np.array([3.0, 9.0, 20.0]), RelativeNoise(0.03)
    limits = np.array([[0.0, 0.0], [-0.6, 0.6], [0.3, 1.2]])
    positions = oed.candidate_positions(robot, [1, 2, 2], limits)
    info = oed.information(robot, positions, omega, noise)
    options = {"limits": limits, "criterion": "A", "finer": 8, "max_rounds": 2}
    plain = oed.refined_design(robot, info, omega, noise, **options)
    reached = plain.candidates.positions
    assert ((reached >= limits[:, 0] - 1e-12) & (reached <= limits[:, 1] + 1e-12)).all()
    assert plain.design.criterion == "A"
    certain = 1e6 * info.total
    late = oed.refined_design(robot, info, omega, noise, prior=certain, **options)
    assert late.gain < 1e-4


def test_progress_of_task_space_positions_ends_at_the_number_of_points(tmp_path):
    box = oed.TaskBox("hand", (0.4, 0.0, 0.4), (0.5, 0.0, 0.5), (2, 1, 2), solutions=1)
    calls = []
    oed.task_space_positions(
        arm(tmp_path), box, np.random.default_rng(0), lambda *numbers: calls.append(numbers)
    )
    assert calls == [(1, 4), (2, 4), (3, 4), (4, 4)]
