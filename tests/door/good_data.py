"""Good records of three robots, made line by line from their FRFs: what the alterations spoil."""

from dataclasses import dataclass

import numpy as np

from robotmodels import ElasticRobot, Records, frequency_response, load_robot

ROBOTS = ("manutec_r3", "ur10", "moberg_axis1")
SAMPLES, BLOCKS, PERIODS, POSITIONS = 400, 4, 3, 3
SAMPLE_TIME = 0.005
LINES = np.arange(1, 120, 4)
NOISE = 0.02  # of the angle's spectrum at each line, relative to what the torque moves


@dataclass(frozen=True, eq=False)
class GoodData:
    """Records of a robot, and the robot."""

    robot: ElasticRobot
    records: Records
    seed: int


def good_data(name: str, seed: int) -> GoodData:
    """Return records with random phases and noise, spectra and hold as `spectra` has them."""
    robot, rng = load_robot(name), np.random.default_rng([seed, ROBOTS.index(name)])
    n, F = len(robot.motor_names), len(LINES)
    low, high = np.clip(robot.position_limits.T, -1.2, 1.2)
    positions = rng.uniform(low, high, (POSITIONS, n))
    omega = 2 * np.pi * LINES / (SAMPLES * SAMPLE_TIME)
    G = frequency_response(robot, positions, omega)  # (Q, F, n, n)
    # Each motor has phases of its own; orthogonal over the runs of a block.
    phases = rng.uniform(0, 2 * np.pi, (POSITIONS, BLOCKS, F, n))
    turn = np.exp(2j * np.pi * np.outer(np.arange(n), np.arange(n)) / n)
    torque = np.exp(1j * phases)[..., None] * turn  # (Q, B, F, n, E)
    half = omega * SAMPLE_TIME / 2
    held = np.sinc(half / np.pi) * np.exp(-1j * half)
    angle = G[:, None] @ (torque * held[:, None, None]) / -(omega**2)[:, None, None]
    size = np.sqrt((np.abs(angle) ** 2).mean(axis=(-1, -4), keepdims=True))
    torque_size = np.full_like(size, 0.1)
    signals = [
        _in_time(spectrum[:, :, None]) + _noise(NOISE * level, rng, n)
        for spectrum, level in ((torque, torque_size), (angle, size))
    ]
    reference = _in_time(torque[:, :, None])
    shape = (POSITIONS, BLOCKS, n, PERIODS, n)
    records = Records(
        positions=positions,
        sample_time=SAMPLE_TIME,
        reference=reference,
        torque=signals[0],
        angle=signals[1],
        lines=LINES,
        detection=np.empty(0, dtype=int),
        saturated=np.zeros(shape, dtype=bool),
    )
    return GoodData(robot, records, seed)


def _noise(level: np.ndarray, rng: np.random.Generator, runs: int) -> np.ndarray:
    """Return noise (Q, B, E, P, N, n) at all bins, of levels (Q, 1, F, n, 1) at the lines."""
    bins = np.arange(1, SAMPLES // 2)
    levels = np.apply_along_axis(lambda one: np.interp(bins, LINES, one), 2, level)
    shape = (POSITIONS, BLOCKS, PERIODS, len(bins), level.shape[3], runs)
    parts = rng.standard_normal((2, *shape)) / np.sqrt(2)
    return _in_time((parts[0] + 1j * parts[1]) * levels[:, :, None], bins)


def _in_time(spectrum: np.ndarray, bins: np.ndarray = LINES) -> np.ndarray:
    """Return samples (Q, B, E, P, N, n) of coefficients (Q, B, P, F, n, E)."""
    whole = np.zeros((*spectrum.shape[:3], SAMPLES // 2 + 1, *spectrum.shape[4:]), complex)
    whole[:, :, :, bins] = spectrum * SAMPLES
    return np.fft.irfft(whole, axis=3, n=SAMPLES).transpose(0, 1, 5, 2, 3, 4)
