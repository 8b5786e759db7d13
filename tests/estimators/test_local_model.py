from dataclasses import replace

import numpy as np
import pytest
from closed_loop import LINES, SAMPLE_TIME, SAMPLES, Bench, bench_records, truth
from derivatives import circular

from estimators import local_frf
from estimators.frf.local_rational_model import one_line
from robotmodels import InvalidInput

OMEGA = 2 * np.pi * LINES / (SAMPLES * SAMPLE_TIME)


def relative(found):
    G = truth(OMEGA)
    return np.abs(found.response[0] - G).max(axis=(1, 2)) / np.abs(G).max(axis=(1, 2))


def one_experiment(**setup):
    return bench_records(Bench(**({"experiments": 1, "periods": 1, "blocks": 1} | setup)))


def test_one_experiment_serves_two_motors():
    found = local_frf(one_experiment(), order=2, denominator=2)
    assert np.median(relative(found)) < 0.01
    assert found.repetitions.tolist() == [1]


def test_a_denominator_follows_a_resonance():
    records = one_experiment(blocks=2)
    polynomial = local_frf(records, order=2, half_width=4)
    ratio = local_frf(records, order=2, denominator=2, half_width=4)
    assert relative(ratio).max() < 0.5 * relative(polynomial).max()


@pytest.mark.parametrize(("order", "denominator"), [(1, 0), (2, 0), (2, 1), (2, 2)])
def test_models_within_reach_are_found_exactly(order, denominator):
    rng = np.random.default_rng(1)
    step = np.linspace(-1, 1, 15)
    top = circular(rng, order + 1, 3, 2)
    bottom = np.concatenate([[1.0], 0.3 * circular(rng, denominator)])
    G = np.tensordot(step[:, None] ** np.arange(order + 1), top, 1)
    G = G / (step[:, None] ** np.arange(denominator + 1) @ bottom)[:, None, None]
    U = circular(rng, 15, 2, 1)
    found, covariance, _ = one_line(G @ U, U, step, order, denominator)
    assert np.allclose(found, top[0], atol=1e-9)
    assert np.abs(covariance).max() < 1e-18


@pytest.mark.parametrize("denominator", [0, 1])
def test_covariance_is_that_of_the_scatter(denominator):
    rng = np.random.default_rng(2)
    step = np.linspace(-1, 1, 13)
    U = circular(rng, 13, 2, 1)
    top = np.array([[[1.0, 0.2], [0.3, 0.8j]], [[0.5, 0.1j], [0.0, 0.4]]])
    G = (top[0] + step[:, None, None] * top[1]) / (1 + denominator * 0.4 * step)[:, None, None]
    found, claimed = [], []
    for _ in range(500):
        V = 0.01 * circular(rng, 13, 2, 1)
        g, c, _ = one_line(G @ U + V, U, step, 1, denominator)
        found.append(g.flatten(order="F"))
        claimed.append(np.trace(c).real)
    scatter = np.trace(np.cov(np.array(found), rowvar=False)).real
    assert np.mean(claimed) == pytest.approx(scatter, rel=0.1)
    assert 4 * np.mean(claimed) != pytest.approx(scatter, rel=0.1)  # negative control


def test_averaging_more_blocks_narrows_it():
    one, four = (
        local_frf(one_experiment(blocks=b, noise=1e-5, feedback=20.0), half_width=5) for b in (1, 4)
    )
    assert np.median(four.variance / one.variance) < 0.6
    diagonal = local_frf(one_experiment(blocks=4), structure="diagonal", half_width=5)
    assert not diagonal.has_full_covariance


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"half_width": 1}, r"3 lines with 1 runs give 3 equations for 6 unknowns"),
        ({"order": -1}, "order: -1; a whole number >= 0"),
        ({"denominator": 0.5}, "denominator: 0.5; a whole number"),
        ({"structure": "half"}, "structure 'half' is unknown"),
    ],
)
def test_wrong_options_are_named(options, message):
    with pytest.raises(InvalidInput, match=message):
        local_frf(one_experiment(), **options)


def test_dependent_torques_are_named():
    records = one_experiment()
    torque = np.array(records.torque)
    torque[..., 1] = torque[..., 0]
    with pytest.raises(InvalidInput, match=r"position 1: the torques around 3 Hz do not determine"):
        local_frf(replace(records, torque=torque))
    with pytest.raises(InvalidInput, match="none given"):
        local_frf([])


def test_positions_share_their_frequencies():
    one = one_experiment()
    other = replace(one, sample_time=2 * one.sample_time)
    with pytest.raises(InvalidInput, match="position 2: its frequencies differ"):
        local_frf([one, other])
