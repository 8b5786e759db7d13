from pathlib import Path

import numpy as np
import pytest
from scipy.stats import ncx2

import robotmodels
from estimators.validation.predictive_band import _rice, predictive_band

OMEGA = 2 * np.pi * np.geomspace(2, 60, 12)
POSITIONS = np.array([[-1.2, 0.9], [0.4, -0.7]])


@pytest.fixture(scope="module")
def robot():
    return robotmodels.load_robot(Path(__file__).parents[1] / "engines" / "two_joints.yaml")


def test_another_measurement_lies_in_the_band_as_often_as_it_says(robot):
    """Truths from the posterior, noise from weak to far above the response."""
    rng = np.random.default_rng(4)
    log_values = np.log(robot.parameters.values)
    draws = log_values + 0.05 * rng.standard_normal((400, len(log_values)))
    size = np.abs(robotmodels.frequency_response(robot, POSITIONS, OMEGA))
    std = size * rng.choice([0.01, 0.1, 1.0, 5.0], size.shape)
    inside, narrow = [], []
    lower, upper = predictive_band(robot, POSITIONS, OMEGA, draws, std)
    for _ in range(300):
        theta = np.exp(log_values + 0.05 * rng.standard_normal(len(log_values)))
        noise = rng.standard_normal((2, *std.shape)) * std / np.sqrt(2)
        y = (
            robotmodels.frequency_response(robot, POSITIONS, OMEGA, theta)
            + noise[0]
            + 1j * noise[1]
        )
        inside.append(((lower <= np.abs(y)) & (np.abs(y) <= upper)).mean())
        middle, half = (lower + upper) / 2, (upper - lower) / 4
        narrow.append((np.abs(np.abs(y) - middle) < half).mean())
    assert np.mean(inside) == pytest.approx(0.95, abs=0.01)
    assert np.mean(narrow) < 0.8  # half the band has not


def test_without_spread_it_is_the_law_of_rice(robot):
    draws = np.tile(np.log(robot.parameters.values), (3, 1))
    size = np.abs(robotmodels.frequency_response(robot, POSITIONS, OMEGA))
    for ratio in (0.0, 0.3, 2.0, 11.0, 40.0):
        std = np.maximum(size, 1e-9) / max(ratio, 1e-3)
        lower, upper = predictive_band(robot, POSITIONS, OMEGA, draws, std)
        for share, end in ((0.025, lower), (0.975, upper)):
            exact = std * np.sqrt(ncx2.ppf(share, 2, 2 * (size / std) ** 2) / 2)
            assert end == pytest.approx(exact, rel=2e-3)


def test_ends_rise_with_the_response():
    ratios, ends = _rice(0.9)
    for end in ends:
        assert np.isfinite(end).all()
        assert (np.diff(end) > 0).all()
    assert ratios[0] == 0
