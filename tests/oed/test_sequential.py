import numpy as np
import pytest
from random_candidates import quadratic_regression, random_set

from oed import experiment_curve, experiments_needed, measured_information, next_experiments
from robotmodels import InvalidInput, NotIdentifiable

LINE = quadratic_regression(np.linspace(-1, 1, 5))


def test_two_stages_come_close_to_one():
    """Whatever was measured first, the next experiments make up for it as far as possible."""
    info = random_set(3, 60, 4, 3)
    first = np.bincount([5, 6, 7, 8], minlength=60)
    known = measured_information(info, first)
    result = next_experiments(info, 6, known)
    np.testing.assert_allclose(
        result.plan.information, known + measured_information(info, result.plan.repetitions)
    )
    np.testing.assert_allclose(result.before, np.sqrt(np.diag(np.linalg.inv(known))))
    np.testing.assert_allclose(
        result.after, np.sqrt(np.diag(np.linalg.inv(result.plan.information)))
    )
    assert (result.after < result.before).all()
    rng = np.random.default_rng(0)
    best = np.linalg.slogdet(result.plan.information).logabsdet
    for _ in range(200):
        other = measured_information(info, np.bincount(rng.integers(0, 60, 6), minlength=60))
        assert np.linalg.slogdet(known + other).logabsdet < best + 1e-9


def test_next_experiments_without_any_before():
    result = next_experiments(LINE, 3)
    np.testing.assert_array_equal(result.plan.repetitions, [1, 0, 1, 0, 1])
    assert np.isinf(result.before).all()


def test_what_is_known_of_some_parameters_is_not_lost():
    """Two points of a parabola tell its slope, and of value and curvature only the sum."""
    known = measured_information(LINE, [1, 0, 0, 0, 1])
    before = next_experiments(LINE, 3, known).before
    np.testing.assert_array_equal(np.isinf(before), [True, False, True])
    assert before[1] == pytest.approx(np.sqrt(1 / 2))


def test_curve_of_a_known_design():
    """At n/3 experiments in each of -1, 0, 1 variances are 3/n, 3/(2n), 9/(2n)."""
    curve = experiment_curve(LINE, [1, 2, 3, 6, 30])
    assert curve.counts.tolist() == [3, 6, 30]
    for n, std in zip(curve.counts, curve.std, strict=True):
        np.testing.assert_allclose(std**2, np.array([3, 1.5, 4.5]) / n)
    np.testing.assert_allclose(curve.efficiency, 1.0, atol=1e-5)
    with pytest.raises(NotIdentifiable, match="2 experiments are too few"):
        experiment_curve(LINE, [1, 2])
    with pytest.raises(InvalidInput, match="counts: none given"):
        experiment_curve(LINE, [])


def test_how_many_for_a_wanted_accuracy():
    """The curvature's variance 9/(2n) is the largest: 450 experiments for a std of 0.1."""
    needed = experiments_needed(LINE, 0.1)
    assert needed.n_experiments == 450
    assert needed.critical == "k2"
    assert needed.std.max() == pytest.approx(0.1)
    fewer = experiments_needed(LINE, 0.1, parameters=["k0", "k1"])
    assert fewer.n_experiments == pytest.approx(300, abs=2)
    assert fewer.critical == "k0"
    done = experiments_needed(LINE, 0.1, measured_information(LINE, [150, 0, 150, 0, 150]))
    assert done.n_experiments == 0
    assert done.plan is None


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"std": 0.0}, "std .*: 0.0 is not a number > 0"),
        ({"std": 0.1, "most": 100}, "out of reach of 100 experiments: 'k2' comes to 0.21"),
        ({"std": 0.1, "parameters": ["k3"]}, "parameters: 'k3' is unknown"),
        ({"std": 0.1, "parameters": []}, "parameters: none given"),
    ],
)
def test_bad_wishes(entries, message):
    with pytest.raises(InvalidInput, match=message):
        experiments_needed(LINE, **entries)


def test_measured_numbers_must_fit():
    with pytest.raises(InvalidInput, match=r"repetitions: shape \(2,\); 5 numbers"):
        measured_information(LINE, [1, 2])
