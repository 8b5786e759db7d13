"""The plant of motors under a linear feedback, exact from sample to sample: poles, responses."""

from collections.abc import Callable
from dataclasses import dataclass
from math import factorial

import numpy as np

from robotmodels.common.arrays import Array, ComplexArray, IntArray
from robotmodels.common.errors import InvalidInput
from robotmodels.linear.linear_model import LinearModel
from robotmodels.linear.response import Elastic
from robotmodels.simulation.discrete_loop import first_order_system, zero_order_hold
from robotmodels.simulation.linear_feedback import LinearFeedback

_LARGEST_CONDITION = 1e7
"""Of eigenvectors, beyond which nearly equal poles spoil responses."""
_PADE = 5
"""Order of the rational approximation of delays under continuous controllers, for poles alone."""


@dataclass(frozen=True, eq=False)
class LoopPlant:
    """x+ = A x + B0 u(-m) + B1 u(-m-1), or x' = A x + B0 u(t - delay); motor angles C x.

    Attributes
    ----------
    A : ndarray, (N, N)
        State matrix, over a sample or in continuous time.
    B0, B1 : ndarray, (N, n)
        By torques of one sample, and of that before it.
    C : ndarray, (n, N)
        Motor angles by states.
    whole : ndarray of int, (n,)
        Whole samples m of delay by motor.
    delay : ndarray, (n,), s
        All delay, of torques and of what is measured.
    sample_time : float or None, s
        None in continuous time.
    """

    A: Array
    B0: Array
    B1: Array
    C: Array
    whole: IntArray
    delay: Array
    sample_time: float | None

    def response(self) -> Callable[[Array | ComplexArray], ComplexArray]:
        """Return G at omega (F,), (F, n, n); complex omega is -j s."""
        resolvent = self._resolvent()

        def at(omega: Array | ComplexArray) -> ComplexArray:
            jw: ComplexArray = np.asarray(1j * np.asarray(omega))[:, None]
            late: ComplexArray = np.exp(-jw * self.delay)[:, None, :].astype(complex)
            point = jw
            if self.sample_time is not None:
                point = np.exp(jw * self.sample_time)
                late = (point ** (-self.whole.astype(float)))[:, None, :]
            both = resolvent(point)
            n = self.B0.shape[1]
            return np.asarray(late * (both[..., :n] + both[..., n:] / point[:, None]))

        return at

    def _resolvent(self) -> Callable[[ComplexArray], ComplexArray]:
        """Return C (s - A)^-1 (B0, B1), (F, n, 2 n), at points (F, 1), by the eigenvalues of A."""
        poles, vectors = np.linalg.eig(self.A)
        inputs = np.hstack([self.B0, self.B1]).astype(complex)
        if np.linalg.cond(vectors) > _LARGEST_CONDITION:  # rigid motions without any friction
            unit = np.eye(len(self.A))
            return lambda point: np.asarray(
                self.C @ np.linalg.solve(point[..., None] * unit - self.A, inputs)
            )
        seen, driven = self.C @ vectors, np.linalg.solve(vectors, inputs)
        return lambda point: np.asarray((seen * (1 / (point - poles))[:, None, :]) @ driven)


def checked_models(
    robot: Elastic, positions: Array, feedback: LinearFeedback, parameters: Array | None
) -> LinearModel:
    """Return the linear models at `positions` (Q, n) of a robot that a controller fits.

    Raises
    ------
    InvalidInput
        If the controller has another number of motors.
    """
    models = robot.network(np.atleast_2d(positions), parameters).linear_model()
    if models.inputs != len(feedback.D):
        raise InvalidInput(f"controller: {len(feedback.D)} motors, the robot has {models.inputs}")
    return models


def loop_plant(model: LinearModel, time: float | None) -> LoopPlant:
    """Return the plant of a linear model, whatever its robot measures; `time` of a sample [s]."""
    n, d = model.inputs, len(model.selector)
    system = first_order_system(model)
    size = len(system)
    C = np.hstack([model.selector.T, np.zeros((n, size - d))])
    delay = model.measured.delay + model.measured.torque.delay
    none, zero = np.zeros((size, n)), np.zeros(n, dtype=int)
    if time is None:
        return LoopPlant(system[:, :size], system[:, size:], none, C, zero, delay, None)
    whole = np.floor(delay / time + 1e-9).astype(int)
    parts = np.maximum(delay / time - whole, 0.0)
    over_sample = zero_order_hold(model, time)
    B0 = over_sample[:, size:].copy()
    for i in np.flatnonzero(parts > 1e-9):  # a torque arrives within a sample
        B0[:, i] = zero_order_hold(model, (1 - parts[i]) * time)[:, size + i]
    return LoopPlant(over_sample[:, :size], B0, over_sample[:, size:] - B0, C, whole, delay, time)


def loop_poles(plant: LoopPlant, feedback: LinearFeedback) -> ComplexArray:
    """Return the poles of the closed loop, of s or of z."""
    if plant.sample_time is None:
        return _continuous_poles(plant, feedback)
    size, n, h = len(plant.A), len(feedback.D), len(feedback.A)
    memory = plant.whole + plant.B1.any(axis=0)
    total = size + h + int(memory.sum())
    terms, starts = np.eye(total), size + h + np.concatenate([[0], np.cumsum(memory)])
    x, c = terms[:size], terms[size : size + h]
    y = plant.C @ x
    u = -(feedback.C @ c + feedback.D @ y)
    x = plant.A @ x
    rows = [feedback.A @ c + feedback.B @ y]
    for i in range(n):
        past = np.vstack([u[i : i + 1], terms[starts[i] : starts[i + 1]]])  # newest first
        m = plant.whole[i]
        x = x + np.outer(plant.B0[:, i], past[m])
        if len(past) > m + 1:
            x = x + np.outer(plant.B1[:, i], past[m + 1])
        rows.append(past[: memory[i]])
    return np.asarray(np.linalg.eigvals(np.vstack([x, *rows])), dtype=complex)


def _continuous_poles(plant: LoopPlant, feedback: LinearFeedback) -> ComplexArray:
    from scipy.linalg import block_diag

    # Torques pass their delays before they reach the plant.
    delays = [_pade(delay) for delay in plant.delay]
    Ad, Bd, Cd, Dd = (block_diag(*part) for part in zip(*delays, strict=True))
    F, h, k = feedback, len(feedback.A), len(Ad)
    y = np.hstack([plant.C, np.zeros((len(F.D), k + h))])
    command = -(np.hstack([F.D @ plant.C, np.zeros((len(F.D), k)), F.C]))
    size = len(plant.A)
    late = np.hstack([np.zeros((len(F.D), size)), Cd, np.zeros((len(F.D), h))]) + Dd @ command
    rows = [
        np.hstack([plant.A, np.zeros((size, k + h))]) + plant.B0 @ late,
        np.hstack([np.zeros((k, size)), Ad, np.zeros((k, h))]) + Bd @ command,
        np.hstack([np.zeros((h, size + k)), F.A]) + F.B @ y,
    ]
    return np.asarray(np.linalg.eigvals(np.vstack(rows)), dtype=complex)


def _pade(delay: float) -> tuple[Array, Array, Array, Array]:
    """Return matrices of a rational approximation of e^{-s delay}, all-pass."""
    from scipy.signal import tf2ss

    if delay == 0:
        return np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1))
    N = _PADE
    powers = np.arange(N, -1, -1)
    scale = np.array([factorial(2 * N - k) / (factorial(k) * factorial(N - k)) for k in powers])
    A, B, C, D = tf2ss(scale * (-1.0) ** powers, scale)
    return A / delay, B / delay, C, D  # of s delay
