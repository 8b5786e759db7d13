"""Runs that do not end as they began: transients as polynomials in blocks of dense lines."""

from dataclasses import replace

import numpy as np
import pytest
from derivatives import check_gradient
from sampled_runs import ANGLE, MODEL, TORQUE, TRUTH, sampled_records, shares

from estimators import fit, run_spectra
from estimators.fitting.run_problem import RunProblem
from robotmodels import InvalidInput

BOUNDS = np.outer([1e-3, 1e3], TRUTH)
OFF = TRUTH * np.exp(0.05 * np.cos(np.arange(6)))


def dense_runs(rng, samples=8192, states="polynomial"):
    records = sampled_records(rng, samples=samples)
    resonant = records.omega < 2 * np.pi * 13
    return run_spectra(
        replace(records, lines=records.lines[resonant]), (TORQUE, ANGLE), states=states
    )


def problem(data, weighting="joint"):
    return RunProblem(model=MODEL, data=data, weighting=weighting, bounds=BOUNDS)


@pytest.mark.parametrize("weighting", ["joint", "row_wise"])
def test_gradients_are_those_of_the_cost(weighting):
    check_gradient(problem(dense_runs(np.random.default_rng(1), 512), weighting), OFF)


def test_polynomials_of_any_size_cost_nothing():
    data = dense_runs(np.random.default_rng(2), 512)
    posed, lines = problem(data), np.arange(len(data.omega))
    block = posed.free_response(TRUTH).lines[2]
    step = np.where(np.isin(lines, block), 1.0 + lines - 0.1j * lines**2, 0.0)
    other = replace(data, outputs=data.outputs + 1e3 * step[:, None] * np.array([1.0, 2.0j]))
    before, after = (
        np.sum(np.abs(problem(one).errors(OFF).whitened) ** 2) for one in (data, other)
    )
    assert after == pytest.approx(before, rel=1e-7)
    cubic = replace(data, outputs=data.outputs + 1e3 * (step * lines)[:, None])
    assert np.sum(np.abs(problem(cubic).errors(OFF).whitened) ** 2) > 2 * before


def test_lines_that_are_not_dense_are_refused_by_name():
    with pytest.raises(InvalidInput, match=r"dense .* Hz is 0\.\d+ Hz wide, 1\d lines"):
        fit(MODEL, dense_runs(np.random.default_rng(3), 512))
    with pytest.raises(InvalidInput, match=r"'polynomials' is unknown .*; there are auto, yes, no"):
        dense_runs(np.random.default_rng(3), 512, "polynomials")


def fits(count, seed, states="polynomial"):
    rng = np.random.default_rng(seed)
    return (fit(MODEL, dense_runs(rng, states=states)) for _ in range(count))


def test_what_is_left_at_the_truth_is_noise():
    data = dense_runs(np.random.default_rng(4), 2048)
    cost, without = (
        np.sum(np.abs(problem(one).errors(TRUTH).whitened) ** 2)
        for one in (data, replace(data, polynomials=False))
    )
    assert cost == pytest.approx(problem(data).expected_cost, rel=0.1)
    assert without > 3 * cost  # the negative control


@pytest.mark.slow
def test_intervals_cover_in_100_studies():
    covers, cost = shares(fits(100, 5))
    assert 0.92 < covers.mean() < 0.98
    assert covers.mean(axis=0).min() > 0.88
    assert cost == pytest.approx(1.0, abs=0.01)
    assert shares(fits(10, 6, "no"))[0].mean() < 0.6  # the negative control
