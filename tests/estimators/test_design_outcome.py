import numpy as np
import pytest

from estimators import Uncertainty, compare_with_design
from robotmodels import InvalidInput, NotIdentifiable

NAMES = ("a", "b", "c")
ROOT = np.array([[1.0, 0, 0], [0.5, 0.2, 0], [0.1, -0.3, 0.01]])
PREDICTED = Uncertainty(NAMES, ROOT @ ROOT.T, "design")


def scatter(factor, n=60, seed=0):
    draws = factor * np.random.default_rng(seed).standard_normal((n, 3)) @ ROOT.T
    return Uncertainty(NAMES, np.cov(draws.T), "repeated")


def test_a_kept_promise_is_one_in_every_direction():
    found = compare_with_design(PREDICTED, PREDICTED)
    assert found.ratio == pytest.approx(np.ones(3))
    assert found.directions == pytest.approx(np.ones(3))
    assert found.efficiency == pytest.approx(1.0)
    assert found.as_predicted
    double = compare_with_design(PREDICTED, Uncertainty(NAMES, 4 * PREDICTED.covariance, ""))
    assert double.ratio == pytest.approx(2 * np.ones(3))
    assert double.efficiency == pytest.approx(0.25)
    assert not double.as_predicted
    assert "NOT as predicted" in str(double)


def test_samples_are_judged_by_chi_square():
    kept = [compare_with_design(PREDICTED, scatter(1.0, seed=s), 60) for s in range(200)]
    probabilities = np.array([f.probability for f in kept])
    assert 0.4 < probabilities.mean() < 0.6
    assert np.mean([f.as_predicted for f in kept]) > 0.98
    broken = [compare_with_design(PREDICTED, scatter(1.5, seed=s), 60) for s in range(50)]
    assert not any(f.as_predicted for f in broken)


def test_what_cannot_be_compared_is_named():
    with pytest.raises(InvalidInput, match="outcome: about a, the prediction about a, b, c"):
        compare_with_design(PREDICTED, Uncertainty(("a",), np.eye(1), ""))
    with pytest.raises(InvalidInput, match="samples: 1; at least 2"):
        compare_with_design(PREDICTED, PREDICTED, 1)
    with pytest.raises(NotIdentifiable, match="full rank"):
        compare_with_design(Uncertainty(NAMES, np.ones((3, 3)), ""), PREDICTED)
