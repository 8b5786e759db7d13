"""The start of an experiment: the linear closed loop from rest, sample by sample.

A motor that hardly works in the steady state can meet its largest torque in the transient.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from robotmodels.arrays import Array
from robotmodels.errors import InvalidInput
from robotmodels.linear_model import LinearModel
from robotmodels.plant.controller import Controller

# Poles at one belong to motors without position loop or integral part, computed to rounding.
_STABLE = 1 + 1e-6


@dataclass(frozen=True, eq=False)
class SampledLoop:
    """z_{k+1} = A z_k + B r_k and (torque, speed, angle)_k = C z_k + D r_k, exact at the samples.

    Attributes
    ----------
    step : (h, h) A.
    drive : (h, n) B, from speed references.
    outputs : (3 n, h) C, of the motor shafts.
    through : (3 n, n) D.
    """

    step: Array
    drive: Array
    outputs: Array
    through: Array

    @property
    def largest_pole(self) -> float:
        """Largest magnitude of a pole; at most one in a stable loop."""
        return float(np.abs(np.linalg.eigvals(self.step)).max())

    def swing(self, references: Array) -> Array:
        """Return lowest and highest outputs (3, n, 2) over all runs and samples, from rest.

        Parameters
        ----------
        references : (runs, samples, n) [rad/s].
        """
        runs, samples, n = references.shape
        state = np.zeros((runs, len(self.step)))
        both = np.vstack([self.step, self.outputs]).T
        lowest, highest = np.zeros((2, runs, 3 * n))
        forced = references @ np.vstack([self.drive, self.through]).T
        for k in range(samples):
            after = state @ both + forced[:, k]
            state, output = after[:, : state.shape[1]], after[:, state.shape[1] :]
            np.minimum(lowest, output, out=lowest)
            np.maximum(highest, output, out=highest)
        ends = np.stack([lowest.min(axis=0), highest.max(axis=0)], axis=-1)
        return np.asarray(ends.reshape(3, n, 2))


def sampled_loop(model: LinearModel, controller: Controller, where: str) -> SampledLoop:
    """Return the closed loop around one linear model, its delay rounded to whole samples.

    Raises
    ------
    InvalidInput : naming `where`, if the loop is unstable.
    """
    T, n, d = controller.sample_time, model.inputs, model.mass.shape[0]
    motion = np.zeros((2 * d + n, 2 * d + n))
    motion[:d, d : 2 * d] = np.eye(d)
    forces = np.hstack([-model.stiffness, -model.damping, model.selector * model.measured.gain])
    motion[d : 2 * d] = np.linalg.solve(model.mass, forces)
    held = expm(motion * T)[: 2 * d]
    late = round(model.measured.delay / T)
    # The state: coordinates, their speeds, then w, i and the last angle of the controller, then
    # angles on their way to it.
    size = 2 * d + (3 + late) * n
    identity = np.eye(size)
    w, i, last = (identity[2 * d + j * n : 2 * d + (j + 1) * n] for j in range(3))
    way = identity[2 * d + 3 * n :]
    angle, speed = np.zeros((2, n, size))
    angle[:, :d] = speed[:, d : 2 * d] = model.selector.T
    seen = way[-n:] if late else angle
    # The equations of `Controller`, with (..)_z of the state and (..)_r of the reference.
    a, integral = controller.filter_pole[:, None], (T / controller.integral_time)[:, None]
    gain = controller.speed_gain[:, None]
    w_z = a * w + (1 - a) / T * (seen - last)
    e_z = -controller.position_gain[:, None] * seen - w_z
    i_z = i + integral * e_z
    u_z, u_r = gain * (e_z + i_z), gain * (1 + integral) * np.eye(n)
    x_z = held[:, : 2 * d] @ identity[: 2 * d] + held[:, 2 * d :] @ u_z
    x_r = held[:, 2 * d :] @ u_r
    loop = SampledLoop(
        step=np.vstack([x_z, w_z, i_z, seen, *([angle, way[:-n]] if late else [])]),
        drive=np.vstack([x_r, 0 * u_r, integral * np.eye(n), np.zeros(((1 + late) * n, n))]),
        outputs=np.vstack([u_z, speed, angle]),
        through=np.vstack([u_r, np.zeros((2 * n, n))]),
    )
    if not loop.largest_pole <= _STABLE:
        raise InvalidInput(
            f"controller: its loop is unstable in {where} (a pole of magnitude "
            f"{loop.largest_pole:.4g}); smaller gains, or a shorter sample time, are needed"
        )
    return loop
