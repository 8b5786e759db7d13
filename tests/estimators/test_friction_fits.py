"""Runs of a plant with Coulomb friction: springs within their intervals once it is counted."""

import numpy as np
import pytest
from robots import BALANCED, built, changed

import robotmodels
from estimators import RunFit, fit, run_spectra
from robotmodels import ElasticRobot, Imperfections, InvalidInput, Records, default_controller

T, N = 5e-4, 4000
POSITIONS = np.array([[0.3, -1.0, 0.9], [0.2, -0.6, -0.8]])
ODD = np.arange(5, 241, 2)  # 2.5 to 120 Hz
DETECTION = ODD[3::4]
LINES = np.setdiff1d(ODD, DETECTION)
FLAWS = Imperfections(nonlinear_gears=False, angle_noise=3e-6, torque_disturbance=2e-3)


def braked() -> ElasticRobot:
    friction = [
        {"name": "f2", "joint": "shoulder_lift_joint", "viscous": 40.0},
        {"name": "f3", "joint": "elbow_joint", "viscous": 10.0, "coulomb": 2.0}
        | {"coulomb_width": 2e-3},
    ]
    parameters = {"extra": ["f2.viscous"]}
    return built(changed(BALANCED, counterbalances=[], friction=friction, parameters=parameters))


def records(robot: ElasticRobot, runs: int, seed: int) -> Records:
    """Return blocks of up to three `runs` with random phases, orthogonal from run to run."""
    blocks, order = -(-runs // 3), np.arange(3)
    turns = np.random.default_rng(seed).random((blocks, 1, 3, len(LINES)))
    turns = turns + (np.outer(order, order) / 3)[..., None]
    spectrum = np.zeros((blocks, 3, 3, N // 2 + 1), dtype=complex)
    spectrum[..., LINES] = np.exp(2j * np.pi * turns)
    signals = np.swapaxes(np.fft.irfft(0.015 * N * spectrum, n=N), 2, 3)[:, : min(runs, 3)]
    settings = {"imperfections": FLAWS, "transient": 3, "periods": 4}
    return Records.join(
        list(
            robotmodels.simulate(
                robot,
                POSITIONS,
                signals,
                default_controller(robot, T),
                lines=LINES,
                detection=DETECTION,
                rng=np.random.default_rng(seed),
                **settings,
            )
        )
    )


def deviations(found: RunFit, truth: ElasticRobot) -> np.ndarray:
    """Return errors of the three stiffnesses over their standard deviations."""
    pairs = zip(found.intervals(), truth.parameters.values, strict=True)
    return np.array([(one.value - value) / one.std for one, value in pairs])[:3]


@pytest.mark.parametrize("runs", [1, 2, 3, pytest.param(6, marks=pytest.mark.slow)])
def test_springs_are_within_their_intervals(runs: int) -> None:
    robot = braked()
    data = records(robot, runs, seed=runs)
    counted = robotmodels.at_recorded_speeds(robot, data)
    spectra = run_spectra(data, "detection")
    found = fit(counted, spectra)
    # Verdicts differ from seed to seed: what friction distorts is correlated over lines.
    assert 0.7 < found.cost / found.expected_cost < 1.3
    assert np.abs(deviations(found, robot)).max() < 4.0
    assert max(one.std / one.value for one in found.intervals()[:3]) < 0.05
    # Without it, a linear model is refused.
    without = fit(robot, spectra)
    assert without.verdict == "model error"
    assert without.cost > 4 * without.expected_cost


def test_records_without_angles_of_motors() -> None:
    robot = braked()
    other = built(changed(BALANCED, outputs=[{"joint": "elbow_joint", "quantity": "angle"}]))
    data = records(robot, 1, seed=0)
    with pytest.raises(InvalidInput, match="an angle of each motor is needed, m0, m1, m2"):
        robotmodels.at_recorded_speeds(other, data)
