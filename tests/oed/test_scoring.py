import numpy as np
import pytest
from random_candidates import quadratic_regression, random_set

from oed import InformationSamples, score
from robotmodels import InvalidInput, NotIdentifiable

LINE = quadratic_regression(np.linspace(-1, 1, 5))


def test_a_plan_of_known_efficiency():
    """Quadratic regression: det of {-1, 0, 1} is 4/27, the best; of {-1, -1/2, 1} less."""
    best = score(LINE, [0, 2, 4])
    assert best.efficiency == pytest.approx(1.0, abs=1e-5)
    np.testing.assert_allclose(best.std, np.sqrt([1.0, 0.5, 1.5]))
    points = np.array([-1.0, -0.5, 1.0])
    worse = score(LINE, [0, 1, 4])
    det = np.linalg.det(np.vander(points)) ** 2 / 27
    assert worse.efficiency == pytest.approx((det / (4 / 27)) ** (1 / 3), abs=1e-5)
    assert worse.to_dict().keys() == set(LINE.names)


def test_positions_and_repetitions():
    by_index = score(LINE, [0, 2, 4], [2, 1, 1])
    by_position = score(LINE, LINE.positions[[0, 0, 2, 4]])
    np.testing.assert_array_equal(by_index.plan.repetitions, [2, 0, 1, 0, 1])
    np.testing.assert_array_equal(by_position.plan.repetitions, by_index.plan.repetitions)


def test_additions_and_losses_are_those_of_plain_determinants():
    info = random_set(4, 40, 3, 2)
    judged = score(info, [1, 2, 3], additions=4)
    total = judged.plan.information
    gains = np.cbrt(np.linalg.det(total + info.matrices) / np.linalg.det(total))
    order = np.argsort(-gains)[:4]
    assert [a.candidate for a in judged.additions] == order.tolist()
    np.testing.assert_allclose([a.gain for a in judged.additions], gains[order])
    first = np.linalg.inv(total + info.matrices[order[0]])
    assert judged.additions[0].largest_std == pytest.approx(np.sqrt(np.diag(first)).max())
    losses = np.cbrt(np.linalg.det(total - info.matrices[[1, 2, 3]]) / np.linalg.det(total))
    np.testing.assert_allclose(judged.losses, losses)
    assert (score(LINE, [0, 2, 4]).losses == 0).all()


def test_samples_are_scored_by_position_index():
    samples = InformationSamples((random_set(1, 6, 2, 2), random_set(2, 6, 2, 2)))
    from oed import MaximinCriterion

    judged = score(samples, [0, 1, 2], criterion=MaximinCriterion())
    assert 0 < judged.efficiency <= 1


@pytest.mark.parametrize(
    ("plan", "repetitions", "message"),
    [
        ([0, 5], None, r"plan: candidate 5 is not in 0\.\.4"),
        ([], None, r"plan: shape \(0,\)"),
        ([0.5, 1], None, r"plan: shape \(2,\); \(k,\) indices"),
        ([0, 2, 4], [1, 0, 1], "repetitions: .*3 whole numbers >= 1"),
        ([0, 2, 4], [1, 1], "repetitions: .*3 whole numbers >= 1"),
        ([[0.0], [9.0]], None, "plan: position 1: .*nearest is candidate 4, .* 5 away"),
        ([[0.0, 1.0]], None, r"positions of shape \(1, 2\); \(k, 1\)"),
    ],
)
def test_plans_that_are_none(plan, repetitions, message):
    with pytest.raises(InvalidInput, match=message):
        score(LINE, plan, repetitions)


def test_a_singular_plan_is_refused():
    with pytest.raises(NotIdentifiable, match="2 experiments are too few, 3 are needed"):
        score(LINE, [0, 4])
    with pytest.raises(NotIdentifiable, match="in other positions 3 experiments suffice"):
        score(LINE, [0, 4], [2, 2])
