"""Where a search for modes begins: poles by rational approximation, the rest by linear fits."""

from typing import TYPE_CHECKING

import numpy as np

from estimators.chains.modal_model import ModalLayout
from estimators.chains.rational_approximation import candidate_poles, exact_poles, vector_fit
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import NotIdentifiable

if TYPE_CHECKING:
    from estimators.chains.whitened_frf import Data

_DELAYS = 401


def undamped_start(data: "Data", layout: ModalLayout) -> Array:
    """Return x for FRFs without noise and damping, exact but for rounding.

    Raises
    ------
    NotIdentifiable
        If there are not as many poles as the layout has modes.
    """
    squares = exact_poles(data.omega, data.response.real)
    if len(squares) != layout.modes:
        raise NotIdentifiable((f"{layout.modes} modes",), f"{len(squares)} were found")
    poles = 1j * np.sqrt(squares)
    return _linear(data, layout, np.asarray(poles), data.response)


def modal_start(data: "Data", layout: ModalLayout) -> list[Array]:
    """Return starting x from several sets of poles, a delay taken off."""
    delay = start_delay(data.omega, data.response)
    prompt = data.response * np.exp(1j * data.omega * delay)[:, None, None]
    weights = 1 / data.std
    noise = float(np.median(1 / (weights * np.maximum(np.abs(data.response), 1e-300))))
    starts = []
    sets = candidate_poles(data.omega, prompt, layout.modes, min(noise, 0.1))
    for poles, slow in [*((poles, 0) for poles in sets), (sets[0], layout.chains)]:
        moved = vector_fit(data.omega, prompt, poles, weights, slow)
        x = _linear(data, layout, moved, prompt)
        starts.append(_with_delay(x, layout, delay))
    return starts


def start_delay(omega: Array, response: ComplexArray) -> float:
    """Return the delay that makes the elements most nearly real, as those of light damping are."""
    size = np.abs(response)
    unit = response / np.maximum(size, 1e-300)
    weights = size / size.max(axis=(1, 2), keepdims=True)
    delays = np.linspace(-0.5, 0.5, _DELAYS) * np.pi / omega.max()
    turned = np.einsum("fij,fd->dfij", unit, np.exp(1j * np.outer(omega, delays)))
    misfit = np.sum(weights * turned.imag**2, axis=(1, 2, 3))
    return float(delays[int(np.argmin(misfit))])


def _linear(
    data: "Data", layout: ModalLayout, poles: ComplexArray, response: ComplexArray
) -> Array:
    """Return x whose rigid part and symmetric residues are the best for these poles."""
    m, n = layout.chains, layout.modes
    omega: Array = np.abs(poles)
    zeta = np.clip(-poles.real / omega, 0.0, 0.5)
    s = 1j * data.omega
    square = s[:, None] ** 2
    h = square / (square + 2 * zeta * omega * s[:, None] + omega**2)
    columns = [np.ones(len(s))[:, None], h] + ([1 / s[:, None]] if layout.losses else [])
    basis = np.concatenate(columns, axis=1)
    weights = 1 / data.std
    residues = np.zeros((basis.shape[1], m, m))
    for i, j in zip(*np.triu_indices(m), strict=True):
        rows = [(weights[:, a, b], response[:, a, b]) for a, b in {(i, j), (j, i)}]
        A = np.concatenate([w[:, None] * basis for w, _ in rows])
        b = np.concatenate([w * g for w, g in rows])
        size = np.linalg.norm(A, axis=0)
        real = np.concatenate([(A / size).real, (A / size).imag])
        value = np.linalg.lstsq(real, np.concatenate([b.real, b.imag]), rcond=None)[0] / size
        residues[:, i, j] = residues[:, j, i] = value
    rigid = _positive(residues[0])
    values, vectors = np.linalg.eigh(residues[1 : 1 + n])
    shapes: Array = np.sqrt(np.maximum(values[:, -1:], 1e-8 * np.trace(rigid))) * vectors[:, :, -1]
    inertia: Array = np.asarray(np.linalg.inv(rigid), dtype=float)
    if not layout.losses:
        return layout.join(inertia, omega, shapes)
    friction = -np.diag(inertia @ residues[-1] @ inertia)
    return layout.join(inertia, omega, shapes, np.maximum(zeta, 1e-5), friction)


def _positive(matrix: Array) -> Array:
    """Return the nearest symmetric matrix that is clearly positive definite."""
    values, vectors = np.linalg.eigh(matrix)
    least = 1e-3 * max(float(np.abs(values).max()), 1e-300)
    return np.asarray((vectors * np.maximum(values, least)) @ vectors.T)


def _with_delay(x: Array, layout: ModalLayout, delay: float) -> Array:
    x = x.copy()
    x[sum(layout.sizes[:5])] = delay
    return x
