from dataclasses import replace

import numpy as np
import pytest
from closed_loop import DETECTION, LINES, Bench, bench_records, truth

from estimators import distortion, estimate_frf
from estimators.frf.distortion import detection_lines
from estimators.frf.local_rational_model import interpolated
from robotmodels import InvalidInput, load_robot
from robotmodels.records.records import Records
from robotmodels.simulation.controller import default_controller
from robotmodels.simulation.imperfections import Imperfections
from robotmodels.simulation.simulate import simulate

HERTZ = 2 * np.pi


def found(**setup):
    return distortion(bench_records(Bench(**({"periods": 4, "noise": 1e-5} | setup))))


def power_ratio(signal, noise):
    return float((signal**2).sum() / (noise**2).sum())


def test_a_linear_plant_shows_noise_only():
    d = found(blocks=6, feedback=20.0)
    assert np.median(d.total / d.noise) == pytest.approx(1, abs=0.25)
    # Powers of 14 x 12 and 38 x 12 circular numbers each, whose noise rests on three times more.
    assert power_ratio(d.odd, d.odd_noise) == pytest.approx(1, abs=0.3)
    assert power_ratio(d.even, d.even_noise) == pytest.approx(1, abs=0.2)


@pytest.mark.parametrize(
    ("kind", "odd", "even"), [({"cubic": 0.02}, True, False), ({"square": 0.02}, False, True)]
)
def test_distortion_shows_at_its_own_lines(kind, odd, even):
    d = found(blocks=6, **kind)
    assert (power_ratio(d.odd, d.odd_noise) > 10) == odd
    assert (power_ratio(d.even, d.even_noise) > 10) == even
    # Odd distortion falls on excited lines too, even distortion does not.
    assert (np.median(d.total / d.noise) > 3) == odd
    levels = d.odd_level if odd else d.even_level
    raw = d.odd if odd else d.even
    assert (levels <= raw).all()
    assert levels.max() == pytest.approx(raw.max(), rel=0.05)


def test_level_is_that_of_one_block():
    few, many = found(blocks=4, cubic=0.02), found(blocks=16, cubic=0.02, seed=1)
    ratio = np.median(many.level[many.level > 0]) / np.median(few.level[few.level > 0])
    assert ratio == pytest.approx(1, abs=0.35)
    assert few.blocks.tolist() == [4]
    assert np.median(many.total) < 0.5 * np.median(few.total)


def test_what_the_torque_explains_is_no_distortion():
    """A torque at detection lines, as a controller's answer to distortions brings it."""
    records = bench_records(Bench(periods=2, noise=1e-7))
    time = np.arange(records.samples) / records.samples
    line = 24
    omega = HERTZ * line
    wave = np.exp(2j * np.pi * line * time)[:, None]
    half = omega * records.sample_time / 2
    held = np.sinc(half / np.pi) * np.exp(-1j * half)
    answer = truth([omega])[0] @ np.array([0.3, 0.0]) * held / -(omega**2)
    shaken = replace(
        records,
        torque=records.torque + np.real(wave * [0.3, 0.0]),
        angle=records.angle + np.real(wave * answer),
    )
    d = distortion(shaken)
    k = int(np.argmin(np.abs(d.even_omega - omega)))
    assert d.even_omega[k] == pytest.approx(omega)
    assert d.even[0, k, 0] < 0.05 * d.even_raw[0, k, 0]


def test_detection_lines_lie_in_the_band():
    records = bench_records(Bench(periods=1))
    odd, even = detection_lines(records)
    assert odd.tolist() == [k for k in DETECTION if LINES[0] < k < LINES[-1]]
    assert even.tolist() == list(range(4, 79, 2))
    both = replace(records, lines=np.arange(3, 20), detection=np.array([], dtype=int))
    assert len(detection_lines(both)[1]) == 0


def test_totals_need_blocks_and_noise_needs_periods():
    d = found(blocks=1)
    assert np.isnan(d.total).all()
    assert (d.noise > 0).all()
    with pytest.raises(InvalidInput, match="position 1: one period; distortion needs at least 2"):
        found(periods=1)
    with pytest.raises(InvalidInput, match="none given"):
        distortion([])
    records = bench_records(Bench(noise=1e-7))
    slower = replace(records, sample_time=2 * records.sample_time)
    with pytest.raises(InvalidInput, match="position 2: its frequencies differ from those of"):
        distortion([records, slower])


def test_it_agrees_with_the_estimate():
    records = Records.join([bench_records(Bench(periods=2, noise=1e-5, seed=s)) for s in (0, 1)])
    d = distortion(records, "jio")
    assert np.allclose(d.total, estimate_frf(records, "jio").variance)
    assert np.allclose(d.noise, estimate_frf(records, "jio", covariance="noise").variance)
    assert d.odd.shape == (2, len(d.odd_omega), 2)


def test_interpolation_follows_resonances():
    omega, between = HERTZ * LINES, HERTZ * np.arange(4, 79, 2)
    G, expected = truth(omega), truth(between)
    size = np.abs(expected).max(axis=(1, 2))
    error = np.abs(interpolated(between, omega, G) - expected).max(axis=(1, 2)) / size
    assert error.max() < 0.06
    few = np.array([1.0, 2.0, 4.0])
    line = (few * (1 + 2j))[:, None, None]
    assert np.allclose(interpolated(np.array([1.5, 3.0]), few, line)[:, 0, 0], [1.5 + 3j, 3 + 6j])
    assert np.allclose(interpolated(np.array([0.5, 9.0]), few, line)[:, 0, 0], line[[0, 2], 0, 0])
    assert interpolated(np.array([0.5, 9.0]), few[:1], line[:1]).shape == (2, 1, 1)


def manutec(imperfections, amplitude, transient):
    """Four blocks on an elastic robot under its own controller, sample by sample."""
    robot = load_robot("manutec_r3")
    rng = np.random.default_rng(0)
    samples, n = 500, len(robot.motor_names)
    odd = np.arange(3, 50, 2)
    detection = odd[2::4]
    lines = np.setdiff1d(odd, detection)
    fourier = np.exp(2j * np.pi * np.outer(np.arange(n), np.arange(n)) / n)
    phases = np.exp(2j * np.pi * rng.random((4, len(lines), n)))
    spectrum = np.zeros((4, n, samples // 2 + 1, n), complex)
    spectrum[:, :, lines] = np.einsum("bfi,ie->befi", phases, fourier) * samples / 2 * amplitude
    records = simulate(
        robot,
        np.array([[0.0, 0.5, -0.8, 0.0, 0.6, 0.0]]),
        np.fft.irfft(spectrum, samples, axis=2),
        default_controller(robot, 1e-3),
        lines=lines,
        detection=detection,
        imperfections=imperfections,
        rng=rng,
        periods=2,
        transient=transient,
    )
    return distortion(records)


def test_a_linear_robot_in_closed_loop_shows_noise_only():
    """Its free motors drift; the scatter over two periods would claim twice the noise."""
    d = manutec(Imperfections(friction=0.0, nonlinear_gears=False, angle_noise=1e-4), 0.5, 3)
    assert np.median(d.total / d.noise) == pytest.approx(1, abs=0.35)
    assert power_ratio(d.odd, d.odd_noise) == pytest.approx(1, abs=0.3)
    assert power_ratio(d.even, d.even_noise) == pytest.approx(1, abs=0.3)


def test_coulomb_friction_exceeds_the_noise_and_the_odd_lines_say_so():
    d = manutec(Imperfections(friction=1.0, nonlinear_gears=False, angle_noise=1e-4), 4.0, 1)
    assert np.median(d.total / d.noise) > 10
    assert power_ratio(d.odd, d.odd_noise) > 30
    # Friction is odd: it shows at odd lines above all.
    assert np.mean(d.odd_level**2) > 5 * np.mean(d.even_level**2)
