"""A 2 x 2 closed loop at a single line, as spectra, and an elastic pair of motors as samples."""

from dataclasses import dataclass

import numpy as np
from derivatives import circular

from robotmodels.records.records import Records

RESPONSE = np.array([[1 + 0.3j, 0.3 - 0.2j], [0.25 + 0.1j, 0.6 - 0.5j]])
FEEDBACK = np.diag([1.5, 2.0]) * np.exp(-0.6j)
FOURIER = np.array([[1, 1], [1, -1]])


def references(shape, rng):
    """Random phases for each block, times the Fourier matrix: (..., 2, 2)."""
    phases = np.exp(2j * np.pi * rng.random((*shape, 2)))
    return phases[..., :, None] * FOURIER


def loop_spectra(runs, std, rng, blocks=10, periods=1, signal=1.0):
    """Y, U, R (runs, blocks, periods, 2, 2) with noise V of `std` on the output."""
    R = signal * references((runs, blocks), rng)[:, :, None]
    V = std * circular(rng, runs, blocks, periods, 2, 2)
    U = np.linalg.solve(np.eye(2) + FEEDBACK @ RESPONSE, FEEDBACK @ (R - V))
    return RESPONSE @ U + V, U, np.broadcast_to(R, U.shape)


SAMPLES, SAMPLE_TIME = 500, 2e-3  # lines 1 Hz apart
LINES = np.array([k for k in range(3, 80, 2) if k % 10 != 5])
DETECTION = np.arange(5, 80, 10)
_MASS = np.array(
    [[0.5, 0.0, 0.0, 0.0], [0.0, 0.4, 0.0, 0.0], [0.0, 0.0, 1.0, 0.3], [0.0, 0.0, 0.3, 0.8]]
)
_STIFFNESS = np.array(
    [
        [9e3, 0.0, -9e3, 0.0],
        [0.0, 1.5e4, 0.0, -1.5e4],
        [-9e3, 0, 1.3e4, -4e3],
        [0, -1.5e4, -4e3, 1.9e4],
    ]
)
_DAMPING = 2e-3 * _STIFFNESS + np.diag([3.0, 3.0, 0.0, 0.0])


def truth(omega):
    """Torque to acceleration of the motors, (F, 2, 2)."""
    w = np.asarray(omega)[:, None, None]
    A = _STIFFNESS - w**2 * _MASS + 1j * w * _DAMPING
    return (-(w**2) * np.linalg.inv(A))[:, :2, :2]


@dataclass(frozen=True)
class Bench:
    """What is done to the elastic pair; every field is independent of the others."""

    blocks: int = 4
    experiments: int = 2
    periods: int = 3
    noise: float = 0.0  # rad, white, on the angle and through the feedback
    transient: float = 0.0  # part of the signal, decaying by 1/e every 0.3 periods
    cubic: float = 0.0  # odd distortion of the acceleration
    square: float = 0.0  # even distortion
    delay: float = 0.0  # s
    hold: bool = True
    seed: int = 0
    feedback: float = 0.0  # torque per (minus) angle


def bench_records(setup=Bench()):
    """Sample one position of a closed loop whose noise travels through a proportional feedback.

    Multisines over LINES; the torque is commanded at the samples, its continuous-time
    coefficients follow from the hold, the angle is sampled from the continuous response.
    """
    rng = np.random.default_rng(setup.seed)
    omega = 2 * np.pi * LINES / (SAMPLES * SAMPLE_TIME)
    G = truth(omega)
    held = hold_factor(omega) if setup.hold else np.ones(len(omega))
    plant = held[:, None, None] * G / -(omega**2)[:, None, None]
    plant = plant * np.exp(-1j * omega * setup.delay)[:, None, None]
    shape = (setup.blocks, setup.experiments, setup.periods, SAMPLES, 2)
    R = np.moveaxis(references((setup.blocks, len(omega)), rng), 1, -1)  # (B, n, E, F)
    R = np.moveaxis(R, 1, -1)[:, : setup.experiments]  # (B, E, F, n)
    noise = setup.noise * rng.standard_normal(shape)
    closing = np.linalg.inv(np.eye(2) + setup.feedback * plant)
    U = np.einsum(
        "fij,bepfj->bepfi", closing, np.broadcast_to(R[:, :, None], (*shape[:3], *R.shape[2:]))
    )
    torque = samples(U)
    clean = samples(np.einsum("fij,bepfj->bepfi", plant, U))
    size = clean.std()
    by_noise = answer_to_noise(setup, noise)
    torque = torque + by_noise[0]
    angle = clean + by_noise[1] + noise
    angle = angle + size * (setup.cubic * (clean / size) ** 3 + setup.square * (clean / size) ** 2)
    time = np.arange(setup.periods * SAMPLES).reshape(setup.periods, SAMPLES, 1) / SAMPLES
    angle = angle + setup.transient * size * np.exp(-time / 0.3)
    reference = samples(R[:, :, None])
    return Records(
        positions=np.array([[0.1, -0.2]]),
        sample_time=SAMPLE_TIME,
        reference=reference[None],
        torque=torque[None],
        angle=angle[None],
        lines=LINES,
        detection=DETECTION,
        saturated=np.zeros((1, *shape[:3], 2), dtype=bool),
    )


def answer_to_noise(setup, noise):
    """Torque and angle that the feedback makes of noise, over all periods without a seam."""
    B, E, P, N, n = noise.shape
    V = np.fft.rfft(noise.reshape(B, E, P * N, n), axis=2)
    omega = 2 * np.pi * np.arange(1, V.shape[2]) / (P * N * SAMPLE_TIME)
    held = hold_factor(omega) if setup.hold else np.ones(len(omega))
    late = np.exp(-1j * omega * setup.delay)
    plant = (held * late / -(omega**2))[:, None, None] * truth(omega)
    closing = np.linalg.inv(np.eye(2) + setup.feedback * plant)
    U = np.zeros_like(V)
    Y = np.zeros_like(V)
    U[:, :, 1:] = np.einsum("fij,befj->befi", -setup.feedback * closing, V[:, :, 1:])
    Y[:, :, 1:] = np.einsum("fij,befj->befi", plant, U[:, :, 1:])
    return [np.fft.irfft(a, P * N, axis=2).reshape(noise.shape) for a in (U, Y)]


def samples(coefficients):
    """Sample signals with Fourier coefficients (..., F, n) at LINES, (..., N, n)."""
    spectrum = np.zeros(
        (*coefficients.shape[:-2], SAMPLES // 2 + 1, coefficients.shape[-1]), complex
    )
    spectrum[..., LINES, :] = coefficients * SAMPLES
    return np.fft.irfft(spectrum, SAMPLES, axis=-2)


def hold_factor(omega):
    """The mean of e^{-j omega t} over a sample: what a held sample contributes."""
    T = SAMPLE_TIME
    return (1 - np.exp(-1j * omega * T)) / (1j * omega * T)
