import numpy as np
import pytest
from hypothesis import given, strategies as st
from random_candidates import random_set

from oed.criteria.criteria import named_criterion
from oed.information_sets.candidates import sensitivities
from robotmodels import InvalidInput


@given(seed=st.integers(0, 10**6), p=st.integers(1, 6))
def test_d_gradient_is_the_directional_derivative(seed, p):
    first, second = random_set(seed, 2, p, p + 2).matrices
    d = named_criterion("D")
    h = 1e-6 * np.trace(first) / np.trace(second) / np.linalg.cond(first)
    difference = (d.value(first + h * second) - d.value(first - h * second)) / (2 * h)
    slope = sensitivities(d.gradient(first), second[None])[0]
    # Rounding of the two values, about 1e-16 of |log det| + cond, divided by h.
    noise = 1e-14 * (10 + abs(d.value(first))) / h
    assert difference == pytest.approx(slope, rel=1e-4, abs=noise)


def test_d_value_is_the_log_determinant_for_any_units():
    matrix = random_set(1, 1, 5, 7).matrices[0]
    scale = np.logspace(-6, 6, 5)
    d = named_criterion("D")
    assert d.value(matrix) == pytest.approx(np.linalg.slogdet(matrix).logabsdet, rel=1e-12)
    scaled = scale[:, None] * matrix * scale
    assert d.value(scaled) == pytest.approx(d.value(matrix) + 2 * np.log(scale).sum(), abs=1e-6)


def test_d_of_a_singular_matrix():
    singular = np.outer([1.0, 2.0, 3.0], [1.0, 2.0, 3.0])
    for matrix in (singular, np.zeros((3, 3)), np.diag([1.0, 1.0, 0.0])):
        assert named_criterion("D").value(matrix) == -np.inf
        assert np.isinf(named_criterion("D").gradient(matrix)).all()


def test_sensitivities_are_traces():
    info = random_set(2, 4, 3, 3)
    W = np.diag([1.0, 2.0, 3.0])
    expected = [np.trace(W @ H) for H in info.matrices]
    np.testing.assert_allclose(sensitivities(W, info.matrices), expected)


def test_unknown_criterion():
    with pytest.raises(InvalidInput, match=r"criterion 'd' is not known.*there are D, A, E"):
        named_criterion("d")
