"""Weights: inverse weighting matrices of a fit's cost, element by element or full."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.frf_estimate import FrfEstimate, is_full, place, unvec, vec
from estimators.residuals import Residual, find_residual
from robotmodels.arrays import Array, ComplexArray
from robotmodels.errors import InvalidInput, nearest

KINDS = ("user", "optimal")
# 10 dB, above which the bias of a log residual is negligible ([WM] 5.1, after Pintelon and
# Schoukens 2001, p. 207).
MINIMUM_SNR = float(np.sqrt(10.0))


def user_weights(
    estimate: FrfEstimate,
    diagonal: float = 1.0,
    off_diagonal: float = 0.1,
    from_omega: float = 0.0,
    minimum_snr: float = MINIMUM_SNR,
) -> Array:
    """Return [WM]'s rough weights (Q, F, m, n): constant per element, zero where FRFs are poor.

    Parameters
    ----------
    diagonal, off_diagonal : weights of the elements on and off the diagonal.
    from_omega : weights below this frequency [rad/s] are zero.
    minimum_snr : weights are zero where |G| is below this many of its standard deviations.
    """
    for name, value in (
        ("diagonal", diagonal),
        ("off_diagonal", off_diagonal),
        ("from_omega", from_omega),
        ("minimum_snr", minimum_snr),
    ):
        if not (np.isfinite(value) and value >= 0):
            raise InvalidInput(f"weights.{name}: {value!r} is not a number >= 0")
    m, n = estimate.response.shape[-2:]
    element = np.where(np.eye(m, n, dtype=bool), diagonal, off_diagonal)
    good = clear(estimate, minimum_snr) & (estimate.omega >= from_omega)[:, None, None]
    return np.asarray(np.where(good, element, 0.0))


def clear(estimate: FrfEstimate, minimum_snr: float) -> NDArray[np.bool_]:
    """Return which elements (Q, F, m, n) are at least so many of their standard deviations."""
    return np.asarray(np.abs(estimate.response) >= minimum_snr * np.sqrt(estimate.variance))


def optimal_weights(
    estimate: FrfEstimate,
    residual: str | Residual,
    response: ComplexArray | None = None,
    minimum_snr: float = 0.0,
) -> Array | ComplexArray:
    """Return the weights of least covariance: [WM] (6) for nls, (8) for log residuals.

    Parameters
    ----------
    residual : whose noise is to be whitened, "nls", "lls" or "lls_magnitude".
    response : (Q, F, m, n) at which (8) is evaluated. None takes the measured FRF as [WM] do; its
        errors then correlate with the weights, a bias of the order of the relative variance. The
        FRF of a previous fit avoids it, see `estimators.reweighted`.
    minimum_snr : elements below so many of their standard deviations are left out.

    Returns
    -------
    (Q, F, m, n) real for independent elements, (Q, F, m n, m n) Hermitian otherwise.

    Raises
    ------
    InvalidInput : if a covariance is not positive definite, with position and frequency.
    """
    kind = find_residual(residual)
    at = estimate.response if response is None else np.asarray(response)
    used = clear(estimate, minimum_snr)
    if kind.relative:
        used &= at != 0  # an infinite relative error
    noise = kind.noise(estimate.covariance, at, used)
    if not estimate.has_full_covariance:
        return np.asarray(np.where(used, 1.0 / noise, 0.0))
    # Elements left out must not correlate with the others either.
    kept = vec(used)
    pairs = kept[..., :, None] & kept[..., None, :]
    noise = np.where(pairs, noise, np.eye(kept.shape[-1]))
    size = np.sqrt(np.diagonal(noise, axis1=-2, axis2=-1).real)
    outer = size[..., :, None] * size[..., None, :]
    smallest = np.linalg.eigvalsh(noise / outer)[..., 0]
    bad = np.argwhere(smallest < 1e-12)
    if bad.size:
        raise InvalidInput(
            f"covariance: the matrix at {place(bad[0], estimate.omega)} is not positive definite; "
            f"average over more than {size.shape[-1]} blocks, or keep its diagonal only"
        )
    inverse = np.linalg.inv(noise / outer) / outer
    inverse = (inverse + np.conj(np.swapaxes(inverse, -1, -2))) / 2
    return np.asarray(np.where(pairs, inverse, 0.0))


def chosen_weights(
    weights: str | NDArray[Any], estimate: FrfEstimate, kind: Residual
) -> Array | ComplexArray:
    """Return the weights a fit was asked for, by name or as an array, checked.

    Named weights leave out elements below 10 dB where a logarithm is taken.

    Raises
    ------
    InvalidInput : if the name is unknown, or an array does not fit or is not a weight.
    """
    if isinstance(weights, str):
        if weights not in KINDS:
            raise InvalidInput(
                f"weights {weights!r} are none of {', '.join(KINDS)}, nor an array"
                f"{nearest(weights, KINDS)}"
            )
        minimum_snr = MINIMUM_SNR if kind.relative else 0.0
        if weights == "user":
            return user_weights(estimate, minimum_snr=minimum_snr)
        return optimal_weights(estimate, kind, minimum_snr=minimum_snr)
    array = np.asarray(weights)
    if not is_full(array, estimate.response.shape):
        if np.iscomplexobj(array):
            raise InvalidInput("weights: one weight per element must be a real number")
        wrong = np.argwhere(~(np.isfinite(array) & (array >= 0)))
        if wrong.size:
            raise InvalidInput(
                f"weights: {array[tuple(wrong[0])]:g} at {place(wrong[0], estimate.omega)} "
                "is not a number >= 0"
            )
        return np.array(array, dtype=float)
    size = np.sqrt(np.abs(np.diagonal(array, axis1=-2, axis2=-1)))
    skew = np.abs(array - np.conj(np.swapaxes(array, -1, -2)))
    bad = np.argwhere(~(skew <= 1e-9 * size[..., :, None] * size[..., None, :]).all(axis=(-2, -1)))
    if bad.size:
        raise InvalidInput(
            f"weights: the matrix at {place(bad[0], estimate.omega)} is not Hermitian and finite"
        )
    eigenvalues = np.linalg.eigvalsh(array)
    bad = np.argwhere(eigenvalues[..., 0] < -1e-12 * np.abs(eigenvalues[..., -1]))
    if bad.size:
        raise InvalidInput(
            f"weights: the matrix at {place(bad[0], estimate.omega)} is not positive semidefinite"
        )
    # A real residual sees the real part only.
    return np.array(array.real if kind.real else array)


def used_elements(weights: Array | ComplexArray, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Return which elements (Q, F, m, n) carry any weight."""
    if not is_full(weights, shape):
        return np.asarray(weights > 0)
    diagonal = np.diagonal(weights, axis1=-2, axis2=-1).real
    return np.asarray(unvec(diagonal > 0, shape[-2]))


def square_root(weights: Array | ComplexArray, shape: tuple[int, ...]) -> Array | ComplexArray:
    """Return S with S^H S = weights; whitened residuals are S times residuals."""
    if not is_full(weights, shape):
        return np.asarray(np.sqrt(weights))
    values, vectors = np.linalg.eigh(weights)
    root = np.sqrt(np.clip(values, 0.0, None))
    return np.ascontiguousarray(root[..., :, None] * np.conj(np.swapaxes(vectors, -1, -2)))


def weighted_squares(root: Array | ComplexArray, error: Array | ComplexArray) -> Array:
    """Return sum |S error|^2, (...), of residuals (..., Q, F, m, n): the cost V of each."""
    full = is_full(root, error.shape[-4:])
    white = root @ vec(error)[..., None] if full else root * error
    return np.asarray(np.sum(white.real**2 + white.imag**2, axis=(-4, -3, -2, -1)))


def whiten(root: Array | ComplexArray, values: NDArray[Any]) -> NDArray[Any]:
    """Return S times residuals (Q, F, m, n), or times Jacobians (Q, F, m, n, p), as (Q, F, mn, .).

    The last axis has length one for residuals.
    """
    columns = values[..., None] if values.ndim == 4 else values
    stacked = np.moveaxis(vec(np.moveaxis(columns, -1, 2)), 2, -1)
    if is_full(root, columns.shape[:4]):
        return np.asarray(root @ stacked)
    return np.asarray(vec(root)[..., None] * stacked)
