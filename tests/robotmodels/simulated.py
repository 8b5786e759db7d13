"""Simulated experiments with multisines, and the FRFs that they give."""

from typing import Any

import numpy as np
from robots import PENDULUM, built, changed

from robotmodels import ElasticRobot, Records, default_controller, simulate

T = 5e-4
UR10_POSITION = np.array([[0.3, -1.0, 1.0, 0.5, 0.7, 0.2]])


def multisines(n: int, samples: int, lines: np.ndarray, amplitude: float) -> np.ndarray:
    """Return one block of orthogonal random-phase multisines, (1, n, samples, n)."""
    phases = np.exp(2j * np.pi * np.random.default_rng(5).random((n, len(lines))))
    order = np.arange(n)
    turns = np.exp(2j * np.pi * np.outer(order, order) / n)  # (motor, experiment)
    spectrum = np.zeros((n, n, samples // 2 + 1), dtype=complex)
    spectrum[:, :, lines] = turns.T[:, :, None] * phases * amplitude * samples / 2
    return np.swapaxes(np.fft.irfft(spectrum, n=samples), 1, 2)[None]


def odd_lines(samples: int, low: float = 2.0, high: float = 60.0) -> np.ndarray:
    lines = np.arange(1, samples // 2, 2)
    hertz = lines / (samples * T)
    return lines[(hertz >= low) & (hertz <= high)]


def records_of(
    robot: ElasticRobot,
    position: np.ndarray,
    *,
    samples: int = 4000,
    amplitude: float = 1e-3,
    transient: int = 2,
    seed: int = 0,
    **options: Any,
) -> Records:
    lines = options.pop("lines", odd_lines(samples))
    signals = multisines(len(robot.motor_names), samples, lines, amplitude)
    (records,) = simulate(
        robot,
        np.atleast_2d(position),
        signals[:, : options.pop("experiments", None)],
        options.pop("controller", None) or default_controller(robot, T),
        lines=lines,
        rng=np.random.default_rng(seed),
        transient=transient,
        **{"periods": 1} | options,
    )
    return records


def frf(records: Records, *, hold: bool = True) -> np.ndarray:
    """Return Y U^-1 of the only block and last period, (F, n, n), torque to acceleration."""
    w = records.omega
    Y, U = (
        np.fft.fft(signal[0, 0, :, -1], axis=1)[:, records.lines].transpose(1, 2, 0)
        for signal in (records.angle, records.torque)
    )
    half = w * T / 2
    held = np.sinc(half / np.pi) * np.exp(-1j * half) if hold else np.ones_like(w)
    return -((w**2) / held)[:, None, None] * (Y @ np.linalg.inv(U))


def errors(found: np.ndarray, expected: np.ndarray) -> tuple[float, float]:
    """Return the largest errors of magnitude [-] and phase [deg] of any element."""
    ratio = found / expected
    return float(np.abs(np.abs(ratio) - 1).max()), float(np.degrees(np.abs(np.angle(ratio))).max())


def pendulum(**motor: float) -> ElasticRobot:
    return built(changed(PENDULUM, motors=[PENDULUM["motors"][0] | motor]))
