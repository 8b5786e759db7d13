"""A linear model under a sampled controller, from sample to sample: exact, the torque held."""

from dataclasses import dataclass

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput
from robotmodels.linear.linear_model import LinearModel
from robotmodels.simulation.controller import Controller


@dataclass(frozen=True, eq=False)
class SampledLoop:
    """z_{k+1} = A z_k + B v_k and o_k = C z_k + D v_k, at rest where z is zero.

    v = (speed references, noise on the measured angles), o = (torques, speeds, angles, measured
    angles), all of the n motor shafts. z is whatever the model and the controller remember.

    Attributes
    ----------
    step : ndarray, (h, h)
        A.
    drive : ndarray, (h, 2 n)
        B.
    outputs : ndarray, (4 n, h)
        C.
    through : ndarray, (4 n, 2 n)
        D.
    """

    step: Array
    drive: Array
    outputs: Array
    through: Array

    @property
    def largest_pole(self) -> float:
        """Largest magnitude of a pole; above one the loop is unstable."""
        return float(np.abs(np.linalg.eigvals(self.step)).max())

    def swing(self, references: Array) -> Array:
        """Return lowest and highest torque, speed and angle, (3, n, 2), of all runs from rest.

        Parameters
        ----------
        references : ndarray, (runs, samples, n), rad/s
            References.
        """
        runs, samples, n = references.shape
        state = np.zeros((runs, len(self.step)))
        both = np.vstack([self.step, self.outputs[: 3 * n]]).T
        lowest, highest = np.zeros((2, runs, 3 * n))
        forced = references @ np.vstack([self.drive[:, :n], self.through[: 3 * n, :n]]).T
        for k in range(samples):
            after = state @ both + forced[:, k]
            state, output = after[:, : state.shape[1]], after[:, state.shape[1] :]
            np.minimum(lowest, output, out=lowest)
            np.maximum(highest, output, out=highest)
        ends = np.stack([lowest.min(axis=0), highest.max(axis=0)], axis=-1)
        return np.asarray(ends.reshape(3, n, 2))

    def run(
        self, references: Array, std: Array, rng: np.random.Generator, transient: int, periods: int
    ) -> Array:
        """Return torques and measured angles, (periods N, 2 n, runs), from rest on.

        Parameters
        ----------
        references : ndarray, (N, n, runs), rad/s
            One period of the speed references of each run.
        std : ndarray, (n,), rad
            Standard deviations of white noise on the measured angles.
        rng : Generator
            Source of the noise.
        transient, periods : int
            Dropped and recorded periods.
        """
        N, n, runs = references.shape
        seen = [*range(n), *range(3 * n, 4 * n)]
        both = np.block([[self.step, self.drive], [self.outputs[seen], self.through[seen]]])
        state = np.zeros((len(self.step), runs))
        samples = np.empty((periods * N, 2 * n, runs))
        for k in range((transient + periods) * N):
            noise = std[:, None] * rng.standard_normal((n, runs))
            after = both @ np.concatenate([state, references[k % N], noise])
            state = after[: len(state)]
            if k >= transient * N:
                samples[k - transient * N] = after[len(state) :]
        return samples


def sampled_loop(model: LinearModel, controller: Controller) -> SampledLoop:
    """Return the closed loop of a linear model and `Controller`, stable or not.

    The delay of what is measured, with the longest of the torques, is rounded to whole samples.

    Raises
    ------
    InvalidInput
        If the controller has another number of motors, or the model has leading axes.
    """
    n, d, T = model.inputs, len(model.selector), controller.sample_time
    if model.mass.ndim != 2:
        raise InvalidInput("linear plant: one position at a time; the model has leading axes")
    if len(controller.speed_gain) != n:
        raise InvalidInput(f"controller: {len(controller.speed_gain)} motors, the model has {n}")
    late = round((model.measured.delay + model.measured.torque.delay.max(initial=0.0)) / T)
    transition = zero_order_hold(model, T)
    # The state: coordinates, their speeds, torques that lag behind their commands, then w, i and
    # the last angle of the controller, then angles on their way to it. Every row below is in terms
    # of it, the references and the noise.
    plant = len(transition)
    size = plant + (3 + late) * n
    terms = np.eye(size + 2 * n)
    motion, way = terms[:plant], terms[plant + 3 * n : size]
    w, i, last = (terms[plant + j * n : plant + (j + 1) * n] for j in range(3))
    reference, noise = terms[size : size + n], terms[size + n :]
    angle, speed = model.selector.T @ motion[:d], model.selector.T @ motion[d : 2 * d]
    seen = (way[-n:] if late else angle) + noise
    # The equations of `Controller`.
    a, integral = controller.filter_pole[:, None], (T / controller.integral_time)[:, None]
    w = a * w + (1 - a) / T * (seen - last)
    error = reference - controller.position_gain[:, None] * seen - w
    # Without an integral part nothing is remembered: the pole at 1 would pass for instability.
    i = (integral > 0) * i + integral * error
    torque = controller.speed_gain[:, None] * (error + i)
    moved = transition[:, :plant] @ motion + transition[:, plant:] @ torque
    step = np.concatenate([moved, w, i, seen, *([angle, way[:-n]] if late else [])])
    output = np.concatenate([torque, speed, angle, seen])
    return SampledLoop(step[:, :size], step[:, size:], output[:, :size], output[:, size:])


def zero_order_hold(model: LinearModel, time: float) -> Array:
    """Return coordinates, speeds and lagging torques after a time, from them and held commands."""
    from scipy.linalg import expm

    system = first_order_system(model)
    plant = len(system)
    system = np.vstack([system, np.zeros((model.inputs, system.shape[1]))])
    return np.asarray(expm(system * time)[:plant])


def first_order_system(model: LinearModel) -> Array:
    """Return derivatives of coordinates, speeds and lagging torques, by them and by commands."""
    d, torque = len(model.selector), model.measured.torque
    behind = np.flatnonzero(torque.lag > 0)
    plant = 2 * d + len(behind)
    system = np.zeros((plant, plant + model.inputs))
    system[:d, d : 2 * d] = np.eye(d)
    forces = model.selector * torque.gain
    direct = np.where(torque.lag > 0, 0.0, forces)
    everything = np.hstack([-model.stiffness, -model.damping, forces[:, behind], direct])
    system[d : 2 * d] = np.linalg.solve(model.mass, everything)
    for row, motor in enumerate(behind, start=2 * d):
        system[row, row], system[row, plant + motor] = -1 / torque.lag[motor], 1 / torque.lag[motor]
    return system
