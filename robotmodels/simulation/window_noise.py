"""What noise in a loop leaves in the spectra of a window, the plant's transient included.

White noise v is added to measured angles, and the controller makes the arm move by it. Over N
samples the DFTs Y and U of measured angles and torques obey

    Y - G U = V + C (zI - A)^-1 z (x_0 - x_N),

with A and C of the sampled plant and x its state: the noise at the line itself, and a transient,
for what the arm does in answer to noise does not end as it began. The state x_N follows from the v
of the window and x_0 does not, so both parts are correlated. The transient is largest at lines
below the loop's bandwidth, where a period is not many times the loop's time constants.
"""

import numpy as np
from numpy.typing import NDArray

from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import SolverFailed
from robotmodels.simulation.discrete_loop import SampledLoop

_DOUBLINGS = 6
"""Of the window, after which a loop that began at rest is taken to be stationary."""

_GROWTH = 1.5
"""Of a stable loop's power when its exponent is doubled: none but rounding."""


def window_noise(loop: SampledLoop, z: ComplexArray, samples: int, std: Array) -> ComplexArray:
    """Return the covariance (F, n, n) of Y - G U, the DFTs of `samples`, exactly.

    Parameters
    ----------
    z : ndarray of complex, (F,)
        exp(j omega T) at lines of the window.
    std : ndarray, (n,), rad
        Standard deviations of the white noise on the measured angles.

    Raises
    ------
    SolverFailed
        If the loop is unstable.
    """
    from scipy.linalg import schur

    n = len(std)
    noise, torque, seen = loop.drive[:, n:], loop.outputs[:n], loop.outputs[3 * n :]
    change, spread = _state_change(loop.step, (noise * std**2) @ noise.T, samples)
    triangle, basis = schur(loop.step, output="complex")
    start = np.repeat((basis.conj().T @ noise)[:, None], len(z), axis=1)
    states = np.tensordot(basis, _resolved(triangle, z, start), 1)  # (h, F, n), per noise
    answer = np.moveaxis(np.tensordot(loop.outputs, states, 1), 1, 0)  # (F, 4 n, n)
    plant = answer[:, 3 * n :] @ np.linalg.inv(answer[:, :n] + loop.through[:n, n:])
    rows = np.moveaxis(seen @ basis - plant @ (torque @ basis), 2, 0)  # (h, F, n)
    flipped = _resolved(triangle.T[::-1, ::-1], z, rows[::-1])[::-1]
    transient = np.moveaxis(np.tensordot(basis.conj(), z[:, None] * flipped, 1), 0, 2)
    cross = np.tensordot(transient, change, 1) @ np.moveaxis(states * std**2, 1, 0)
    both = cross + np.conj(np.swapaxes(cross, -1, -2))
    remainder = np.tensordot(transient, spread, 1) @ np.conj(np.swapaxes(transient, -1, -2))
    return np.asarray(samples * np.diag(std**2) + both + remainder)


def _state_change(step: Array, excited: Array, samples: int) -> tuple[Array, Array]:
    """Return A^N - I and the covariance of x_N - x_0 of the loop in its own noise.

    x_N - x_0 = (A^N - I) x_0 + what the window adds. The product stays finite even where the state
    wanders, as the angles of a loop for speeds alone do.
    """
    power, added = np.eye(len(step)), np.zeros_like(step)
    for bit in bin(samples)[2:]:
        added = added + power @ added @ power.T
        power = power @ power
        if bit == "1":
            added = step @ added @ step.T + excited
            power = step @ power
    change, settled, last = power - np.eye(len(step)), added, power
    with np.errstate(over="ignore", invalid="ignore"):  # an unstable loop is told below
        for _ in range(_DOUBLINGS):
            settled = settled + power @ settled @ power.T
            last, power = power, power @ power
    if not np.abs(power).max() <= _GROWTH * max(float(np.abs(last).max()), 1.0):
        raise SolverFailed(
            "noise: the closed loop is unstable; lower the controller's gains or its sample time"
        )
    return change, change @ settled @ change.T + added


def _resolved(
    triangle: ComplexArray, z: ComplexArray, right: NDArray[np.complexfloating]
) -> ComplexArray:
    """Return x (h, F, k) of (z I - T) x = b for upper triangular T (h, h)."""
    x = np.empty(right.shape, dtype=complex)
    for j in reversed(range(len(triangle))):
        below = np.tensordot(triangle[j, j + 1 :], x[j + 1 :], 1)
        x[j] = (right[j] + below) / (z - triangle[j, j])[:, None]
    return x
