"""Sampled closed-loop experiments on a linear model: exact between samples, torque held."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from robotmodels.arrays import Array, IntArray
from robotmodels.errors import InvalidInput, SolverFailed
from robotmodels.linear_model import LinearModel
from robotmodels.plant.controller import Controller
from robotmodels.records import Records

_LARGEST_POLE = 1 - 1e-9


@dataclass(frozen=True, eq=False)
class SampledLoop:
    """One step of model and controller together, from sample to sample.

    z = (coordinates, velocities, filtered speeds, integrals, last measured angles); v = (speed
    references, noise on the measured angles); o = (torques, measured angles).

    Attributes
    ----------
    step : (s, s + 2 n), next z from (z, v).
    output : (2 n, s + 2 n), o from (z, v).
    """

    step: Array
    output: Array

    @property
    def largest_pole(self) -> float:
        """Magnitude of the slowest pole; 1 and more is unstable."""
        size = len(self.step)
        return float(np.abs(np.linalg.eigvals(self.step[:, :size])).max())


def sampled_loop(model: LinearModel, controller: Controller) -> SampledLoop:
    """Return the closed loop of a linear model and `Controller`, by matrix exponential.

    Raises
    ------
    InvalidInput : if the controller has another number of motors, or the model has leading axes.
    SolverFailed : if the loop is unstable.
    """
    from scipy.linalg import expm

    n, d = model.inputs, len(model.selector)
    if model.mass.ndim != 2:
        raise InvalidInput("linear plant: one position at a time; the model has leading axes")
    if len(controller.speed_gain) != n:
        raise InvalidInput(f"controller: {len(controller.speed_gain)} motors, the model has {n}")
    T, pole = controller.sample_time, controller.filter_pole
    inverse = np.linalg.inv(model.mass)
    system = np.zeros((2 * d + n, 2 * d + n))
    system[:d, d : 2 * d] = np.eye(d)
    system[d : 2 * d] = inverse @ np.hstack([-model.stiffness, -model.damping, model.selector])
    exact = expm(system * T)[: 2 * d]
    # Rows of everything the controller computes, in terms of (z, v).
    size = 2 * d + 3 * n
    terms = np.eye(size + 2 * n)
    speed, integral, last = (terms[2 * d + i * n : 2 * d + (i + 1) * n] for i in range(3))
    reference, noise = terms[size : size + n], terms[size + n :]
    angle = model.selector.T @ terms[:d] + noise
    filtered = pole[:, None] * speed + ((1 - pole) / T)[:, None] * (angle - last)
    error = reference - controller.position_gain[:, None] * angle - filtered
    summed = integral + (T / controller.integral_time)[:, None] * error
    torque = controller.speed_gain[:, None] * (error + summed)
    motion = exact[:, : 2 * d] @ terms[: 2 * d] + exact[:, 2 * d :] @ torque
    loop = SampledLoop(
        np.concatenate([motion, filtered, summed, angle]), np.concatenate([torque, angle])
    )
    if not loop.largest_pole < _LARGEST_POLE:
        raise SolverFailed(
            f"linear plant: the closed loop is unstable (a pole of magnitude "
            f"{loop.largest_pole:.6g}); lower the controller's gains or its sample time"
        )
    return loop


def simulate_linear(
    model: LinearModel,
    signals: Array,
    controller: Controller,
    *,
    lines: IntArray,
    detection: IntArray | None = None,
    angle_noise: ArrayLike = 0.0,
    rng: np.random.Generator,
    periods: int = 2,
    transient: int = 1,
) -> Records:
    """Simulate periodic experiments on a linear model, starting at rest.

    Parameters
    ----------
    model : such as ``chains.linear_model()``, one position.
    signals : (B, E, N, n) one period of the speed references [rad/s].
    controller : its sample time is that of the signals.
    lines, detection : excited and left out DFT lines of the signals, noted in the records.
    angle_noise : standard deviation of white noise on the measured angles, (n,) or one [rad].
    rng : source of the noise.
    periods, transient : periods recorded, and periods before them that are dropped.

    Raises
    ------
    InvalidInput : if shapes do not fit.
    SolverFailed : if the closed loop is unstable.
    """
    loop, n = sampled_loop(model, controller), model.inputs
    signals = np.asarray(signals, dtype=float)
    if signals.ndim != 4 or signals.shape[-1] != n:
        raise InvalidInput(
            f"signals: shape {signals.shape}; (blocks, experiments, samples, {n}) is needed"
        )
    if periods < 1 or transient < 0:
        raise InvalidInput(f"periods: {periods} measured, {transient} dropped; at least 1 and 0")
    B, E, N, _ = signals.shape
    std = np.broadcast_to(np.asarray(angle_noise, dtype=float), (n,))
    both = np.concatenate([loop.step, loop.output])
    columns = np.moveaxis(signals.reshape(B * E, N, n), 0, -1)
    # Integrals and angles start where the loop is at rest: all zero.
    state = np.zeros((len(loop.step), B * E))
    kept = np.empty((periods * N, 2 * n, B * E))
    for k in range((transient + periods) * N):
        noise = std[:, None] * rng.standard_normal((n, B * E))
        after = both @ np.concatenate([state, columns[k % N], noise])
        state = after[: len(state)]
        if k >= transient * N:
            kept[k - transient * N] = after[len(state) :]
    # (P, N, 2 n, B, E) to (1, B, E, P, N, 2 n)
    samples = kept.reshape(periods, N, 2 * n, B, E).transpose(3, 4, 0, 1, 2)[None]
    return Records(
        positions=np.zeros((1, n)),
        sample_time=controller.sample_time,
        reference=signals[None, :, :, None],
        torque=samples[..., :n],
        angle=samples[..., n:],
        lines=lines,
        detection=np.array([], dtype=np.int64) if detection is None else detection,
        saturated=np.zeros((1, B, E, periods, n), dtype=bool),
    )
