"""Chains from time-domain records: closed loop, sampled, noisy; multisines and stepped sines."""

from pathlib import Path

import numpy as np
import pytest
from chain_experiments import (
    CONTROLLER,
    MODEL,
    SAMPLES,
    TRUTH,
    campaigns,
)

import robotmodels
from estimators import estimate_frf
from estimators.chain_dampers.chains_from_records import measured_chains
from estimators.chains.identification import identify_chains
from robotmodels.records.records import save_records
from robotmodels.simulation.controller import default_controller
from robotmodels.simulation.linear_simulation import simulate_linear


def identified(records):
    estimate = estimate_frf(records, covariance="noise", transient=0)
    return identify_chains(
        estimate.omega, estimate.response[0], 3, covariance=estimate.covariance[0]
    )


def judged(count, rng, batch):
    """Errors over standard deviations, and relative errors, (runs, 2, k)."""
    pulls, errors = [], []
    for _ in range(0, count, batch):
        for records in campaigns(batch, rng):
            found = identified(records)
            both = (found.inverse, found.structured)
            pulls.append([(e.values - TRUTH) / e.std for e in both])
            errors.append([np.abs(e.values / TRUTH - 1) for e in both])
    return np.array(pulls), np.array(errors)


def check(pulls, errors, low, high):
    """Judge both routes: median errors, coverage, and what half the std claimed would cover."""
    assert np.median(errors, axis=0).max() < 0.02
    for route in range(2):
        covered = np.mean(np.abs(pulls[:, route]) < 1.96)
        assert low < covered < high
        assert np.mean(np.abs(pulls[:, route]) < 1.96 / 2) < 0.80


def test_closed_loop_experiments_with_one_percent_noise():
    pulls, errors = judged(4, np.random.default_rng(20), 4)
    check(pulls, errors, 0.85, 0.995)


@pytest.mark.slow
def test_intervals_cover_in_300_closed_loop_experiments():
    pulls, errors = judged(320, np.random.default_rng(21), 20)
    check(pulls, errors, 0.93, 0.97)


def test_stepped_sines_motor_after_motor():
    """One frequency and one motor at a time; 40 frequencies, mostly near the resonances."""
    lines = np.unique(
        np.concatenate(
            [np.arange(10, 200, 12), [78, 79, 94, 95, 108, 109, 143, 144, 154, 155, 163, 164]]
        )
    )
    time = np.arange(SAMPLES) / SAMPLES
    signals = np.zeros((1, 3 * len(lines), SAMPLES, 3))
    for k, line in enumerate(lines):
        for motor in range(3):
            signals[0, 3 * k + motor, :, motor] = 0.2 * np.cos(2 * np.pi * line * time)
    records = simulate_linear(
        MODEL,
        signals,
        CONTROLLER,
        lines=lines,
        angle_noise=1e-4,
        rng=np.random.default_rng(4),
        periods=3,
        transient=3,
    )
    estimate = estimate_frf(records, "jio", covariance="noise", transient=0)
    found = identify_chains(estimate.omega, estimate.response[0], covariance=estimate.covariance[0])
    assert found.n_masses == 3
    assert found.structured.values == pytest.approx(TRUTH, rel=0.02)
    pulls = (found.structured.values - TRUTH) / found.structured.std
    assert np.sqrt(np.mean(pulls**2)) < 2.5


HARDENED = "{low: 8.0828e+05, high: 4.84e+06, torque: 1500.0}"


@pytest.fixture(scope="module", params=[0.0, 0.05], ids=["smooth", "Coulomb"])
def axis(request, tmp_path_factory):
    """moberg_axis1 with its first spring hardened, as its published resonances have it."""
    library = Path(robotmodels.library.__file__).parent
    folder = tmp_path_factory.mktemp("robot")
    text = (library / "moberg_axis1.yaml").read_text(encoding="utf-8")
    assert HARDENED in text
    text = text.replace(HARDENED, "4.84e+06").replace("[g1.stiffness.high]", "[]")
    assert "viscous: 6.0e-03" in text
    text = text.replace("viscous: 6.0e-03", f"viscous: 6.0e-03, coulomb: {request.param}")
    (folder / "axis.yaml").write_text(text, encoding="utf-8")
    urdf = (library / "moberg_axis1.urdf").read_text(encoding="utf-8")
    (folder / "moberg_axis1.urdf").write_text(urdf, encoding="utf-8")
    return robotmodels.load_robot(folder / "axis.yaml"), request.param


def test_moberg_axis_as_one_chain_of_four_masses(axis, tmp_path):
    """Dampings to 12 % bias the undamped result; the fit with dampers mends it.

    Coulomb friction shifts the FRF by 10 to 18 % at the lowest lines and near anti-resonances;
    what blocks scatter by tells where.
    """
    robot, friction = axis
    samples, lines, blocks = 4000, np.arange(3, 480, 2), 4
    rng = np.random.default_rng(0)
    spectrum = np.zeros((blocks, 1, samples // 2 + 1, 1), dtype=complex)
    spectrum[:, 0, lines, 0] = np.exp(2j * np.pi * rng.random((blocks, len(lines))))
    save_records(
        tmp_path / "records.h5",
        robotmodels.simulate(
            robot,
            np.zeros((1, 1)),
            np.fft.irfft(spectrum, samples, axis=2) * samples / 10,
            default_controller(robot, 0.001),
            lines=lines,
            rng=rng,
            periods=2,
            transient=2,
            imperfections=robotmodels.Imperfections(friction=1, angle_noise=2e-5),
        ),
    )
    shown = measured_chains(tmp_path / "records.h5", 4)
    found, damped = shown.identification, shown.dampers
    within = 0.005 if friction else 0.001
    assert found.modes.omega / (2 * np.pi) == pytest.approx([12.40, 19.12, 54.67], rel=within)
    zeros = found.modes.zeros[0] / (2 * np.pi)
    assert zeros == pytest.approx([5.25, 15.38, 52.32], rel=5 * within)
    truth = np.array([5e-3, 2e-3, 0.02, 0.02, 100, 110, 80])
    assert found.structured.values == pytest.approx(truth, rel=0.03 if friction else 0.01)
    assert damped.estimate.values == pytest.approx(truth, rel=0.01 if friction else 3e-3)
    assert damped.dampers[0] == pytest.approx([0.08, 0.06, 0.08], rel=0.03)
    assert abs(damped.model.delay) < 3e-5
    assert (found.left_out > 0) == (friction > 0)
    if not friction:
        assert damped.model.friction[0] == pytest.approx(6e-3, rel=0.03)
