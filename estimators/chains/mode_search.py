"""Maximum-likelihood modes of chains: the search for what fits all elements of an FRF matrix."""

from typing import Literal

import numpy as np

from estimators.chains.modal_model import ModalLayout, modal_response, modal_sensitivity
from estimators.chains.modal_start import modal_start, undamped_start
from estimators.chains.modes import FittedModes
from estimators.chains.whitened_frf import Data
from robotmodels.common.arrays import Array
from robotmodels.common.errors import NotIdentifiable

Shapes = Literal["auto", "real", "complex"]

_LARGEST_DAMPING = 0.7
_ROUNDS = 60
_BEYOND = 20.0  # how far outside the band resonances are looked for, a factor
# Gain in cost for each turned shape from which on real mode shapes are given up.
_TURNING = 3.0


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
    straight = _refined(data, layout, min(rough, key=lambda point: point[1])[0], rounds)
    explained = not data.scaled and straight.misfit < 1 + 3 * np.sqrt(2 / data.size)
    if shapes == "real" or (shapes == "auto" and explained):
        return straight
    bent = min(
        (_with_turned_shapes(data, layout, x, rounds) for x in (straight.x, starts[0])),
        key=lambda one: one.cost,
    )
    gain = (straight.cost - bent.cost) / max(bent.misfit, 1e-300)
    return bent if shapes == "complex" or gain > _TURNING * bent.layout.sizes[-1] else straight


def _distinct(data: Data, layout: ModalLayout) -> list[Array]:
    starts = modal_start(data, layout)
    costs = [
        float(np.sum(data.whitened(modal_response(x, layout, data.omega) - data.response) ** 2))
        for x in starts
    ]
    distinct: list[int] = []
    for i in np.argsort(costs):
        if len(distinct) < 2 and all(costs[i] > 1.01 * costs[k] for k in distinct):
            distinct.append(int(i))
    return [starts[i] for i in distinct]


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
        frequencies = slice(begin, begin + layout.modes)
        low[frequencies], high[frequencies] = np.log(data.omega[[0, -1]] * [1 / _BEYOND, _BEYOND])
        zeta = slice(start, start + layout.modes)
        low[zeta], high[zeta] = 1e-7, _LARGEST_DAMPING

    def residuals(v: Array) -> Array:
        return data.whitened(modal_response(v, layout, data.omega) - data.response)[:, 0]

    def jacobian(v: Array) -> Array:
        return data.whitened(modal_sensitivity(v, layout, data.omega)[1])

    solution = least_squares(
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
    return np.asarray(solution.x), float(2 * solution.cost)


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
