"""Recommended intervals of chains: they cover, and are refused where the model is wrong."""

import numpy as np
import pytest
from derivatives import circular
from scipy.linalg import expm

import oed
from estimators import FrfEstimate, chains_from_frf, fit_dampers
from estimators.chain_dampers.chains_from_records import measured_chains
from estimators.chain_dampers.damper_fit import recommended_estimate
from estimators.chains.identification import held_images, identify_chains
from robotmodels import Controller, CoupledChains, LinearModel, modally_damped, simulate_linear

MASSES, SPRINGS = np.array([[1.0, 2.0], [2.0, 1.5]]), np.array([[900.0], [2500.0]])
COUPLINGS, DAMPERS = np.array([[0, 0.5], [0.5, 0]]), np.array([[0.5], [0.9]])  # about 1 %
TRUTH = np.array([*MASSES.ravel(), *SPRINGS.ravel(), 0.5])
UNDAMPED = CoupledChains(MASSES, SPRINGS, COUPLINGS).linear_model()
MODELS = {
    "dampers": CoupledChains(MASSES, SPRINGS, COUPLINGS, DAMPERS).linear_model(),
    "modal": modally_damped(UNDAMPED, 0.01),
}
OMEGA = 2 * np.pi * np.linspace(0.6, 15, 60)


def drawn(model, blocks, rng, relative=0.02):
    """FRFs as the mean over blocks, their covariance as the blocks scatter; declared where inf."""
    G = model.frequency_response(OMEGA)
    largest = np.abs(G).max(axis=(1, 2), keepdims=True)
    variance = (relative * np.abs(G)) ** 2 + (relative / 4 * largest) ** 2
    place, one = np.zeros((1, 2)), np.ones(1, dtype=int)
    if np.isinf(blocks):
        G = G + np.sqrt(variance) * circular(rng, *G.shape)
        return FrfEstimate(place, OMEGA, G[None], variance[None], one)
    each = G + np.sqrt(variance * blocks) * circular(rng, blocks, *G.shape)
    basis = np.linalg.qr(np.column_stack([np.ones(blocks), np.eye(blocks)[:, 1:]]))[0][:, 1:]
    draws = np.tensordot(basis.T, each, 1) / np.sqrt(blocks * (blocks - 1))
    covariance = (np.abs(draws) ** 2).sum(axis=0)
    return FrfEstimate(
        place, OMEGA, each.mean(axis=0)[None], covariance[None], one, blocks - 1.0, draws[None]
    )


def share_within(intervals, part=1.0):
    """Which truths the intervals hold, shrunk about their middle to a `part`."""
    inside = []
    for i, truth in zip(intervals, TRUTH, strict=True):
        middle, half = (i.low + i.high) / 2, part * (i.high - i.low) / 2
        inside.append(abs(truth - middle) <= half)
    return np.mean(inside)


def judged(model, blocks, runs, rng):
    covered, quarter, verdicts = [], [], []
    for _ in range(runs):
        found = chains_from_frf(drawn(model, blocks, rng), 2)
        best = recommended_estimate(found, fit_dampers(found))
        verdicts.append(str(best.verdict))
        if best.verdict.gives_interval:
            covered.append(share_within(best.intervals))
            quarter.append(share_within(best.intervals, 0.25))
    return np.mean(covered), np.mean(quarter), verdicts


@pytest.mark.parametrize(("kind", "blocks"), [("dampers", 2), ("modal", np.inf)])
def test_recommended_intervals_cover_in_a_few_runs(kind, blocks):
    covered, quarter, verdicts = judged(MODELS[kind], blocks, 16, np.random.default_rng(3))
    assert covered > 0.84
    assert quarter < 0.75
    assert verdicts.count("trustworthy") >= 14


@pytest.mark.slow
@pytest.mark.parametrize("kind", MODELS)
@pytest.mark.parametrize("blocks", [2, 3, 4, 6, 20, np.inf])
def test_recommended_intervals_cover(kind, blocks):
    covered, quarter, verdicts = judged(MODELS[kind], blocks, 200, np.random.default_rng(4))
    assert 0.93 < covered < 0.975
    assert quarter < 0.6
    assert verdicts.count("trustworthy") >= 190


def test_of_two_models_of_damping_the_right_one_is_recommended():
    rng = np.random.default_rng(5)
    found = chains_from_frf(drawn(MODELS["dampers"], 6, rng, 3e-4), 2)
    assert recommended_estimate(found, fit_dampers(found)).method == "least squares with dampers"
    found = chains_from_frf(drawn(MODELS["modal"], 6, rng, 3e-4), 2)
    damped = fit_dampers(found)
    assert recommended_estimate(found, damped) is found.structured
    assert damped.estimate.verdict == "model error"
    assert all(i.low is None and i.high is None for i in damped.estimate.intervals)


def test_chains_of_another_structure_get_no_intervals():
    """A spring between a first and the other last mass is no part of the model."""
    link = np.array([1.0, 0, 0, -1.0])
    stiffness = UNDAMPED.stiffness + 200 * np.outer(link, link)
    linked = LinearModel(UNDAMPED.mass, UNDAMPED.damping, stiffness, UNDAMPED.selector)
    model = modally_damped(linked, 0.01)
    found = chains_from_frf(drawn(model, 6, np.random.default_rng(6), 0.005), 2)
    best = recommended_estimate(found, fit_dampers(found))
    assert best.verdict == "model error"
    assert all(i.low is None and i.high is None for i in best.intervals)
    assert "+-" not in str(best)


def test_noise_of_unknown_size_is_never_trusted():
    G = drawn(MODELS["modal"], np.inf, np.random.default_rng(7)).response[0]
    found = identify_chains(OMEGA, G, 2)
    assert found.structured.verdict == "too few blocks"
    declared = (0.02 * np.abs(G)) ** 2 + (0.005 * np.abs(G).max(axis=(1, 2), keepdims=True)) ** 2
    assert identify_chains(OMEGA, G, 2, covariance=declared).structured.verdict == "trustworthy"


def test_masses_that_were_given_have_no_width_and_the_rest_has():
    estimate = drawn(MODELS["modal"], 6, np.random.default_rng(8))
    found = chains_from_frf(estimate, 2, first_masses=MASSES[:, 0])
    intervals = {i.name: i for i in found.structured.intervals}
    assert (intervals["m1"].low, intervals["m1"].std, intervals["m1"].method) == (1.0, 0.0, "given")
    assert intervals["m2"].high > intervals["m2"].low
    assert recommended_estimate(found, fit_dampers(found)) is found.structured


T, N = 0.005, 1000


def sampled_response(model, omega):
    """Angles at the samples per held torque, exactly, times (j omega)^2 over the hold."""
    d, n = len(model.mass), model.inputs
    forces = np.linalg.solve(
        model.mass, np.hstack([-model.stiffness, -model.damping, model.selector])
    )
    top = np.hstack([np.zeros((d, d)), np.eye(d), np.zeros((d, n))])
    held = expm(T * np.vstack([top, forces, np.zeros((n, 2 * d + n))]))
    z = np.exp(1j * omega * T)[:, None, None]
    state = np.linalg.solve(z * np.eye(2 * d) - held[: 2 * d, : 2 * d], held[: 2 * d, 2 * d :])
    half = omega * T / 2
    hold = np.sinc(half / np.pi) * np.exp(-1j * half)
    return -(omega[:, None, None] ** 2) * (model.selector.T @ state[:, :d]) / hold[:, None, None]


def test_images_of_the_hold_are_those_of_the_sampled_system():
    model = MODELS["modal"]
    G = model.frequency_response(OMEGA)
    found = identify_chains(OMEGA, G, 2, covariance=1e-14 * np.abs(G).max() ** 2 * np.ones(G.shape))
    exact = sampled_response(model, OMEGA) - G
    assert np.abs(exact).max() > 1e-4  # rad/s^2 per N m
    assert np.abs(held_images(found.modes, T) - exact).max() < 1e-4 * np.abs(exact).max()


def test_images_count_at_low_noise(tmp_path):
    rng = np.random.default_rng(9)
    multisine = oed.band_multisine(N, T, (2 * np.pi * 0.6, 2 * np.pi * 15), inputs=2)
    records = simulate_linear(
        MODELS["dampers"],
        multisine.reference(oed.random_phases(multisine, 2, rng=rng)),
        Controller(np.array([40.0, 60.0]), np.ones(2), np.full(2, 2.0), T),
        lines=multisine.lines,
        periods=4,
        transient=6,
        angle_noise=1e-6,
        rng=rng,
    )
    records.save(tmp_path / "records.h5")
    shown = measured_chains(tmp_path / "records.h5", 2)
    best = shown.recommended
    assert best.verdict == "trustworthy"
    assert not any("backlash" in warning for warning in shown.warnings)
    assert np.abs((best.values - TRUTH) / best.std).max() < 4.5
    biased = chains_from_frf(shown.frf.estimate, 2)
    wrong = fit_dampers(biased).estimate
    assert wrong.verdict == "model error"
    assert np.abs((wrong.values - TRUTH) / best.std).max() > 30
