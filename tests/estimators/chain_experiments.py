"""Closed-loop experiments on the case study of [HBH], with modal damping, sampled and noisy."""

import numpy as np

from robotmodels.linear.chain_responses import modally_damped
from robotmodels.linear.coupled_chains import CoupledChains
from robotmodels.simulation.controller import Controller
from robotmodels.simulation.linear_simulation import simulate_linear

MASSES = np.array([[0.7, 2, 3], [4, 5, 6], [7, 8, 9]])
SPRINGS = np.array([[1000.0, 2000], [3000, 4000], [5000, 6000]])
COUPLINGS = np.array([[0.0, 1, 2], [1, 0, 3], [2, 3, 0]])
TRUTH = np.array([*MASSES.ravel(), *SPRINGS.ravel(), 1.0, 2.0, 3.0])
MODEL = modally_damped(CoupledChains(MASSES, SPRINGS, COUPLINGS).linear_model(), 0.005)
SAMPLE_TIME, SAMPLES, BLOCKS, PERIODS = 0.005, 4000, 2, 10  # a period of 20 s
LINES = np.arange(9, 201, 2)  # 0.45 to 10 Hz
CONTROLLER = Controller(
    np.array([14.0, 80.0, 140.0]), np.full(3, 1.0), np.full(3, 1.0), SAMPLE_TIME
)


def references(rng, lines=LINES, blocks=BLOCKS):
    """Orthogonal random-phase multisines, (blocks, 3, samples, 3) [rad/s]."""
    phases = np.exp(2j * np.pi * rng.random((blocks, len(lines), 3)))
    turns = np.exp(2j * np.pi * np.outer(np.arange(3), np.arange(3)) / 3)
    spectrum = np.zeros((blocks, 3, SAMPLES // 2 + 1, 3), dtype=complex)
    spectrum[:, :, lines] = phases[:, None] * turns[None, :, None, :]
    return np.fft.irfft(spectrum, SAMPLES, axis=2) * SAMPLES / 50


def campaigns(count, rng, noise=0.01):
    """Records of `count` campaigns alike but for the noise, 1 % of the angles' rms."""
    signals = references(rng)
    common = {"lines": LINES, "rng": rng}
    quiet = simulate_linear(MODEL, signals, CONTROLLER, **common, periods=1, transient=3)
    rms = quiet.angle.std(axis=(0, 1, 2, 3, 4))
    records = simulate_linear(
        MODEL,
        np.tile(signals, (count, 1, 1, 1)),
        CONTROLLER,
        **common,
        angle_noise=noise * rms,
        periods=PERIODS,
        transient=2,
    )
    from dataclasses import replace

    for k in range(count):
        part = slice(k * BLOCKS, (k + 1) * BLOCKS)
        names = ("reference", "torque", "angle", "saturated")
        yield replace(records, **{name: getattr(records, name)[:, part] for name in names})
