"""The weights that a fit was asked for, by name or as an array, checked."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.fitting.residuals import Residual
from estimators.fitting.weights import (
    FLOOR,
    MINIMUM_SNR,
    check_positive,
    combined_weights,
    optimal_weights,
    user_weights,
)
from estimators.frf.frf_estimate import FrfEstimate, is_full, location
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import InvalidInput, nearest

KINDS = ("user", "optimal", "optimal_diagonal", "combined")


def evaluate_weights(
    weights: str | NDArray[Any],
    estimate: FrfEstimate,
    kind: Residual,
    response: ComplexArray | None = None,
) -> Array | ComplexArray:
    """Return the weights a fit was asked for: (Q, F, m, n), or (Q, F, m n, m n).

    Named weights leave out elements below 10 dB where a logarithm is taken.

    Parameters
    ----------
    response : ndarray of complex, (Q, F, m, n), optional
        Response at which named weights are evaluated; the measured one where None.

    Raises
    ------
    InvalidInput
        If the name is unknown, or an array does not fit or is not a weight.
    """
    if isinstance(weights, str):
        return _named(weights, estimate, kind, response)
    array = _numbers(weights)
    if array.ndim == 2:
        return user_weights(estimate, minimum_snr=0.0, elements=array)
    if is_full(array, estimate.response.shape):
        _check_matrices(array, estimate)
        # A real residual sees the real part only.
        return np.array(array.real if kind.real else array)
    if np.iscomplexobj(array):
        raise InvalidInput("weights: one weight per element must be a real number")
    check_positive(array, estimate)
    return np.array(array, dtype=float)


def _named(
    name: str, estimate: FrfEstimate, kind: Residual, response: ComplexArray | None
) -> Array | ComplexArray:
    if name not in KINDS:
        raise InvalidInput(
            f"weights {name!r} are none of {', '.join(KINDS)}, nor an array{nearest(name, KINDS)}"
        )
    minimum_snr = MINIMUM_SNR if kind.relative else 0.0
    if name == "user":
        return user_weights(estimate, minimum_snr=minimum_snr, response=response)
    if name == "combined":
        return combined_weights(estimate, kind, response=response, minimum_snr=minimum_snr)
    diagonal = name == "optimal_diagonal"
    return optimal_weights(estimate, kind, response, minimum_snr, diagonal=diagonal)


def line_shares(
    weighting: str, estimate: FrfEstimate, kind: Residual, response: ComplexArray
) -> Array:
    """Return by which power (Q, F, m, n) weights fall with the estimated variance of their line.

    Parameters
    ----------
    weighting : str
        One of `KINDS`; weights of another origin are taken to follow the noise.
    response : ndarray of complex, (Q, F, m, n)
        Response at which weights were evaluated.
    """
    share = np.broadcast_to(estimate.pooled_noise.line_share, response.shape)
    if weighting == "user":
        return np.zeros(response.shape)
    if weighting != "combined":
        return share
    size = np.abs(response) ** 2
    noise = kind.noise(estimate.weight_variance, response, size > 0)
    floor = FLOOR**2 * kind.noise(size, response, size > 0)
    return np.asarray(share * noise / (noise + floor))


def _numbers(weights: NDArray[Any]) -> NDArray[Any]:
    try:
        array = np.asarray(weights)
        if np.issubdtype(array.dtype, np.number):
            return array
    except ValueError:
        pass
    raise InvalidInput(
        f"weights: {str(weights)[:60]} is neither one of {', '.join(KINDS)} nor an array of numbers"
    )


def _check_matrices(array: NDArray[Any], estimate: FrfEstimate) -> None:
    """Refuse matrices (Q, F, m n, m n) that are not Hermitian and positive semidefinite."""
    size = np.sqrt(np.abs(np.diagonal(array, axis1=-2, axis2=-1)))
    skew = np.abs(array - np.conj(np.swapaxes(array, -1, -2)))
    bad = np.argwhere(~(skew <= 1e-9 * size[..., :, None] * size[..., None, :]).all(axis=(-2, -1)))
    if bad.size:
        raise InvalidInput(
            f"weights: the matrix at {location(bad[0], estimate.omega)} is not Hermitian and finite"
        )
    eigenvalues = np.linalg.eigvalsh(array)
    bad = np.argwhere(eigenvalues[..., 0] < -1e-12 * np.abs(eigenvalues[..., -1]))
    if bad.size:
        raise InvalidInput(
            f"weights: the matrix at {location(bad[0], estimate.omega)} is not positive "
            "semidefinite"
        )
