"""Records with commanded and measured torques: the measured count, the loop is reported."""

from dataclasses import replace

import numpy as np
import pytest
from closed_loop import (
    DETECTION,
    LINES,
    SAMPLE_TIME,
    SAMPLES,
    Bench,
    bench_records,
    hold_factor,
    truth,
)

import robotmodels
from estimators import estimate_frf, fit, read_records, run_spectra, torque_loop, write_records
from estimators.frf.frf_from_records import measured_frf
from estimators.frf.torque_loop import check_torque_loop
from reports.summaries.frf_summary import frf_json, frf_summary
from robotmodels import InvalidInput

GAIN, DELAY, LAG = np.array([0.97, 1.1]), np.array([1e-3, 0.0]), np.array([2e-3, 0.8e-3])
TRUTH = np.array([GAIN, DELAY, LAG]).T


def loop(omega):
    w = np.asarray(omega)[:, None]
    return GAIN * np.exp(-1j * w * DELAY) / (1 + 1j * w * LAG)


def both(noise=0.0, seed=0, **setup):
    """Records whose measured torques follow commands by the loop, with noise of their own."""
    records = bench_records(Bench(**({"hold": False, "noise": 1e-7} | setup)))
    omega = 2 * np.pi * np.fft.rfftfreq(SAMPLES, SAMPLE_TIME)[1:]
    torque = np.fft.rfft(records.torque, axis=4)
    command = torque.copy()
    command[..., 1:, :] /= hold_factor(omega)[:, None] * loop(omega)
    command[..., -1, :] = 0  # of half the sample rate
    rng = np.random.default_rng(seed)
    measured = records.torque + noise * rng.standard_normal(records.torque.shape)
    return replace(records, torque=measured, command=np.fft.irfft(command, SAMPLES, axis=4))


def test_measured_torques_are_the_inputs_and_are_not_held():
    records = both()
    estimate = estimate_frf(records)
    G = truth(estimate.omega)
    assert np.abs(estimate.response[0] - G).max() < 1e-3 * np.abs(G).max()
    alone = replace(records, command=None)
    np.testing.assert_array_equal(estimate.response, estimate_frf(alone, hold=False).response)
    for noise in ("periods", (0.1, 1e-6)):
        a, b = run_spectra(records, noise), run_spectra(alone, noise, hold=False)
        np.testing.assert_array_equal(a.inputs, b.inputs)
        np.testing.assert_array_equal(a.covariance, b.covariance)
    assert np.abs(estimate_frf(alone).response - G).max() > 0.05 * np.abs(G).max()  # held: wrong


def test_the_loop_is_exact_without_noise():
    told = torque_loop(both())
    np.testing.assert_allclose(told.response, loop(told.omega), rtol=1e-9)
    values = np.array([told.gain, told.delay, told.lag]).T
    np.testing.assert_allclose(values, TRUTH, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(told.bandwidth, 1 / LAG, rtol=1e-6)


@pytest.mark.parametrize("draws", [10, pytest.param(100, marks=pytest.mark.slow)])
def test_standard_errors_are_those_of_the_scatter(draws):
    records = both(blocks=1, periods=1)
    rng, z = np.random.default_rng(3), []
    for _ in range(draws):
        noisy = records.torque + 0.3 * rng.standard_normal(records.torque.shape)
        told = torque_loop(replace(records, torque=noisy))
        z.append((np.array([told.gain, told.delay, told.lag]).T - TRUTH) / told.std)
        assert (told.misfit < 2.5).all()
    assert 0.6 < np.sqrt(np.mean(np.square(z))) < 1.3
    assert draws < 100 or np.sqrt(np.mean(np.square(z), axis=0)).max() < 1.2


def test_another_loop_is_said_to_be_another():
    records = both(noise=1e-3)
    torque = np.fft.rfft(records.torque, axis=4)
    k = np.arange(torque.shape[4])[:, None]
    torque = torque / (1 - (k / 60.0) ** 2 + 0.02j * k)  # a resonance of the loop
    told = torque_loop(replace(records, torque=np.fft.irfft(torque, SAMPLES, axis=4)))
    assert told.misfit.min() > 100


def test_files_keep_commands(tmp_path):
    records = both(blocks=2, periods=1)
    for ending in (".h5", ".mat", ".csv"):
        path = tmp_path / f"records{ending}"
        write_records(path, records)
        np.testing.assert_array_equal(read_records(path).command, records.command)
        write_records(path, replace(records, command=None))
        assert read_records(path).command is None


def test_the_loop_is_stated_beside_frfs(tmp_path):
    both(noise=1e-3).save(tmp_path / "bench.h5")
    measurement = measured_frf(tmp_path / "bench.h5")
    summary = frf_summary(measurement, [])
    assert "motor 1: measured over commanded torque 0.97 (" in summary
    assert "bandwidth 79.6 Hz" in summary
    document = frf_json(measurement, [])["torque_loop"]
    assert [one["lag"] for one in document] == pytest.approx(LAG, rel=1e-2)


def one_motor(records):
    """Return the first motor's part of records."""
    signals = {name: getattr(records, name)[..., :1] for name in (*records.signals, "positions")}
    return replace(records, **signals, derivatives=None)


def test_mistakes_are_named():
    records = both(blocks=2, periods=1)
    with pytest.raises(InvalidInput, match="position 1: no commands beside measured torques"):
        torque_loop(replace(records, command=None))
    with pytest.raises(InvalidInput, match=r"command: shape .* does not fit torque"):
        replace(records, command=records.command[..., :1])
    with pytest.raises(InvalidInput, match="command: that of motor 1 is zero at a line"):
        torque_loop(replace(records, command=np.zeros_like(records.command)))
    with pytest.raises(InvalidInput, match="command: not a finite number"):
        replace(records, command=np.full_like(records.command, np.inf))
    one = both(blocks=1, experiments=1, periods=1)
    few = replace(one, lines=LINES[:2], detection=DETECTION)
    with pytest.raises(InvalidInput, match="2 lines of 1 runs do not show the noise of motor 1"):
        torque_loop(few)
    robot = robotmodels.load_robot("moberg_axis1")
    motor = robot.file.motors[0].model_copy(update={"torque_lag": 1e-3})
    late = replace(robot, file=robot.file.model_copy(update={"motors": [motor]}))
    with pytest.raises(InvalidInput, match="motor m1: torque_gain, torque_delay and torque_lag"):
        check_torque_loop(late, records)
    check_torque_loop(robot, records)
    runs = run_spectra(one_motor(records), (0.1, 1e-6))
    assert not runs.commanded
    with pytest.raises(InvalidInput, match=r"torque_lag of moberg_axis1 act on commanded torques"):
        fit(late, runs)
