import numpy as np
import pytest

import robotmodels
from reports import plots
from reports.figures.excitation_figures import run_of
from reports.figures.svg import LIGHT

SAMPLES, SAMPLE_TIME, LINES = 400, 0.01, np.array([3, 7])
TIME = SAMPLE_TIME * np.arange(SAMPLES)
OMEGA = 2 * np.pi * LINES / (SAMPLES * SAMPLE_TIME)


@pytest.fixture(scope="module")
def records():
    torque = 5 + 2 * np.cos(OMEGA[0] * TIME) + 0.5 * np.cos(OMEGA[1] * TIME + 1)
    angle = 1 + 0.1 * np.sin(OMEGA[0] * TIME)
    shape = (1, 1, 1, 1, SAMPLES, 1)
    return robotmodels.Records(
        positions=np.zeros((1, 1)),
        sample_time=SAMPLE_TIME,
        reference=np.zeros(shape),
        torque=torque.reshape(shape),
        angle=angle.reshape(shape),
        lines=LINES,
        detection=np.zeros(0, dtype=int),
        saturated=np.zeros((1, 1, 1, 1, 1), dtype=bool),
    )


def test_speed_is_the_derivative_of_the_angle(records):
    run = run_of(records)
    expected = 0.1 * OMEGA[0] * np.cos(OMEGA[0] * TIME)
    np.testing.assert_allclose(run.speed[:, 0], expected, atol=1e-12)
    assert abs(run.angle.mean()) < 1e-12


def test_signals_limits_spectrum_and_crest_factor_are_drawn(records):
    limits = {"torque": np.array([9.0]), "speed": np.array([1.5])}
    figure = plots.excitation(records, ("m1",), limits)
    torque, speed, angle, spectrum = figure.axes
    drawn = torque.patches[0].get_path().vertices[:, 1]
    low, high = drawn.min(), drawn.max()
    signal = records.torque.ravel()
    assert (low, high) == pytest.approx((signal.min(), signal.max()))
    assert sorted(line.get_ydata()[0] for line in torque.lines[1:]) == [-9, 9]
    assert sorted(line.get_ydata()[0] for line in speed.lines[1:]) == [-1.5, 1.5]
    assert len(angle.lines) == 1  # the signal's own
    np.testing.assert_allclose(spectrum.lines[0].get_xdata(), OMEGA / (2 * np.pi))
    np.testing.assert_allclose(spectrum.lines[0].get_ydata(), [2, 0.5], atol=1e-12)
    deviation = signal - signal.mean()
    crest = np.abs(deviation).max() / deviation.std()
    assert torque.get_ylabel() == f"m1\ncrest {crest:.1f}"
    assert torque.patches[0].get_facecolor()[2] == pytest.approx(int(LIGHT.accent[5:7], 16) / 255)


def test_limits_far_away_are_written_instead_of_flattening_the_signal(records):
    torque, *_ = plots.excitation(records, ("m1",), {"torque": np.array([60.0])}).axes
    assert torque.get_title(loc="left") + torque.get_title() == "torque [N m], limit ±60.0"
    assert len(torque.lines) == 1
    assert max(torque.get_ylim()) < 20


def test_runs_that_are_absent_are_told(records):
    with pytest.raises(robotmodels.InvalidInput, match="run: 3; 0 to 0 are in the records"):
        plots.excitation(records, run=3)
