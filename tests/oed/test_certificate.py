import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from random_candidates import quadratic_regression, random_set

from oed import efficiency_bound, optimal_design, optimality_gap
from robotmodels import InvalidInput


def plain_gap(weights, matrices):
    """Ten lines of numpy, no scaling, no tricks."""
    M = sum(w * H for w, H in zip(weights, matrices, strict=True))
    return max(np.trace(np.linalg.solve(M, H)) for H in matrices) / len(M) - 1


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), p=st.integers(1, 5), spare=st.integers(0, 6))
def test_gap_equals_the_plain_formula(seed, p, spare):
    info = random_set(seed, p + spare, p, p)
    weights = np.random.default_rng(seed).dirichlet(np.ones(len(info)))
    assert optimality_gap(weights, info.matrices) == pytest.approx(
        plain_gap(weights, info.matrices), rel=1e-6, abs=1e-8
    )


def test_kiefer_wolfowitz_known_optimum_has_no_gap():
    points = np.linspace(-1, 1, 201)
    weights = np.isin(np.arange(201), [0, 100, 200]) / 3
    assert abs(optimality_gap(weights, quadratic_regression(points).matrices)) < 1e-12


def test_equal_weights_have_a_gap():
    """Negative control: a certificate that is always small would prove nothing."""
    info = quadratic_regression(np.linspace(-1, 1, 201))
    assert optimality_gap(np.ones(201), info.matrices) > 0.5


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_efficiency_is_never_below_its_bound(seed):
    info = random_set(seed, 8, 3, 2)
    weights = np.random.default_rng(seed).dirichlet(np.ones(8))
    best = optimal_design(info, solver="newton").value
    value = np.linalg.slogdet(np.tensordot(weights, info.matrices, axes=1)).logabsdet
    efficiency = np.exp((value - best) / 3)
    gap = optimality_gap(weights, info.matrices)
    assert efficiency >= efficiency_bound(gap) * (1 - 1e-9)
    assert efficiency_bound(gap) >= np.exp(-gap)


def test_singular_design_has_an_infinite_gap():
    info = quadratic_regression(np.array([-1.0, 0.0, 1.0]))
    gap = optimality_gap(np.array([0.5, 0.5, 0.0]), info.matrices)
    assert gap == np.inf
    assert efficiency_bound(gap) == 0.0


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        ([1.0, 1.0], r"weights: shape \(2,\), one weight for each of 3"),
        ([1.0, -0.1, 1.0], "weights: -0.1 of candidate 1"),
        ([1.0, 1.0, np.nan], "weights: nan of candidate 2"),
        ([0.0, 0.0, 0.0], "weights: all are zero"),
    ],
)
def test_weights_that_are_none(weights, message):
    info = quadratic_regression(np.array([-1.0, 0.0, 1.0]))
    with pytest.raises(InvalidInput, match=message):
        optimality_gap(np.array(weights), info.matrices)


def test_certificate_needs_no_solver():
    code = (
        "import sys, oed.design.certificate\n"
        "sys.exit('cvxpy' in sys.modules or 'clarabel' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
