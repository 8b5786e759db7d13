"""Gains read off records of runs that move one motor each, the others held: [HBH] 3.1, 3.2."""

from dataclasses import replace

import numpy as np
import pytest

import oed
from estimators.chain_dampers.held_responses import held_responses
from estimators.chains.identification import identify_chains
from estimators.chains.inverse_eigenvalue import coupled_inertia
from estimators.frf.estimate_frf import estimate_frf
from robotmodels.common.errors import InvalidInput
from robotmodels.linear.coupled_chains import CoupledChains
from robotmodels.simulation.controller import Controller
from robotmodels.simulation.linear_simulation import simulate_linear

CHAINS = CoupledChains(
    np.array([[1.0, 2.0], [2.0, 1.5], [1.5, 2.5]]),
    np.array([[900.0], [2500.0], [1600.0]]),
    np.array([[0, 0.5, -0.4], [0.5, 0, 0.6], [-0.4, 0.6, 0]]),
    np.array([[0.5], [0.9], [0.7]]),
)
SAMPLES, TIME = 4000, 0.004
CONTROLLER = Controller(np.full(3, 80.0), np.full(3, np.inf), np.full(3, 8.0), TIME)


def simulated(low=0.06, orthogonal=False):
    rng = np.random.default_rng(1)
    band = (2 * np.pi * low, 2 * np.pi * 20)
    multisine = oed.band_multisine(SAMPLES, TIME, band, inputs=3 if orthogonal else 1)
    phases = oed.random_phases(multisine, 2, rng=rng)
    signals = 0.05 * multisine.reference(phases)
    if not orthogonal:
        signals = signals[:, 0][:, None] * np.eye(3)[:, None]
    return simulate_linear(
        CHAINS.linear_model(),
        signals,
        CONTROLLER,
        lines=multisine.lines,
        angle_noise=1e-6,
        rng=rng,
        periods=2,
        transient=1,
    )


@pytest.fixture(scope="module")
def records():
    return simulated()


@pytest.fixture(scope="module")
def modes(records):
    estimate = estimate_frf(records, covariance="noise")
    variance = estimate.covariance[0]
    return identify_chains(
        estimate.omega, estimate.response[0], 2, covariance=variance, method="lanczos"
    ).modes


def test_gains_are_those_of_the_held_chains(records, modes):
    held = held_responses(records, modes)
    sums = CHAINS.masses.sum(axis=1)
    assert held.low == pytest.approx(1 / sums, rel=2e-3)
    assert held.high == pytest.approx(1 / CHAINS.masses[:, 0], rel=1e-3)
    pairs = [(0, 1), (0, 2), (1, 2)]
    found = [
        coupled_inertia(gain, held.low[i], held.low[j])
        for (i, j), gain in zip(pairs, held.cross_low, strict=True)
    ]
    assert found == pytest.approx([0.5, -0.4, 0.6], rel=0.01)
    # Unconstrained, the low gains are others: condition (4) is needed.
    rigid = np.diag(sums) + CHAINS.couplings
    assert np.abs(np.diag(np.linalg.inv(rigid)) * sums - 1).max() > 0.02
    for std in (held.low_std, held.high_std, held.cross_std):
        assert (std > 0).all()


def test_runs_that_move_other_motors_are_refused(modes):
    with pytest.raises(InvalidInput, match="run 1 moves motor 2 too"):
        held_responses(simulated(orthogonal=True), modes)


def test_missing_runs_and_lines_are_named(records, modes):
    names = ("reference", "torque", "angle", "saturated")
    fewer = replace(records, **{name: getattr(records, name)[:, :, :2] for name in names})
    with pytest.raises(InvalidInput, match="2 runs of 3 motors; one run per motor"):
        held_responses(fewer, modes)
    with pytest.raises(InvalidInput, match="0 lines below the anti-resonances"):
        held_responses(simulated(low=3.0), modes)
