"""What weights made from few blocks cost: Theorem 1 where the noise covariance is a sample's."""

import numpy as np

from estimators.fitting.least_squares import Fit
from estimators.fitting.residuals import find_residual
from estimators.fitting.weights import used_elements
from estimators.frf.estimate import is_full, vec
from robotmodels.arrays import ComplexArray
from robotmodels.errors import InvalidInput
from robotmodels.response import frequency_response

# Weights this near to the inverse of a covariance are its inverse: those of `reweighted` are taken
# at the model of one round before.
_SAME = 0.02


def meat_factor(fit: Fit, blocks: int) -> float:
    """Return E[S^-1 Lambda S^-1] over E[S^-1], by which Theorem 1's meat is too small.

    Weights S^-1 with S a sample covariance over `blocks` blocks correlate with the S that the meat
    is made of. With nu = blocks - 1 degrees of freedom and d elements that are weighed together,
    moments of the inverse complex Wishart distribution (Maiwald and Kraus 2000) give
    nu^2/((nu - d)^2 - 1): exact for a linear model of many more lines than parameters. It holds two
    parts: S^-1 is too large on average, and weights that scatter are not the best. One where the
    weights are no inverses, as user-defined ones.

    Raises
    ------
    InvalidInput : if there are too few blocks for the elements, for a robust loss, or for full
        weights of magnitudes, whose distribution is another.
    """
    elements = _together(fit)
    if fit.loss != "linear":
        raise InvalidInput(f"blocks: the loss is {fit.loss!r}; they are for 'linear' only")
    if elements > 1 and find_residual(fit.residual).real:
        raise InvalidInput(
            "blocks: not known for magnitudes with full weights; use the residual 'lls', or "
            "weights of single elements"
        )
    if blocks < least_blocks(fit):
        raise InvalidInput(
            f"blocks: {blocks} leave the scatter of weights of {elements} elements together "
            f"unbounded; at least {least_blocks(fit)} are needed, or weights of single elements"
        )
    if not weights_are_inverse(fit):
        return 1.0
    freedom = blocks - 1
    return float(freedom**2 / ((freedom - elements) ** 2 - 1))


def least_blocks(fit: Fit) -> int:
    """Return the fewest blocks whose scatter weights can be allowed for."""
    return _together(fit) + 3


def _together(fit: Fit) -> int:
    """Return the number of elements of an FRF matrix that are weighed together."""
    shape = fit.estimate.response.shape
    if not is_full(fit.weights, shape):
        return 1
    return int(used_elements(fit.weights, shape).sum(axis=(2, 3)).max())


def weights_are_inverse(fit: Fit) -> bool:
    """Tell whether the weights are the inverse of the estimate's covariance.

    For log residuals that depends on an FRF: the measured one, or that of the fit.
    """
    estimate = fit.estimate
    if _inverts(fit, estimate.response):
        return True
    values = fit.parameters.values
    modelled = frequency_response(fit.model, estimate.positions, estimate.omega, values)
    return _inverts(fit, np.asarray(modelled))


def _inverts(fit: Fit, response: ComplexArray) -> bool:
    """Tell whether the weights are the inverse of the residual's covariance at an FRF."""
    shape = response.shape
    used = used_elements(fit.weights, shape)
    kept = vec(used)
    noise = find_residual(fit.residual).noise(fit.estimate.covariance, response, used)
    whole = is_full(noise, shape)
    variance = np.diagonal(noise, axis1=-2, axis2=-1).real if whole else vec(noise)
    if not is_full(fit.weights, shape):
        product = np.where(kept, vec(fit.weights) * variance, 1.0)
        return bool((np.abs(product - 1) < _SAME).all())
    if not whole:
        return False
    pairs = kept[..., :, None] & kept[..., None, :]
    wanted = kept[..., None] * np.eye(kept.shape[-1])
    off = np.abs(fit.weights @ np.where(pairs, noise, 0.0) - wanted)
    std = np.sqrt(variance)  # W R has the units of std_j/std_i
    return bool((off * std[..., :, None] < _SAME * std[..., None, :]).all())
