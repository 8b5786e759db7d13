import numpy as np
import pytest

from oed import (
    Multisine,
    band_multisine,
    crest_factor,
    fourier_matrix,
    random_phases,
    reduced_crest,
)
from robotmodels import InvalidInput

N, T = 400, 2e-3
HZ = 2 * np.pi
BAND = (HZ * 2, HZ * 60)  # lines 1.6 to 48


def grid(**keywords):
    return band_multisine(N, T, BAND, **{"inputs": 3, **keywords})


@pytest.mark.parametrize("n", [1, 2, 3, 6])
def test_fourier_matrix_is_orthogonal(n):
    F = fourier_matrix(n)
    np.testing.assert_allclose(F @ F.conj().T, n * np.eye(n), atol=1e-12)
    # Element (i, l) of [WM] section 4, counted from 1 there.
    i, k = np.arange(1, n + 1)[:, None], np.arange(1, n + 1)
    np.testing.assert_allclose(F, np.exp(2j * np.pi / n * (i - 1) * (k - 1)), atol=1e-12)


def test_reference_is_the_sum_of_cosines_that_it_is_said_to_be():
    sine = grid(amplitude=lambda w: np.stack([1 / w, 1 + 0 * w, w], axis=1))
    phases = random_phases(sine, 2, rng=np.random.default_rng(1))
    t = np.arange(N) * T
    block, experiment, motor = 1, 2, 1
    turn = 2 * np.pi * motor * experiment / 3
    expected = sum(
        a * np.cos(w * t + p + turn)
        for a, w, p in zip(
            sine.amplitudes[:, motor], sine.omega, phases[block, :, motor], strict=True
        )
    )
    signals = sine.reference(phases)
    assert signals.shape == (2, 3, N, 3)
    np.testing.assert_allclose(signals[block, experiment, :, motor], expected, atol=1e-12)


def test_spectrum_is_exactly_at_the_lines_and_orthogonal_there():
    rng = np.random.default_rng(2)
    sine = grid(detection_group=4, rng=rng, amplitude=lambda w: 0.1 + w / w.max())
    phases = random_phases(sine, 4, rng=rng)
    R = np.moveaxis(np.fft.fft(sine.reference(phases), axis=2)[:, :, : N // 2], 1, -1)  # B N n E
    np.testing.assert_allclose(R[:, sine.lines], sine.spectrum(phases), atol=1e-9)
    others = np.setdiff1d(np.arange(N // 2), sine.lines)
    assert np.abs(R[:, others]).max() < 1e-11 * np.abs(R).max()
    products = R[:, sine.lines] @ np.swapaxes(R[:, sine.lines].conj(), -1, -2)
    power = 3 * (N / 2 * sine.amplitudes) ** 2
    np.testing.assert_allclose(
        products,
        np.broadcast_to(power[:, :, None] * np.eye(3), products.shape),
        atol=1e-9 * power.max(),
    )


def test_signal_is_periodic_and_odd_lines_change_sign_after_half_a_period():
    sine = grid()
    phases = random_phases(sine, 1, rng=np.random.default_rng(3))
    signal = sine.reference(phases)
    np.testing.assert_allclose(signal[:, :, : N // 2], -signal[:, :, N // 2 :], atol=1e-12)
    fine = sine.period_of(sine.spectrum(phases), 5 * N)
    np.testing.assert_allclose(fine[:, :, ::5], signal, atol=1e-12)
    every = grid(odd=False)
    signal = every.reference(random_phases(every, 1, rng=np.random.default_rng(3)))
    assert np.abs(signal[:, :, : N // 2] + signal[:, :, N // 2 :]).max() > 0.1


def test_lines_of_the_band():
    assert grid().lines.tolist() == list(range(3, 48, 2))
    assert grid(odd=False).lines.tolist() == list(range(2, 49))
    assert grid().omega[0] == pytest.approx(2 * np.pi * 3 / (N * T))
    # Ends that are lines are taken, in spite of rounding.
    ends = tuple(2 * np.pi * k / (N * T) for k in (7, 21))
    assert band_multisine(N, T, ends, inputs=1).lines[[0, -1]].tolist() == [7, 21]
    assert grid(count=3).lines.tolist() == [3, 25, 47]


def test_quasi_logarithmic_lines_are_odd_and_nearly_logarithmic():
    sine = band_multisine(20000, 5e-4, (HZ * 1, HZ * 90), inputs=1, count=30, spacing="quasi_log")
    assert (sine.lines % 2 == 1).all()
    assert 20 < len(sine.lines) <= 30
    wanted = np.geomspace(sine.lines[0], sine.lines[-1], 30)
    assert np.abs(wanted[:, None] - sine.lines).min(axis=1).max() <= 1


def test_one_line_of_each_full_group_is_left_out_at_random():
    full = grid().lines
    drawn = []
    for seed in range(60):
        sine = grid(detection_group=4, rng=np.random.default_rng(seed))
        np.testing.assert_array_equal(np.union1d(sine.lines, sine.detection), full)
        places = [int(np.flatnonzero(full == line)[0]) for line in sine.detection]
        assert [p // 4 for p in places] == list(range(len(full) // 4))
        drawn += [p % 4 for p in places]
    assert np.bincount(drawn, minlength=4).min() > 0.15 * len(drawn)


def test_phases_are_uniform_differ_between_blocks_and_repeat_with_the_seed():
    sine = grid()
    phases = random_phases(sine, 50, rng=np.random.default_rng(4))
    assert phases.shape == (50, len(sine.lines), 3)
    assert np.abs(np.exp(1j * phases).mean()) < 4 / np.sqrt(phases.size)
    assert (phases[0] != phases[1]).all()
    again = random_phases(sine, 50, rng=np.random.default_rng(4))
    np.testing.assert_array_equal(phases, again)


def test_crest_factor_of_a_sine_and_of_a_square():
    t = np.linspace(0, 1, 1000, endpoint=False)
    wave = np.sin(HZ * t)
    np.testing.assert_allclose(crest_factor(wave, axis=0), np.sqrt(2), rtol=1e-4)
    assert crest_factor(np.where(wave >= 0, 3.0, -3.0), axis=0) == 1.0


@pytest.mark.parametrize("n", [1, 2, 6])
def test_clipping_lowers_the_crest_factor_in_all_experiments_and_keeps_the_spectrum(n):
    rng = np.random.default_rng(5)
    sine = grid(inputs=n, detection_group=3, rng=rng, amplitude=lambda w: w**-0.5)
    phases = random_phases(sine, 3, rng=rng)
    lowered = reduced_crest(sine, phases, 100)
    before, after = (crest_factor(sine.reference(p)).max(axis=1) for p in (phases, lowered))
    assert (after < before).all()
    assert after.mean() < 0.75 * before.mean()
    R = np.fft.fft(sine.reference(lowered), axis=2)[:, :, : N // 2]
    others = np.setdiff1d(np.arange(N // 2), sine.lines)
    assert np.abs(R[:, :, others]).max() < 1e-11 * np.abs(R).max()
    np.testing.assert_allclose(
        np.abs(R[:, :, sine.lines]),
        np.broadcast_to(N / 2 * sine.amplitudes, (3, n, *sine.amplitudes.shape)),
    )
    np.testing.assert_array_equal(lowered, reduced_crest(sine, phases, 100))
    assert np.abs(lowered[0] - lowered[1]).min() > 0  # blocks stay apart


def test_no_clipping_leaves_the_signals():
    sine = grid()
    phases = random_phases(sine, 2, rng=np.random.default_rng(6))
    np.testing.assert_allclose(reduced_crest(sine, phases, 0), phases)


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"samples": 0}, "samples: 0; a whole number >= 3"),
        ({"samples": 400.0}, r"samples: 400\.0; a whole number"),
        ({"inputs": 0}, "inputs: 0; a whole number >= 1"),
        ({"sample_time": 0.0}, r"sample_time \[s\]: 0\.0 is not a number > 0"),
        ({"lines": [1, 200]}, "line 200 is not between 1 and the last below .* 199, of 400"),
        ({"lines": [0, 1]}, "line 0 is not between 1"),
        ({"lines": [1, 4]}, "lines: line 4 is even; leave it out or give odd=False"),
        ({"lines": [3, 1]}, "lines: 1 follows 3; lines must rise"),
        ({"lines": [1.5]}, "lines: an array .* of whole numbers"),
        ({"lines": []}, "lines: none given"),
        ({"detection": [5]}, "detection: line 5 is among the excited lines too"),
        ({"detection": [8]}, "detection: line 8 is even"),
        ({"amplitudes": np.ones(2)}, r"amplitudes: shape \(2,\) given; \(3,\), one per line, or"),
        ({"amplitudes": np.ones((3, 3))}, r"amplitudes: shape \(3, 3\)"),
        ({"amplitudes": [[1, 1], [1, 0], [1, 1]]}, r"amplitudes\[1, 1\]: 0 is not positive"),
        ({"amplitudes": np.nan}, r"amplitudes\[0, 0\]: nan is not positive"),
    ],
)
def test_errors_name_the_line(keywords, message):
    good = {"samples": N, "sample_time": T, "lines": [1, 3, 5], "inputs": 2}
    Multisine(**good)
    with pytest.raises(InvalidInput, match=message) as caught:
        Multisine(**{**good, **keywords})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"band": (HZ, HZ * 250)}, "not below the Nyquist frequency 1570.8 rad/s"),
        ({"band": (HZ * 5, HZ)}, r"band: \(31.4159, 6.28319\) rad/s; 0 < low <= high"),
        ({"band": (16.0, 16.5)}, "no odd line lies between 16 and 16.5 rad/s"),
        ({"count": 24}, "count: 24 lines; the band holds 23"),
        ({"spacing": "quasi_log"}, "count: quasi-logarithmic spacing needs a number"),
        ({"spacing": "log", "count": 3}, "spacing: 'log' is unknown"),
        ({"detection_group": 3}, "rng: a numpy.random.Generator is needed"),
        ({"detection_group": 1, "rng": np.random.default_rng()}, "detection_group: 1; a number"),
    ],
)
def test_errors_of_a_band(keywords, message):
    with pytest.raises(InvalidInput, match=message):
        band_multisine(**{"samples": N, "sample_time": T, "band": BAND, "inputs": 2, **keywords})


def test_errors_of_phases():
    sine = grid()
    rng = np.random.default_rng(0)
    with pytest.raises(InvalidInput, match="blocks: 0; a whole number >= 1"):
        random_phases(sine, 0, rng=rng)
    with pytest.raises(InvalidInput, match=r"phases: shape \(23, 2\) given; \(..., 23, 3\)"):
        sine.reference(np.zeros((23, 2)))
    with pytest.raises(InvalidInput, match=r"phases: shape \(23, 3\); \(B, 23, 3\) is needed"):
        reduced_crest(sine, np.zeros((23, 3)))
    with pytest.raises(InvalidInput, match="crest_iterations: -1"):
        reduced_crest(sine, np.zeros((1, 23, 3)), -1)


def test_amplitudes_can_be_replaced():
    sine = grid().with_amplitudes(2.0)
    assert sine.amplitudes.shape == (23, 3)
    assert (sine.amplitudes == 2).all()
    with pytest.raises(ValueError, match="read-only"):
        sine.amplitudes[0, 0] = 1.0
