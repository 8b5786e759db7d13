"""Linear models as x' = A x + B u, y = C x + D u, first-order lags included."""

import numpy as np

from robotmodels.common.arrays import Array, IntArray
from robotmodels.linear.linear_model import LinearModel

Matrices = tuple[Array, Array, Array, Array]
"""A, B, C and D, each with leading axis Q."""


def state_matrices(model: LinearModel, count: int) -> Matrices:
    """Return A, B, C and D at `count` equilibria; delays are left out.

    States are the coordinates, their rates, torques that lag, readings that lag.
    """
    measured, d = model.measured, len(model.selector)
    C0, C1, C2 = (
        np.broadcast_to(c, (count, *c.shape[-2:]))
        for c in (measured.position, measured.velocity, measured.acceleration)
    )
    inverse = np.linalg.inv(model.mass)
    forces = inverse @ (model.selector * measured.torque.gain)
    K, D = inverse @ model.stiffness, inverse @ model.damping
    zeros = np.zeros(K.shape)
    A = np.block([[zeros, np.broadcast_to(np.eye(d), K.shape)], [-K, -D]])
    B = np.concatenate([np.zeros(forces.shape), forces], axis=1)
    C = np.concatenate([C0 - C2 @ K, C1 - C2 @ D], axis=2)
    direct = 0.0 if measured.feedthrough is None else measured.feedthrough * measured.torque.gain
    matrices = A, B, C, C2 @ forces + direct
    matrices = _lagging_inputs(matrices, np.asarray(measured.torque.lag))
    if measured.sensor is None:
        return matrices
    A, B, C, D = _lagging_outputs(matrices, np.asarray(measured.sensor.lag))
    gain = measured.sensor.gain[:, None]
    return A, B, gain * C, gain * D


def _lagging_inputs(matrices: Matrices, lag: Array) -> Matrices:
    """Return the matrices with first-order lags (n,) [s]: w in place of u, w' = (u - w) / lag."""
    A, B, C, D = matrices
    behind, rate, selected = _lags(lag, len(A))
    none = np.zeros((len(A), len(behind), A.shape[2]))
    return (
        np.block([[A, B[..., behind]], [none, -rate]]),
        np.concatenate([np.where(lag > 0, 0.0, B), rate @ selected], axis=1),
        np.concatenate([C, D[..., behind]], axis=2),
        np.where(lag > 0, 0.0, D),
    )


def _lagging_outputs(matrices: Matrices, lag: Array) -> Matrices:
    """Return the matrices with first-order lags (m,) [s]: z in place of y, z' = (y - z) / lag."""
    A, B, C, D = matrices
    behind, rate, selected = _lags(lag, len(A))
    none = np.zeros((len(A), A.shape[1], len(behind)))
    at_once = (lag == 0)[:, None]
    readings = np.broadcast_to(selected.T, (len(A), *selected.T.shape))
    return (
        np.block([[A, none], [rate @ C[:, behind], -rate]]),
        np.concatenate([B, rate @ D[:, behind]], axis=1),
        np.concatenate([at_once * C, readings], axis=2),
        at_once * D,
    )


def _lags(lag: Array, count: int) -> tuple[IntArray, Array, Array]:
    """Return which signals lag, their rates (count, l, l), and what selects them, (l, signals)."""
    behind = np.flatnonzero(lag > 0)
    rate = np.diag(1 / lag[behind])
    selected = np.eye(len(lag))[behind]
    return behind, np.broadcast_to(rate, (count, *rate.shape)), selected
