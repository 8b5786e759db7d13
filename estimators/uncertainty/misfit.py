"""Whether noise explains the cost of a fit, whatever its weights."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.fitting.least_squares import Fit
from estimators.fitting.residuals import find_residual
from estimators.fitting.weights import used_elements
from estimators.frf.estimate import is_full, vec
from estimators.uncertainty.estimated_noise import weights_are_inverse
from estimators.uncertainty.model_error import expected_cost
from estimators.uncertainty.theorem_1 import weighted_noise
from robotmodels.errors import InvalidInput
from robotmodels.response import frequency_response


@dataclass(frozen=True)
class Misfit:
    """A cost beside what noise lets expect.

    Attributes
    ----------
    ratio : cost over its expectation [-].
    probability : of a cost as large as this or larger if there is only noise.
    """

    ratio: float
    probability: float


def misfit(fit: Fit, blocks: int | None = None) -> Misfit:
    """Return the reduced cost of a fit and its probability.

    Of normal noise a cost has the variance sum tr(W R W R), of which the fitted parameters take
    away as large a share as of the mean; the chi square of the same mean and variance stands for
    its distribution (Satterthwaite 1946), which is exact for optimal weights and a linear model.
    Weights that are inverses of sample covariances over few blocks make the cost larger, as
    Hotelling's T^2 is, and let it scatter more; `blocks` takes that into account. Costs with other
    weights are not larger.

    Parameters
    ----------
    blocks : that the estimate's covariance was made from; None if it is known exactly.

    Raises
    ------
    InvalidInput : for a robust loss, or too few blocks for the elements of an FRF.
    SolverFailed : if the fit has no finite cost.
    """
    from scipy.stats import chi2

    expected = expected_cost(fit)
    ratio = fit.data_cost / expected
    kind, estimate = find_residual(fit.residual), fit.estimate
    shape = estimate.response.shape
    used = used_elements(fit.weights, shape)
    G = np.asarray(
        frequency_response(fit.model, estimate.positions, estimate.omega, fit.parameters.values)
    )
    noise = kind.noise(estimate.covariance, G, used)
    half = 2.0 if kind.real else 1.0
    mean = _trace(fit.weights, noise, shape) / half
    spread = _trace(weighted_noise(fit.weights, noise, shape), noise, shape) / half
    if blocks is not None and weights_are_inverse(fit):
        whole = is_full(fit.weights, shape)
        elements = int(used.sum(axis=(2, 3)).max()) if whole else 1
        larger, wider = _hotelling(blocks, elements)
        ratio, spread = ratio / larger, spread * wider / larger**2
    # Mean^2 over variance, both of what is left after the fit.
    dof = 2 * mean * expected / spread
    return Misfit(float(ratio), float(chi2.sf(ratio * dof, dof)))


def _trace(a: NDArray[Any], b: NDArray[Any], shape: tuple[int, ...]) -> float:
    """Return sum tr(A B) of Hermitian matrices, or of diagonal ones given by their elements."""
    if is_full(a, shape) and is_full(b, shape):
        return float(np.einsum("qfij,qfji->", a, b).real)
    left, right = (
        np.diagonal(x, axis1=-2, axis2=-1).real if is_full(x, shape) else vec(x) for x in (a, b)
    )
    return float(np.sum(left * right))


def _hotelling(blocks: int, elements: int) -> tuple[float, float]:
    """Return by what mean and variance of e^H S^-1 e exceed those for a known covariance.

    (blocks - elements)/((blocks - 1) elements) times it is F distributed with 2 elements and
    2 (blocks - elements) degrees of freedom.
    """
    freedom = 2 * (blocks - elements)
    if freedom <= 4:
        raise InvalidInput(
            f"blocks: {blocks} tell nothing of the scatter of {elements} elements together; at "
            f"least {elements + 3} are needed"
        )
    factor = (blocks - 1) * elements / (blocks - elements)
    mean = freedom / (freedom - 2)
    variance = mean**2 * (2 * elements + freedom - 2) / (elements * (freedom - 4))
    return factor * mean / elements, factor**2 * variance / elements
