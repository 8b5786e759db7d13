"""Resonances, anti-resonances and gains of chains, fitted to FRFs, with their covariance."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.chains.modal_model import (
    ModalLayout,
    anti_resonance_slopes,
    modal_anti_resonances,
    modal_response,
)
from estimators.chains.whitened_frf import Data, relative_variance
from robotmodels.common.arrays import Array, ComplexArray


@dataclass(frozen=True, eq=False)
class FittedModes:
    """Modes that all elements of an FRF matrix share.

    Attributes
    ----------
    data : Data
        What was fitted.
    layout : ModalLayout
        What x holds.
    x : ndarray, (p,)
        See `ModalLayout`.
    covariance : ndarray, (p, p)
        Covariance of x.
    cost : float
        Sum of squared whitened residuals; its expectation is `Data.size` - p where the noise is
        known and the model right.
    """

    data: Data
    layout: ModalLayout
    x: Array
    covariance: Array
    cost: float
    _parts: tuple[NDArray[Any], ...] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_parts", self.layout.split(self.x))

    @property
    def misfit(self) -> float:
        """Cost over its expectation: near 1 where known noise is all that is left."""
        share = max(self.data.size - len(self.x), 1) / self.data.size
        return self.cost / (self.data.expected * share)

    @property
    def inertia(self) -> Array:
        """Rigid inertia matrix, (M, M): sums of masses, couplings with their signs [kg]."""
        return np.asarray(self._parts[0])

    @property
    def omega(self) -> Array:
        """Undamped resonances, (n,), increasing [rad/s]."""
        return np.asarray(self._parts[1])

    @property
    def shapes(self) -> Array:
        """Motors' components of the mode shapes of unit modal mass, (n, M)."""
        return np.asarray(self._parts[2])

    @property
    def damping(self) -> Array:
        """Damping ratios, (n,)."""
        return np.asarray(self._parts[3])

    @property
    def friction(self) -> Array:
        """Viscous friction of the motors, (M,) [N s/m]."""
        return np.asarray(self._parts[4])

    @property
    def delay(self) -> float:
        """Delay of the angles after the torques [s]."""
        return float(self._parts[5][0])

    @property
    def response(self) -> ComplexArray:
        """The model's FRFs, (F, M, M)."""
        return modal_response(self.x, self.layout, self.data.omega)

    @cached_property
    def zeros(self) -> Array:
        """Undamped anti-resonances of each chain, (M, n), increasing [rad/s]."""
        return modal_anti_resonances(self.x, self.layout)

    @cached_property
    def zeros_std(self) -> Array:
        """Standard deviations of `zeros`, (M, n) [rad/s]."""
        slopes, p = anti_resonance_slopes(self.x, self.layout), self.layout.structure
        variances = np.einsum("ijk,kl,ijl->ij", slopes, self.covariance[:p, :p], slopes)
        return np.asarray(np.sqrt(np.maximum(variances, 0.0)))

    @property
    def omega_std(self) -> Array:
        """Standard deviations of `omega`, (n,) [rad/s]."""
        start = self.layout.sizes[0]
        variance = np.diag(self.covariance)[start : start + self.layout.modes]
        return np.asarray(self.omega * np.sqrt(variance))

    @property
    def low_gains(self) -> Array:
        """A_L = 1/sum of masses, (M,): the other chains held, [HBH] (2) [1/kg]."""
        return np.asarray(1 / np.diag(self.inertia))

    @property
    def high_gains(self) -> Array:
        """A_H = 1/m_1, (M,), [HBH] (3) [1/kg]."""
        rigid = np.diag(np.linalg.inv(self.inertia))
        return np.asarray(rigid + np.sum(self.shapes**2, axis=0))

    def cross_gain(self, i: int, j: int) -> float:
        """Return A_C with its sign: motor i per motor j, the other chains held, [HBH] 3.2."""
        pair = np.linalg.inv(self.inertia[np.ix_([i, j], [i, j])])
        return float(pair[0, 1])

    @cached_property
    def visibility(self) -> Array:
        """Wald statistics of each mode in each motor, (n, M): (phi / its std)^2.

        Where it is small the mode's pole and a zero of that chain nearly cancel.
        """
        start = sum(self.layout.sizes[:2])
        variance = np.diag(self.covariance)[start : start + self.shapes.size]
        return np.asarray(self.shapes**2 / np.maximum(variance.reshape(self.shapes.shape), 1e-300))

    @cached_property
    def significance(self) -> Array:
        """Wald statistics of each mode in all motors together, (n,)."""
        m, start, statistics = self.layout.chains, sum(self.layout.sizes[:2]), []
        for r, shape in enumerate(self.shapes):
            part = slice(start + r * m, start + (r + 1) * m)
            statistics.append(shape @ np.linalg.pinv(self.covariance[part, part]) @ shape)
        return np.array(statistics)


def with_excess(modes: FittedModes) -> tuple[Data, float]:
    """Return the data with a relative error added that explains the misfit, and its size.

    What friction does to FRFs repeats, so covariances from periods miss it, and weights follow it.
    """
    data = modes.data
    extra = relative_variance(data.response)
    error = np.abs(modes.response - data.response) ** 2
    share = data.size / max(data.size - len(modes.x), 1)
    square = max(float(np.mean((error * share - data.variance) / extra)), 0.0)
    return data.with_error(square * extra), float(np.sqrt(square))
