"""Resonances, anti-resonances and gains of chains from their FRFs: maximum-likelihood modes."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from estimators.chains.modal_model import (
    ModalLayout,
    anti_resonance_squares,
    modal_response,
    modal_sensitivity,
)
from estimators.chains.modal_start import modal_start, undamped_start
from estimators.chains.whitened_frf import Data, relative_variance
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import NotIdentifiable

Shapes = Literal["auto", "real", "complex"]

_LARGEST_DAMPING = 0.7
_ROUNDS = 60
_BEYOND = 20.0  # how far outside the band resonances are looked for, a factor
# Gain in cost for each turned shape from which on real mode shapes are given up.
_TURNING = 3.0


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
        squares = anti_resonance_squares(self.inertia, self.omega, self.shapes)
        return np.asarray(np.sqrt(np.maximum(squares, 0.0)))

    @cached_property
    def zeros_std(self) -> Array:
        """Standard deviations of `zeros`, (M, n) [rad/s]."""
        return np.asarray(np.sqrt(np.maximum(self._zero_variances(), 0.0)))

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
        m, start, found = self.layout.chains, sum(self.layout.sizes[:2]), []
        for r, shape in enumerate(self.shapes):
            part = slice(start + r * m, start + (r + 1) * m)
            found.append(shape @ np.linalg.pinv(self.covariance[part, part]) @ shape)
        return np.array(found)

    def _zero_variances(self) -> Array:
        """Propagate the covariance: d zero = -sum dw/(lambda - zero) + ... / sum w/(...)^2."""
        variances = []
        p, x = self.layout.structure, self.x
        C = self.covariance[:p, :p]
        rows = np.empty((p, *self.zeros.shape))
        for k in range(p):
            step = np.zeros(len(x))
            step[k] = 1e-6 * max(abs(x[k]), np.sqrt(C[k, k]), 1e-12)
            ends = []
            for sign in (1.0, -1.0):
                J, omega, phi, *_ = self.layout.split(x + sign * step)
                order = np.argsort(omega)
                square = anti_resonance_squares(J, omega[order], phi[order])
                ends.append(np.sqrt(np.maximum(square, 0.0)))
            rows[k] = (ends[0] - ends[1]) / (2 * step[k])
        variances = np.einsum("kij,kl,lij->ij", rows, C, rows)
        return np.asarray(variances)


def with_excess(found: FittedModes) -> tuple[Data, float]:
    """Return the data with a relative error added that explains the misfit, and its size.

    What friction does to FRFs repeats, so covariances from periods miss it, and weights follow it.
    """
    data = found.data
    extra = relative_variance(data.response)
    error = np.abs(found.response - data.response) ** 2
    share = data.size / max(data.size - len(found.x), 1)
    square = max(float(np.mean((error * share - data.variance) / extra)), 0.0)
    return data.with_error(square * extra), float(np.sqrt(square))


def fit_modes(
    data: Data, count: int, rounds: int = _ROUNDS, shapes: Shapes = "auto"
) -> FittedModes:
    """Return the maximum-likelihood modes, `count` of them, common to all elements.

    Mode shapes are real unless complex ones, as unequal dampers make them, explain clearly more.

    Parameters
    ----------
    data : Data
        See `prepared`.
    count : int
        n, M (N - 1) for M chains of N masses.
    rounds : int
        Rounds of the search, at most.
    shapes : Shapes
        "real", "complex", or "auto", which asks the data.
    """
    if data.undamped:
        layout = ModalLayout(data.chains, count, losses=False)
        return _refined(data, layout, undamped_start(data, layout), rounds)
    layout = ModalLayout(data.chains, count)
    starts = _distinct(data, layout)
    rough = [_search(data, layout, x, 8) for x in starts]
    found = _refined(data, layout, min(rough, key=lambda point: point[1])[0], rounds)
    explained = not data.scaled and found.misfit < 1 + 3 * np.sqrt(2 / data.size)
    if shapes == "real" or (shapes == "auto" and explained):
        return found
    bent = min(
        (_with_turned_shapes(data, layout, x, rounds) for x in (found.x, starts[0])),
        key=lambda one: one.cost,
    )
    gain = (found.cost - bent.cost) / max(bent.misfit, 1e-300)
    return bent if shapes == "complex" or gain > _TURNING * bent.layout.sizes[-1] else found


def _distinct(data: Data, layout: ModalLayout) -> list[Array]:
    starts = modal_start(data, layout)
    costs = [
        float(np.sum(data.whitened(modal_response(x, layout, data.omega) - data.response) ** 2))
        for x in starts
    ]
    kept: list[int] = []
    for i in np.argsort(costs):
        if len(kept) < 2 and all(costs[i] > 1.01 * costs[k] for k in kept):
            kept.append(int(i))
    return [starts[i] for i in kept]


def _with_turned_shapes(data: Data, layout: ModalLayout, x: Array, rounds: int) -> FittedModes:
    """Return the fit with complex mode shapes, begun at real ones."""
    bent = ModalLayout(layout.chains, layout.modes, turned=True)
    return _refined(data, bent, np.concatenate([x, np.zeros(bent.sizes[-1])]), rounds)


def _refined(data: Data, layout: ModalLayout, x: Array, rounds: int) -> FittedModes:
    x, cost = _search(data, layout, x, rounds)
    x = _sorted(x, layout)
    jacobian = data.whitened(modal_sensitivity(x, layout, data.omega)[1])
    return FittedModes(data, layout, x, _covariance(data, jacobian, cost, layout), cost)


def _covariance(data: Data, jacobian: Array, cost: float, layout: ModalLayout) -> Array:
    """Return the covariance of x; what the data do not say at all gets a huge variance.

    A mode too many leaves parameters without effect. It is counted by its significance later.
    """
    try:
        return data.covariance_of(jacobian, cost, layout.names)
    except NotIdentifiable:
        size = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
        values, vectors = np.linalg.eigh((jacobian / size).T @ (jacobian / size))
        inverse = (vectors / np.maximum(values, 1e-13 * values[-1])) @ vectors.T
        scale = 2 * cost / data.size if data.scaled else 1.0
        return np.asarray(inverse / np.outer(size, size) / 2 * scale)


def _search(data: Data, layout: ModalLayout, x: Array, rounds: int) -> tuple[Array, float]:
    from scipy.optimize import least_squares

    low, high = np.full(len(x), -np.inf), np.full(len(x), np.inf)
    if layout.losses:
        begin, start = layout.sizes[0], layout.structure
        places = slice(begin, begin + layout.modes)
        low[places], high[places] = np.log(data.omega[[0, -1]] * [1 / _BEYOND, _BEYOND])
        zeta = slice(start, start + layout.modes)
        low[zeta], high[zeta] = 1e-7, _LARGEST_DAMPING

    def residuals(v: Array) -> Array:
        return data.whitened(modal_response(v, layout, data.omega) - data.response)[:, 0]

    def jacobian(v: Array) -> Array:
        return data.whitened(modal_sensitivity(v, layout, data.omega)[1])

    found = least_squares(
        residuals,
        _inside(x, low, high),
        jac=jacobian,
        bounds=(low, high),
        x_scale="jac",
        ftol=1e-12 if data.undamped else 1e-9,
        xtol=1e-14 if data.undamped else 1e-10,
        gtol=1e-15,
        max_nfev=rounds,
    )
    return np.asarray(found.x), float(2 * found.cost)


def _inside(x: Array, low: Array, high: Array) -> Array:
    """Return x moved off its bounds."""
    finite = np.isfinite(low)
    moved = x.copy()
    margin = 1e-6 * (high[finite] - low[finite])
    moved[finite] = np.clip(x[finite], low[finite] + margin, high[finite] - margin)
    return moved


def _sorted(x: Array, layout: ModalLayout) -> Array:
    J, omega, phi, zeta, friction, delay, chi = layout.split(x)
    order = np.argsort(omega)
    return layout.join(
        J, omega[order], phi[order], zeta[order], friction, float(delay[0]), chi[order]
    )
