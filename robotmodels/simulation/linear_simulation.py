"""Sampled closed-loop runs on a linear model."""

import numpy as np
from numpy.typing import ArrayLike

from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.errors import InvalidInput, SolverFailed
from robotmodels.linear.linear_model import LinearModel
from robotmodels.records.records import Records, check_periods
from robotmodels.simulation.controller import Controller
from robotmodels.simulation.discrete_loop import sampled_loop

_LARGEST_POLE = 1 - 1e-9


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
    """Simulate periodic runs on a linear model, starting at rest.

    Parameters
    ----------
    model : LinearModel
        Such as ``chains.linear_model()``, one position.
    signals : ndarray, (B, E, N, n), rad/s
        One period of the speed references.
    controller : Controller
        Its sample time is that of the signals.
    lines : ndarray of int
        Excited DFT lines of the signals, noted in the records.
    detection : ndarray of int, optional
        Lines that are left out on purpose, noted in the records.
    angle_noise : array_like, rad
        Standard deviation of white noise on the measured angles, (n,) or one.
    rng : Generator
        Source of the noise.
    periods, transient : int
        Periods recorded, and periods before them that are dropped.

    Raises
    ------
    InvalidInput
        If shapes do not fit.
    SolverFailed
        If the closed loop is unstable.
    """
    loop, n = sampled_loop(model, controller), model.inputs
    if not loop.largest_pole < _LARGEST_POLE:
        raise SolverFailed(
            f"linear plant: the closed loop is unstable (a pole of magnitude "
            f"{loop.largest_pole:.6g}); lower the controller's gains or its sample time"
        )
    signals = np.asarray(signals, dtype=float)
    if signals.ndim != 4 or signals.shape[-1] != n:
        raise InvalidInput(
            f"signals: shape {signals.shape}; (blocks, runs, samples, {n}) is needed"
        )
    check_periods(periods, transient)
    B, E, N, _ = signals.shape
    references = np.moveaxis(signals.reshape(B * E, N, n), 0, -1)
    std = np.broadcast_to(np.asarray(angle_noise, dtype=float), (n,))
    trace = loop.run(references, std, rng, transient, periods)
    # (P N, 2 n, B E) to (1, B, E, P, N, 2 n)
    samples = trace.reshape(periods, N, 2 * n, B, E).transpose(3, 4, 0, 1, 2)[None]
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
