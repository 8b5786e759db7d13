"""Common poles of FRF matrices for a start: AAA, and vector fitting where there is noise.

AAA (Nakatsukasa, Sete and Trefethen 2018) needs no start and is exact on exact data. In noise it
mixes true poles with spurious ones next to zeros; vector fitting (Gustavsen and Semlyen 1999, the
relaxed form of Gustavsen 2006) moves a known number of common poles to where all elements want
them.
"""

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robotmodels.common.arrays import Array, ComplexArray

_ROUNDS = 12
_DAMPING = 0.01  # of poles placed without knowledge
_RELATIVE = 1e-12  # poles of exact data that stand out less are rounding errors


def exact_poles(omega: Array, response: Array) -> Array:
    """Return the squared resonances, (n,), of undamped FRFs without noise, by AAA in omega^2.

    Parameters
    ----------
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    response : ndarray, (F, M, M)
        Real accelerations over torques.
    """
    square = omega**2
    scale = float(np.median(square))
    # A mixture of all elements has all poles; its weights are fixed, and unlike each other.
    m = response.shape[-1]
    mixture = np.cos(1.0 + np.arange(m * m)).reshape(m, m)
    mixture = mixture + np.eye(m) * m
    values = (response * mixture).sum(axis=(1, 2))
    poles, residues = _aaa(square / scale, values, 1e-13)
    # In the compliance every true pole has a residue of the size of the others'.
    real = (np.abs(poles.imag) < 1e-6 * np.abs(poles)) & (poles.real > 0)
    clear = np.abs(residues) > _RELATIVE * np.abs(values).min() * np.abs(poles)
    return np.sort(poles.real[real & clear]) * scale


def candidate_poles(
    omega: Array, response: ComplexArray, count: int, relative_noise: float
) -> list[ComplexArray]:
    """Return sets of `count` poles (upper half plane) to begin from, the likeliest first.

    Parameters
    ----------
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    response : ndarray of complex, (F, M, M)
        Accelerations over torques.
    relative_noise : float
        Standard deviation of the elements, relative, in the median.
    """
    low, high = float(omega.min()), float(omega.max())
    spread = low + (high - low) * (np.arange(count) + 0.5) / count
    logarithmic = low * (high / low) ** ((np.arange(count) + 0.5) / count)
    sets = [_peaks(omega, response, count)]
    rational = _aaa_candidates(omega, response, relative_noise)
    if len(rational) >= count:
        sets.insert(0, rational[:count])
    sets += [_placed(spread), _placed(logarithmic)]
    return sets


def vector_fit(
    omega: Array, response: ComplexArray, poles: ComplexArray, weights: Array, slow: int = 0
) -> ComplexArray:
    """Return poles (upper half plane) moved to fit all elements, as many as there were.

    Parameters
    ----------
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    response : ndarray of complex, (F, M, M)
        Response.
    poles : ndarray of complex, (n,)
        Poles with positive imaginary parts.
    weights : ndarray, (F, M, M)
        Inverse standard deviations.
    slow : int
        Real poles beside them, where friction at the motors takes rigid modes off zero.
    """
    scale = float(omega.max())
    s = np.asarray(1j * omega / scale)
    data = response.reshape(len(omega), -1)
    roots = weights.reshape(len(omega), -1)
    now: ComplexArray = np.asarray(poles / scale)
    real: Array = -0.1 * float(s.imag.min()) * np.geomspace(0.5, 2.0, slow)
    for _ in range(_ROUNDS):
        moved, real = _relocated(s, data, roots, now, real)
        if len(moved) != len(now):
            moved = _completed(moved, len(now), s)
        done = np.allclose(np.sort_complex(moved), np.sort_complex(now), rtol=1e-6)
        now = moved
        if done:
            break
    return np.asarray(now * scale)


def _aaa(
    points: NDArray[Any], values: NDArray[Any], tolerance: float
) -> tuple[ComplexArray, ComplexArray]:
    from scipy.interpolate import AAA

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of points where it does not converge
        approximation = AAA(points, values, rtol=tolerance, clean_up=False)
        return approximation.poles(), approximation.residues()


def _aaa_candidates(omega: Array, response: ComplexArray, noise: float) -> ComplexArray:
    """Return lightly damped poles by AAA, those that stand out most first."""
    scale = float(omega.max())
    s = np.asarray(1j * omega / scale)
    trace = np.trace(response, axis1=1, axis2=2) / response.shape[-1]
    points, values = np.concatenate([s, -s]), np.concatenate([trace, np.conj(trace)])
    poles, residues = _aaa(points, values, float(np.clip(noise, 1e-13, 0.1)))
    inside = (
        (poles.imag > 0.5 * s.imag.min())
        & (poles.imag < 1.3)
        & (np.abs(poles.real) < 0.3 * np.abs(poles))
    )
    poles, residues = poles[inside], residues[inside]
    height = np.abs(residues) / np.maximum(np.abs(poles.real), 1e-9)
    order = np.argsort(-height)
    candidates = poles[order] * scale
    return np.asarray(-np.abs(candidates.real) + 1j * candidates.imag)


def _peaks(omega: Array, response: ComplexArray, count: int) -> ComplexArray:
    """Return the `count` highest peaks of the largest singular value, filled up in the gaps."""
    height = np.linalg.svd(response, compute_uv=False)[:, 0]
    inner = np.flatnonzero((height[1:-1] > height[:-2]) & (height[1:-1] >= height[2:])) + 1
    prominent = inner[np.argsort(-height[inner])][:count]
    frequencies = list(np.sort(omega[prominent]))
    while len(frequencies) < count:
        edges = np.array([omega.min(), *frequencies, omega.max()])
        gap = int(np.argmax(np.diff(edges)))
        frequencies = sorted([*frequencies, float(edges[gap : gap + 2].mean())])
    return _placed(np.array(frequencies))


def _placed(omega: Array) -> ComplexArray:
    return np.asarray(omega * (-_DAMPING + 1j))


def _relocated(
    s: ComplexArray, data: ComplexArray, roots: Array, poles: ComplexArray, real: Array
) -> tuple[ComplexArray, Array]:
    """Return the zeros of sigma, where sigma G and sigma share the poles: one round."""
    n, k = len(poles), len(real)
    up = 1 / (s[:, None] - poles)
    down = 1 / (s[:, None] - np.conj(poles))
    basis = np.stack([up + down, 1j * (up - down)], axis=2).reshape(len(s), 2 * n)
    basis = np.concatenate([basis, 1 / (s[:, None] - real)], axis=1)
    element_basis = np.column_stack([basis, np.ones(len(s)), 1 / s])
    rows, right = [], []
    for e in range(data.shape[1]):
        shared = -data[:, [e]] * np.column_stack([basis, np.ones(len(s))])
        both = _real(roots[:, [e]] * np.column_stack([element_basis, shared]))
        triangle = np.asarray(np.linalg.qr(both, mode="r"))
        rows.append(triangle[element_basis.shape[1] :, element_basis.shape[1] :])
        right.append(np.zeros(len(rows[-1])))
    # sigma's mean is 1, or all would be zero: the relaxed condition.
    norm = np.linalg.norm(roots * data) / len(s)
    mean = np.column_stack([basis, np.ones(len(s))]).real.sum(axis=0)
    rows.append(norm * mean[None])
    right.append(np.array([norm * len(s)]))
    coefficients = np.linalg.lstsq(np.concatenate(rows), np.concatenate(right), rcond=None)[0]
    residues, constant = coefficients[:-1], coefficients[-1]
    if abs(constant) < 1e-8:
        constant = np.copysign(1e-8, constant)
    b = np.concatenate([np.tile([2.0, 0.0], n), np.ones(k)])
    A = np.diag(np.concatenate([np.zeros(2 * n), real]))
    for r, p in enumerate(poles):
        A[2 * r : 2 * r + 2, 2 * r : 2 * r + 2] = [[p.real, p.imag], [-p.imag, p.real]]
    new = np.linalg.eigvals(A - np.outer(b, residues) / constant).astype(complex)
    own_real = np.sort(np.abs(new.real[np.abs(new.imag) <= 1e-9]))[:k]
    still = np.concatenate([own_real, np.abs(real[: k - len(own_real)])])
    new = new[new.imag > 1e-9]
    order = np.argsort(-np.abs(new.imag))[:n]
    new = new[order]
    moved = -np.maximum(np.abs(new.real), 1e-5 * np.abs(new)) + 1j * new.imag
    return np.asarray(moved), -np.maximum(still, 1e-6)


def _completed(poles: ComplexArray, count: int, s: ComplexArray) -> ComplexArray:
    """Put poles that became real back into the widest gaps of the band."""
    completed: Sequence[complex] = list(poles)
    low, high = float(s.imag.min()), float(s.imag.max())
    while len(completed) < count:
        edges = np.sort([low, *(p.imag for p in completed), high])
        gap = int(np.argmax(np.diff(edges)))
        completed = [*completed, *_placed(np.array([edges[gap : gap + 2].mean()]))]
    return np.asarray(completed[:count])


def _real(matrix: ComplexArray) -> Array:
    return np.concatenate([matrix.real, matrix.imag])
