"""What runs that do not end as they began add to their spectra: a free response of the states.

Of N samples, T = C (zI - A)^-1 z (x_0 - x_N) / sqrt(N): one real unknown for each state and run.
They enter linearly and are eliminated (variable projection: Golub and Pereyra 1973).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from robotmodels.common.arrays import Array, ComplexArray, IntArray
from robotmodels.common.errors import InvalidInput
from robotmodels.linear.linear_model import LinearModel, Measurement

_RANK = 1e-9
"""Singular values that are smaller, of columns of unit length, tell nothing apart."""


@dataclass(frozen=True, eq=False)
class FreePart:
    """The real span of whitened free responses, position by position.

    Attributes
    ----------
    basis : ndarray, (Q, r, s)
        Orthonormal columns over r real numbers, zero beyond the rank.
    inverse : ndarray, (Q, s, s)
        From what columns have of the basis to the amplitudes of the responses.
    amplitudes : ndarray, (Q, s, E)
        States of each run that explain its errors best.
    """

    basis: Array
    inverse: Array
    amplitudes: Array

    @classmethod
    def of(cls, columns: ComplexArray, errors: ComplexArray) -> "FreePart":
        """Return the span of columns (Q, F, m, s) and what errors (Q, F, m, E) have of it."""
        real = _real(columns)
        size = np.linalg.norm(real, axis=1, keepdims=True)
        scale = np.where(size > 0, size, 1.0)
        left, values, right = np.linalg.svd(real / scale, full_matrices=False)
        told = values > _RANK * values.max(axis=1, keepdims=True)
        basis = left * told[:, None]
        inverse = (
            right.swapaxes(1, 2) * np.where(told, 1 / np.where(told, values, 1.0), 0.0)[:, None]
        )
        inverse = inverse / scale.swapaxes(1, 2)
        return cls(basis, inverse, inverse @ basis.swapaxes(1, 2) @ _real(errors))

    def amplitudes_of(self, columns: ComplexArray) -> Array:
        """Return the amplitudes (Q, s, ...) that explain columns (Q, F, m, ...) best."""
        return np.asarray(self.inverse @ self.basis.swapaxes(1, 2) @ _real(columns))

    def degrees_of_freedom(self, runs: int) -> Array:
        """Return the real degrees of freedom that the states of runs take, (Q,)."""
        return np.asarray(runs * np.round((self.basis**2).sum(axis=(1, 2))))

    def taken_off(self, columns: ComplexArray) -> ComplexArray:
        """Return columns (Q, F, m, ...) less what states can imitate of them."""
        real = _real(columns)
        return _complex(real - self.basis @ (self.basis.swapaxes(1, 2) @ real), columns.shape)


def _real(columns: ComplexArray) -> Array:
    """Return real and imaginary parts of (Q, F, m, ...) as rows, (Q, 2 F m, rest)."""
    q, f, m = columns.shape[:3]
    flat = columns.reshape(q, f * m, -1)
    return np.concatenate([flat.real, flat.imag], axis=1)


def _complex(rows: Array, shape: tuple[int, ...]) -> ComplexArray:
    half = rows.shape[1] // 2
    return np.asarray((rows[:, :half] + 1j * rows[:, half:]).reshape(shape))


def sampled_states(model: LinearModel, sample_time: float, derivatives: IntArray) -> Array:
    """Return A above C, (Q, 2 d + m, 2 d): from one sample of angles and speeds to the next.

    Parameters
    ----------
    derivatives : ndarray of int, (m,)
        How often each sampled output was differentiated to make the model's, such as angles twice
        to make accelerations.

    Raises
    ------
    InvalidInput
        If sensors or torques have lags, or sensors see torques at once.
    """
    from scipy.linalg import expm

    rates = state_rates(model)
    slopes = rates[..., model.mass.shape[-1] :, :]
    C = _sampled_outputs(model.measured, derivatives, slopes)
    return np.concatenate([expm(rates * sample_time), C], axis=-2)


def state_rates(model: LinearModel) -> Array:
    """Return A of x' = A x without torques, (..., 2 d, 2 d); x are angles above speeds."""
    d = model.mass.shape[-1]
    damping = np.broadcast_to(model.damping, model.mass.shape)
    slopes = -np.linalg.solve(model.mass, np.concatenate([model.stiffness, damping], axis=-1))
    speeds = np.concatenate([np.zeros((d, d)), np.eye(d)], axis=1)
    return np.concatenate([np.broadcast_to(speeds, slopes.shape), slopes], axis=-2)


def _sampled_outputs(sensors: Measurement, derivatives: IntArray, slopes: Array) -> Array:
    """Return the sampled outputs' matrix (Q, m, 2 d); `slopes` (Q, d, 2 d) give accelerations."""
    lags = sensors.torque.lag.any() or (sensors.sensor is not None and sensors.sensor.lag.any())
    parts = np.broadcast_arrays(sensors.position, sensors.velocity, sensors.acceleration)
    none = np.zeros_like(parts[0])
    rows = np.arange(len(derivatives))
    sampled = np.stack([*parts, none, none])[derivatives + np.arange(3)[:, None], ..., rows, :]
    lower = [part[..., derivatives > k, :].any() for k, part in enumerate(parts)]
    if lags or sensors.feedthrough is not None or any(lower):
        raise InvalidInput(
            "states: those of lags, and of outputs that read motors' torques, cannot be estimated "
            "along; take states='polynomial', states='no' and periodic runs, or fit other outputs"
        )
    angle, speed, acceleration = np.moveaxis(sampled, 1, -2)
    C = np.concatenate([angle, speed], axis=-1) + acceleration @ slopes
    return np.broadcast_to(C, (*slopes.shape[:-2], *C.shape[-2:]))


@dataclass(frozen=True, eq=False)
class FreeResponse:
    """Spectra of free responses, for a unit of each state at the start of a run.

    Attributes
    ----------
    states : ndarray, (Q, s + m, s)
        See `sampled_states`.
    shift : ndarray of complex, (F,)
        e^{j omega T} of the lines, T the sampling interval.
    factor : ndarray of complex, (F, m)
        By which spectra of the sampled outputs are multiplied.
    """

    states: Array
    shift: ComplexArray
    factor: ComplexArray

    @cached_property
    def columns(self) -> ComplexArray:
        """The responses C (I - A/z)^-1, (Q, F, m, s)."""
        C = self.states[:, self._count :]
        wide = np.broadcast_to(
            np.swapaxes(C, -1, -2)[:, None], (*self._matrices.shape[:3], C.shape[1])
        )
        solved = np.linalg.solve(np.swapaxes(self._matrices, -1, -2), wide)
        return np.asarray(self.factor[..., None] * np.swapaxes(solved, -1, -2))

    def part(self, columns: ComplexArray, errors: ComplexArray) -> FreePart:
        """Return the span of whitened `columns`, and what whitened errors have of it."""
        return FreePart.of(columns, errors)

    def moved(self, slopes: Array, states: Array) -> ComplexArray:
        """Return the derivatives (Q, F, m, E, p) of the responses of states (Q, s, E).

        `slopes` (Q, s + m, s, p) are those of `states`.
        """
        s = self._count
        wide = np.broadcast_to(states[:, None], (*self._matrices.shape[:3], states.shape[-1]))
        inside = np.linalg.solve(self._matrices, wide)  # (Q, F, s, E)
        changed = np.einsum("qijp,qfje->qfiep", slopes, inside, optimize=True)
        late = changed[:, :, :s] / self.shift[:, None, None, None]
        through = np.einsum("qfms,qfsep->qfmep", self.columns, late, optimize=True)
        return np.asarray(through + self.factor[..., None, None] * changed[:, :, s:])

    @property
    def _count(self) -> int:
        return int(self.states.shape[-1])

    @cached_property
    def _matrices(self) -> ComplexArray:
        """I - A/z, (Q, F, s, s)."""
        A = self.states[:, None, : self._count]
        return np.asarray(np.eye(self._count) - A / self.shift[:, None, None])
