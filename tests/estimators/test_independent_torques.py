"""Lines that tell the motors apart, and those that are left out."""

from dataclasses import replace

import numpy as np
import pytest
from closed_loop import LINES, SAMPLE_TIME, SAMPLES, Bench, bench_records, truth

from estimators import estimate_frf, excitation, local_frf
from estimators.frf.frf_from_records import measured_frf
from estimators.frf.input_rank import input_rank
from robotmodels import InvalidInput

OMEGA = 2 * np.pi * LINES / (SAMPLES * SAMPLE_TIME)


def noisy(**setup):
    return bench_records(Bench(**({"noise": 1e-6, "feedback": 20.0} | setup)))


def without(records, lines, motor=slice(None), std=1e-3):
    """Take lines off the torque of a motor, which has noise of its own."""
    torque = np.fft.rfft(records.torque, axis=4)
    reference = np.fft.rfft(records.reference, axis=4)
    for signal in (torque, reference):
        part = signal[..., motor]
        part[:, :, :, :, lines] = 0
    noise = std * np.random.default_rng(5).standard_normal(records.torque.shape)
    return replace(
        records,
        torque=np.fft.irfft(torque, SAMPLES, axis=4) + noise,
        reference=np.fft.irfft(reference, SAMPLES, axis=4),
    )


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("runs", [2, 3, 12])
def test_noise_alone_counts_as_no_input(seed, runs):
    rng = np.random.default_rng(seed)
    level = np.array([1e-3, 5.0, 0.1])
    parts = rng.standard_normal((2, 200, 3, runs)) * level[:, None] / np.sqrt(2)
    noise = parts[0] + 1j * parts[1]
    assert np.mean(input_rank(noise, np.broadcast_to(level, (200, 3))) > 0) < 0.08
    signal = np.zeros_like(noise)
    signal[:, 1] = 200 * np.exp(1j * np.arange(runs))
    rank = input_rank(noise + signal, np.broadcast_to(level, (200, 3)))
    assert (rank >= 1).all()
    assert np.mean(rank > 1) < 0.08


def test_condition_numbers_of_orthogonal_runs():
    told = excitation(bench_records())
    assert (told.rank == 2).all()
    np.testing.assert_allclose(told.condition, 1.0, rtol=1e-6)  # of an open loop
    np.testing.assert_array_equal(told.usable, LINES)


@pytest.mark.parametrize("periods", [1, 3])
@pytest.mark.parametrize("motor", [slice(None), 1])
def test_silent_lines_are_refused_by_the_library(periods, motor):
    records = without(noisy(periods=periods), LINES[[4, 9]], motor)
    told = excitation(records)
    np.testing.assert_array_equal(np.setdiff1d(LINES, told.usable), LINES[[4, 9]])
    assert set(told.rank[0, [4, 9]]) == {0 if motor == slice(None) else 1}
    with pytest.raises(InvalidInput, match=rf"2 lines, {LINES[4]}, {LINES[9]} \("):
        estimate_frf(records)
    estimate = estimate_frf(records, lines=told.usable)
    assert len(estimate.omega) == len(LINES) - 2


def relative(estimate):
    G = truth(estimate.omega)
    return np.abs(estimate.response[0] - G).max(axis=(1, 2)) / np.abs(G).max(axis=(1, 2))


def test_commands_leave_silent_lines_out_and_name_them(tmp_path):
    without(noisy(), LINES[[4, 9]]).save(tmp_path / "bench.h5")
    measured = measured_frf(tmp_path / "bench.h5")
    np.testing.assert_allclose(measured.left_out, OMEGA[[4, 9]])
    assert relative(measured.estimate).max() < 0.05
    a, b = LINES[[4, 9]]
    words = f"2 lines, {a}, {b} ({a} to {b} Hz) left out: 0 of 2 torques"
    assert any(words in warning for warning in measured.warnings)


def test_a_band_never_holds_zero_hertz(tmp_path):
    noisy().save(tmp_path / "bench.h5")
    band = (0.0, 2 * np.pi * 21.0)
    measured = measured_frf(tmp_path / "bench.h5", band=band)
    whole = measured_frf(tmp_path / "bench.h5")
    inside = band[1] >= OMEGA
    np.testing.assert_array_equal(measured.estimate.omega, OMEGA[inside])
    np.testing.assert_allclose(measured.estimate.response, whole.estimate.response[:, inside])
    assert measured.distortion.odd_omega.max() < band[1]
    for wrong in ((0.0, 1.0), (90.0, 20.0), (-5.0, 100.0), (np.nan, 100.0)):
        with pytest.raises(InvalidInput, match=r"band: .* lie from 3 to 79 Hz"):
            measured_frf(tmp_path / "bench.h5", band=wrong)
    with pytest.raises(InvalidInput, match="'arj' is unknown"):
        excitation(noisy(), "arj")
    gone = np.full_like(noisy().angle, np.nan)
    with pytest.raises(InvalidInput, match="every run is missing"):
        excitation(replace(noisy(), torque=gone, angle=gone))
    with pytest.raises(InvalidInput, match="a low and a high"):
        excitation(noisy(), band=(1.0, 2.0, 3.0))


@pytest.mark.parametrize("lines", [[4], [5, 3], [], [3.5]])
def test_lines_that_are_not_excited_are_named(lines):
    with pytest.raises(InvalidInput, match="lines"):
        estimate_frf(noisy(), lines=lines)


@pytest.mark.parametrize("outputs", [1, 3])
def test_one_run_takes_the_local_model_whatever_the_outputs(tmp_path, outputs):
    records = noisy(blocks=1, experiments=1)
    angle = records.angle[..., [0, 1, 0][:outputs]]
    replace(records, angle=angle, derivatives=None).save(tmp_path / "bench.h5")
    measured = measured_frf(tmp_path / "bench.h5")
    assert measured.method == measured.covariance == "local"
    assert (measured.excitation.rank == 1).all()
    assert (measured.excitation.condition < 1e4).all()
    G = truth(measured.estimate.omega)[:, [0, 1, 0][:outputs]]
    error = np.abs(measured.estimate.response[0] - G).max(axis=(1, 2)) / np.abs(G).max(axis=(1, 2))
    assert np.median(error) < 0.03


def test_a_motor_that_one_run_leaves_out_is_not_estimated(tmp_path):
    records = without(noisy(blocks=1, experiments=1), LINES, 1)
    with pytest.raises(InvalidInput, match="do not determine the FRF"):
        local_frf(records, denominator=2)
    records.save(tmp_path / "bench.h5")
    with pytest.raises(InvalidInput, match=r"1 of 2 torques are .*oed identify"):
        measured_frf(tmp_path / "bench.h5")


def test_single_runs_of_few_lines_are_sent_to_the_fit(tmp_path):
    few = without(noisy(blocks=1, experiments=1), LINES[5:], std=0.0)
    replace(few, lines=LINES[:5]).save(tmp_path / "bench.h5")
    with pytest.raises(InvalidInput, match=r"5 lines with 1 runs .*\(oed identify\)"):
        measured_frf(tmp_path / "bench.h5")
