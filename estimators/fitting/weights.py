"""Weights: inverse weighting matrices of a fit's cost, element by element or full."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.fitting.residuals import Residual, find_residual
from estimators.frf.frf_estimate import FrfEstimate, is_full, location, unvec, vec
from robotmodels.common.arrays import Array, ComplexArray, check_above_zero, real_numbers
from robotmodels.common.errors import InvalidInput
from robotmodels.common.symmetric_matrices import ROUNDING, scaled_inverse, unit_diagonal_scaling
from robotmodels.linear.residuals import ResidualForm

# Relative error of the model that combined weights allow for where the noise is smaller.
FLOOR = 0.1
# 10 dB, above which the bias of a log residual is negligible ([WM] 5.1, after Pintelon and
# Schoukens 2001, p. 207).
MINIMUM_SNR = float(np.sqrt(10.0))
# Probability of a variance so large that its line must be noisier than its neighbours.
_SURPRISE = 0.01


def user_weights(
    estimate: FrfEstimate,
    diagonal: float = 1.0,
    off_diagonal: float = 0.1,
    from_omega: float = 0.0,
    minimum_snr: float = MINIMUM_SNR,
    elements: NDArray[Any] | None = None,
    response: ComplexArray | None = None,
) -> Array:
    """Return [WM]'s rough weights (Q, F, m, n): constant per element, zero where FRFs are poor.

    Parameters
    ----------
    diagonal, off_diagonal : float
        Weights of the elements on and off the diagonal.
    from_omega : float
        Weights below this frequency [rad/s] are zero.
    minimum_snr : float
        Weights are zero where |G| is below this many of its standard deviations.
    elements : ndarray, (m, n), optional
        Weights of the elements instead of `diagonal` and `off_diagonal`.
    response : ndarray of complex, (Q, F, m, n), optional
        Response whose magnitude is compared with the noise; the measured one where None.

    Raises
    ------
    InvalidInput
        For a negative number, or weights of elements that the FRFs do not have.
    """
    for name, value in (
        ("diagonal", diagonal),
        ("off_diagonal", off_diagonal),
        ("from_omega", from_omega),
        ("minimum_snr", minimum_snr),
    ):
        check_above_zero(value, f"weights.{name}", zero=True)
    m, n = estimate.response.shape[-2:]
    element = np.where(np.eye(m, n, dtype=bool), diagonal, off_diagonal)
    if elements is not None:
        element = _checked_elements(elements, (m, n))
    at = _response(estimate, response)
    good = above_snr(estimate, minimum_snr, at) & (estimate.omega >= from_omega)[:, None, None]
    return np.asarray(np.where(good, element, 0.0))


def _checked_elements(mask: NDArray[Any], shape: tuple[int, ...]) -> Array:
    """Return weights of the elements (m, n) of every FRF."""
    elements = real_numbers(mask, "weights.elements")
    if elements.shape != shape:
        beyond = [k for k, (a, b) in enumerate(zip(elements.shape, shape, strict=False)) if a > b]
        last = tuple(k - 1 for k in elements.shape)
        missing = f"; there is no element {last}" if beyond and elements.ndim == 2 else ""
        raise InvalidInput(
            f"weights.elements: shape {elements.shape} for FRFs of {shape[0]} outputs and "
            f"{shape[1]} inputs{missing}"
        )
    wrong = np.argwhere(~(np.isfinite(elements) & (elements >= 0)))
    if wrong.size:
        i, j = wrong[0]
        raise InvalidInput(
            f"weights.elements: {elements[i, j]:g} of element ({i}, {j}) is not a number >= 0"
        )
    return elements


def above_snr(
    estimate: FrfEstimate, minimum_snr: float, response: ComplexArray
) -> NDArray[np.bool_]:
    """Return a mask of the elements (Q, F, m, n) of `response` above a signal-to-noise ratio.

    Elements of a measured response near the ratio pass if their error happens to be large; a
    model's response makes no such choice. Nor do variances of the neighbouring lines, unlike the
    line's own, which is listened to only where it is larger than chance allows.

    Raises
    ------
    InvalidInput
        If that is not a number >= 0.
    """
    check_above_zero(minimum_snr, "weights.minimum_snr", zero=True)
    if minimum_snr == 0:
        return np.full(response.shape, True)
    noise = estimate.pooled_variance
    finite = np.isfinite(estimate.degrees_of_freedom)
    if finite.any():
        from scipy.special import gammainccinv

        nu = np.where(finite, estimate.degrees_of_freedom, 1.0)
        least = np.where(finite, nu / gammainccinv(nu, _SURPRISE), 1.0)[:, None, None, None]
        noise = np.maximum(noise, estimate.variance * least)
    return np.asarray(np.abs(response) >= minimum_snr * np.sqrt(noise))


def _response(estimate: FrfEstimate, response: ComplexArray | None) -> ComplexArray:
    """Return the FRFs at which log residuals' noise is evaluated, the measured ones where None."""
    if response is None:
        return estimate.response
    if np.shape(response) != estimate.response.shape:
        raise InvalidInput(
            f"weights.response: shape {np.shape(response)} given; {estimate.response.shape} is "
            "needed"
        )
    return np.asarray(response)


def check_positive(weights: NDArray[Any], estimate: FrfEstimate, what: str = "weights") -> None:
    """Refuse weights (Q, F, m, n) of elements that are no numbers >= 0.

    Raises
    ------
    InvalidInput
        With the first such element.
    """
    wrong = np.argwhere(~(np.isfinite(weights) & (weights >= 0)))
    if wrong.size:
        raise InvalidInput(
            f"{what}: {weights[tuple(wrong[0])]:g} at {location(wrong[0], estimate.omega)} "
            "is not a number >= 0"
        )


def optimal_weights(
    estimate: FrfEstimate,
    residual: str | ResidualForm | Residual,
    response: ComplexArray | None = None,
    minimum_snr: float = 0.0,
    *,
    diagonal: bool = False,
) -> Array | ComplexArray:
    """Return the weights of least covariance: [WM] (6) for nls, (8) for log residuals.

    These are $W = Lambda^-1$ and $W = diag(G)^H Lambda^-1 diag(G)$, Lambda the covariance of the
    errors of vec G.

    Variances that were estimated come from neighbouring lines, and from the line itself only as far
    as neighbours tell less, see `pooled_noise`: weights that follow a line's own scatter make it
    look more certain than it is.

    Parameters
    ----------
    residual : str or ResidualForm
        Residual whose noise is to be whitened, "nls", "lls", "lls_magnitude" or one of your own.
    response : ndarray of complex, (Q, F, m, n), optional
        Response at which (8) is evaluated. None takes the measured FRF as [WM] do; its errors then
        correlate with the weights, a bias of the order of the relative variance. The FRF of a
        previous fit avoids it, see `estimators.reweighted`.
    minimum_snr : float
        Elements below so many of their standard deviations have no weight.
    diagonal : bool
        Use the variances only, as [WM] 6 do.

    Returns
    -------
    ndarray or ndarray of complex
        (Q, F, m, n) real for independent elements, (Q, F, m n, m n) Hermitian otherwise.

    Raises
    ------
    InvalidInput
        If a covariance is not positive definite, with position and frequency; if the response does
        not fit, or `minimum_snr` is negative.
    """
    kind, at = find_residual(residual), _response(estimate, response)
    used = above_snr(estimate, minimum_snr, at)
    if kind.relative:
        used &= at != 0  # an infinite relative error
    covariance = estimate.weight_variance if diagonal else estimate.weight_covariance
    noise = kind.noise(covariance, at, used)
    return _inverse(noise, used, estimate)


def combined_weights(
    estimate: FrfEstimate,
    residual: str | ResidualForm | Residual,
    shape: Array | None = None,
    floor: float = FLOOR,
    response: ComplexArray | None = None,
    minimum_snr: float = 0.0,
    *,
    diagonal: bool = True,
) -> Array | ComplexArray:
    """Return the user's weights times those of the noise and of a model error together.

    [WM] section 7: optimal weights suppose that the model can describe everything, and say little
    at resonances; user weights say nothing of the noise. These are U^1/2 (R + floor^2 I)^-1 U^1/2
    with R the residual's noise covariance: optimal where the noise exceeds `floor`, relatively, and
    the user's where it does not. For nls, floor^2 |G|^2 replaces floor^2.

    Parameters
    ----------
    shape : ndarray, (Q, F, m, n), optional
        The user's weights U; `user_weights` where None.
    floor : float, dimensionless
        Relative error of the model.
    diagonal : bool
        Use the variances only.
    residual : str or ResidualForm
        As in `optimal_weights`.
    response : ndarray of complex, optional
        As in `optimal_weights`.
    minimum_snr : float
        As in `optimal_weights`.

    Raises
    ------
    InvalidInput
        If the floor is not positive, the user's weights do not fit, or as `optimal_weights`.
    """
    check_above_zero(floor, "weights.floor")
    kind, at = find_residual(residual), _response(estimate, response)
    user = np.asarray(shape)
    if shape is None:
        user = user_weights(estimate, minimum_snr=minimum_snr, response=response)
    if user.shape != at.shape:
        raise InvalidInput(f"weights.shape: {user.shape} given; {at.shape} is needed")
    check_positive(user, estimate, "weights.shape")
    used = above_snr(estimate, minimum_snr, at) & (user > 0)
    if kind.relative:
        used &= at != 0
    noise = kind.noise(
        estimate.weight_variance if diagonal else estimate.weight_covariance, at, used
    )
    error = floor**2 * kind.noise(np.abs(at) ** 2, at, used)
    if not is_full(noise, at.shape):
        weights: NDArray[Any] = user * _inverse(noise + error, used, estimate)
    else:
        root = np.sqrt(vec(user))
        both = noise + vec(error)[..., None] * np.eye(noise.shape[-1])
        weights = root[..., :, None] * _inverse(both, used, estimate) * root[..., None, :]
    return weights


def _inverse(
    noise: NDArray[Any], used: NDArray[np.bool_], estimate: FrfEstimate
) -> Array | ComplexArray:
    """Return the inverse of the noise of the elements `used`, zero for the others.

    Raises
    ------
    InvalidInput
        If a covariance is not positive definite, with position and frequency.
    """
    if not is_full(noise, used.shape):
        return np.asarray(np.where(used, 1.0 / np.where(used, noise, 1.0), 0.0))
    # Elements left out must not correlate with the others either.
    mask = vec(used)
    pairs = mask[..., :, None] & mask[..., None, :]
    noise = np.where(pairs, noise, np.eye(mask.shape[-1]))
    s = unit_diagonal_scaling(noise)
    smallest = np.linalg.eigvalsh(s[..., :, None] * noise * s[..., None, :])[..., 0]
    bad = np.argwhere(smallest < ROUNDING)
    if bad.size:
        raise InvalidInput(
            f"covariance: the matrix at {location(bad[0], estimate.omega)} is not positive "
            f"definite; average over more than {s.shape[-1]} blocks, or keep its diagonal only"
        )
    inverse = scaled_inverse(noise)
    inverse = (inverse + np.conj(np.swapaxes(inverse, -1, -2))) / 2
    return np.asarray(np.where(pairs, inverse, 0.0))


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


def whiten(root: Array | ComplexArray, values: NDArray[Any]) -> NDArray[Any]:
    """Return S times residuals (Q, F, m, n), or times Jacobians (Q, F, m, n, p), as (Q, F, mn, .).

    The last axis has length one for residuals.
    """
    columns = values[..., None] if values.ndim == 4 else values
    stacked = np.moveaxis(vec(np.moveaxis(columns, -1, 2)), 2, -1)
    if is_full(root, columns.shape[:4]):
        return np.asarray(root @ stacked)
    return np.asarray(vec(root)[..., None] * stacked)
