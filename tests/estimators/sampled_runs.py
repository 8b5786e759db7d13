"""Sampled runs of a small elastic system that do not end as they began, and closed-loop ones."""

import numpy as np
from mass_springs import MassSprings
from scipy.linalg import expm

from estimators import covariance
from robotmodels.records.records import Records

MODEL = MassSprings()
TRUTH = MODEL.parameters.values
SAMPLE_TIME = 0.01
POSITIONS = np.array([[0.0, 0.0], [0.7, 0.0]])
ANGLE, TORQUE = 3e-5, 0.05  # standard deviations of noise in a sample
DERIVATIVE = 0.2  # s, of the loop's angle feedback


def continuous(position):
    """A and B of x' = A x + B u, x angles and speeds of all coordinates."""
    model = MODEL.network(position[None], TRUTH).linear_model().at(0)
    d = len(model.mass)
    A, B = np.zeros((2 * d, 2 * d)), np.zeros((2 * d, 2))
    A[:d, d:] = np.eye(d)
    A[d:] = -np.linalg.solve(model.mass, np.hstack([model.stiffness, model.damping]))
    B[d:] = np.linalg.solve(model.mass, model.selector)
    return A, B


def sampled(position):
    """Ad and Bd of a torque that is held over a sample."""
    A, B = continuous(position)
    d = len(A)
    wide = expm(SAMPLE_TIME * np.block([[A, B], [np.zeros((2, d + 2))]]))
    return wide[:d, :d], wide[:d, d:]


def sampled_records(rng, runs=1, samples=512, feedback=0.0, lines=None, seen=(0, 1)):
    """Runs of random torques, or of a multisine in a loop whose noise is fed back.

    Torques and angles, of the coordinates `seen`, have white noise; in a loop, which turns
    `feedback` times the two measured angles into torque, torques are known exactly.
    """
    seen = list(seen)
    k = np.arange(6, samples // 8) if lines is None else lines
    before, shape = 4 * samples, (runs, samples, 2)
    torque, angle = np.empty((2, *shape)), np.empty((2, *shape[:2], len(seen)))
    for q, position in enumerate(POSITIONS):
        A, B = sampled(position)
        u = excitation(rng, k, runs, samples, before, bool(feedback))
        e = ANGLE * rng.standard_normal((*u.shape[:2], len(seen)))
        x, last = np.zeros((runs, len(A))), 0.0
        for i in range(u.shape[1]):
            y = x[:, seen] + e[:, i]
            if feedback:
                u[:, i] -= feedback * (y + DERIVATIVE * (y - last) / SAMPLE_TIME)
            x, e[:, i], last = x @ A.T + u[:, i] @ B.T, y, y
        torque[q], angle[q] = u[:, before:], e[:, before:]
    torque, angle = (x[:, None, :, None] for x in (torque, angle))  # (Q, B, E, P, N, n)
    if not feedback:
        torque = torque + TORQUE * rng.standard_normal(torque.shape)
    none = np.zeros((*torque.shape[:4], 2), dtype=bool)
    rest = np.setdiff1d(np.arange(1, samples // 8), k)
    rest = rest[rest % 2 == 1]
    return Records(POSITIONS, SAMPLE_TIME, np.zeros_like(torque), torque, angle, k, rest, none)


def excitation(rng, lines, runs, samples, before, multisine):
    """Torques (E, N, 2), white, or the sum of sines at some lines with random phases."""
    if not multisine:
        return rng.standard_normal((runs, before + samples, 2))
    spectrum = np.zeros((runs, samples // 2 + 1, 2), dtype=complex)
    phases = rng.random((runs, len(lines), 2))
    spectrum[:, lines] = np.exp(2j * np.pi * phases) * samples / np.sqrt(len(lines))
    return np.tile(np.fft.irfft(spectrum, samples, axis=1), (1, before // samples + 1, 1))


def shares(fits):
    """How often intervals of 95 % cover (count, 6), and mean cost over its expectation."""
    covers, costs = [], []
    for fitted in fits:
        uncertainty = covariance(fitted)
        z = np.log(fitted.parameters.values / TRUTH) / uncertainty.std
        covers.append(np.abs(z) < uncertainty.quantile(0.95))
        costs.append(fitted.cost / fitted.expected_cost)
    return np.array(covers), float(np.mean(costs))
