"""Predictions at positions that were not fitted, and their calibration."""

from dataclasses import dataclass

import numpy as np

from estimators.fitting.weights import optimal_weights, square_root, whiten
from estimators.frf.frf_estimate import FrfEstimate
from estimators.uncertainty.covariance import Uncertainty
from robotmodels.common.arrays import IMPROBABLE, Array, ComplexArray, read_only
from robotmodels.common.errors import InvalidInput
from robotmodels.linear.response import Elastic, sensitivity

LEVELS = np.linspace(0.05, 0.95, 19)


@dataclass(frozen=True, eq=False)
class Validation:
    """How measured FRFs lie in their predicted bands.

    Attributes
    ----------
    levels : ndarray, (L,)
        Nominal.
    coverage : ndarray, (L,)
        Share of the measured elements inside the predicted region of each level.
    by_position : ndarray, (Q, L)
        The same in each position.
    misfit : float
        Squared distance of all data from their prediction in the metric of the predicted
        covariance, per datum; one is expected.
    probability : float
        Probability of a misfit as large as this, or as small, if predictions are right, two-sided.
    """

    levels: Array
    coverage: Array
    by_position: Array
    misfit: float
    probability: float

    @property
    def calibrated(self) -> bool:
        """Whether chance explains the misfit."""
        return self.probability > IMPROBABLE

    def __str__(self) -> str:
        if self.calibrated:
            word = "predictions hold"
        elif self.misfit > 1:
            word = "predictions are too narrow: a model error, or more noise than stated"
        else:
            word = "predictions are too wide: less noise than stated"
        at = int(np.argmin(np.abs(self.levels - 0.95)))
        return (
            f"{word}; misfit {self.misfit:.3g} per datum (1 is expected), "
            f"{100 * self.coverage[at]:.1f} % of the elements inside their "
            f"{100 * self.levels[at]:.0f} % regions"
        )


def validate(
    model: Elastic,
    values: Array,
    held_out: FrfEstimate,
    uncertainty: Uncertainty,
    levels: Array = LEVELS,
) -> Validation:
    """Return how well a fit predicts FRFs it has not seen.

    The predicted covariance of a measured FRF is the parameters' by the delta method plus the
    noise. Regions are ellipses in the complex plane; elements share the parameters' errors, so a
    single validation's coverage scatters more than a binomial number. The misfit of all data
    together takes that into account, and has an F law if predictions are right.

    Parameters
    ----------
    model : Elastic
        Model that was fitted.
    values : ndarray, (p,)
        Fitted parameters [SI].
    held_out : FrfEstimate
        Estimates in positions that were not fitted.
    uncertainty : Uncertainty
        Uncertainty of the fit, a covariance of ln theta.
    levels : ndarray
        Nominal coverages to check.

    Raises
    ------
    InvalidInput
        For levels outside (0, 1), or an uncertainty of other parameters.
    """
    levels = np.asarray(levels, dtype=float)
    if not ((levels > 0) & (levels < 1)).all():
        raise InvalidInput(f"levels: {levels.min():g} to {levels.max():g}; between 0 and 1 needed")
    if uncertainty.names != model.parameters.names:
        raise InvalidInput(
            f"validation: an uncertainty of {', '.join(uncertainty.names)} for the parameters "
            f"{', '.join(model.parameters.names)}"
        )
    G, J = sensitivity(model, held_out.positions, held_out.omega, values)
    error = held_out.response - G
    parts = np.stack([J.real, J.imag], axis=-2)
    shape = parts @ uncertainty.covariance @ np.swapaxes(parts, -1, -2)
    shape = shape + held_out.pooled_variance[..., None, None] / 2 * np.eye(2)
    error_parts = np.stack([error.real, error.imag], axis=-1)
    squares = np.sum(error_parts * np.linalg.solve(shape, error_parts[..., None])[..., 0], axis=-1)
    inside = -np.expm1(-squares / 2)[..., None] <= levels  # chi square of two degrees
    by_position = inside.mean(axis=(1, 2, 3))
    misfit, probability = _joint(error, J, held_out, uncertainty)
    return Validation(
        read_only(levels),
        read_only(by_position.mean(axis=0)),
        read_only(by_position),
        misfit,
        probability,
    )


def _joint(
    error: ComplexArray, slopes_of_g: ComplexArray, held_out: FrfEstimate, uncertainty: Uncertainty
) -> tuple[float, float]:
    """Return e^T (noise + J C J^T)^-1 e per datum by Woodbury's formula, and its probability.

    Of a covariance with few degrees of freedom the ratio to its own size has an F law, as in
    `estimators.trust.residual_size`.
    """
    from scipy.stats import f as f_law

    root = square_root(optimal_weights(held_out, "nls"), error.shape)
    white = np.sqrt(2) * whiten(root, error).reshape(-1)
    slopes = np.sqrt(2) * whiten(root, slopes_of_g).reshape(-1, slopes_of_g.shape[-1])
    white = np.concatenate([white.real, white.imag])
    slopes = np.concatenate([slopes.real, slopes.imag])
    # In units of the standard deviations along independent directions of ln theta.
    variances, vectors = np.linalg.eigh(uncertainty.covariance)
    slopes = slopes @ (vectors * np.sqrt(np.maximum(variances, 0.0)))
    seen = slopes.T @ white
    explained = seen @ np.linalg.solve(np.eye(len(seen)) + slopes.T @ slopes, seen)
    stated = held_out.variance / held_out.pooled_variance
    ratio = float(white @ white - explained) / white.size / float(stated.mean())
    nu = held_out.degrees_of_freedom[:, None, None, None]
    finite_freedom = np.where(np.isfinite(nu), nu, 1e9)
    numerator = (
        white.size * stated.mean() ** 2 / (stated**2 * finite_freedom / (finite_freedom + 1)).mean()
    )
    denominator = numerator * float(finite_freedom.mean())
    below = float(f_law.cdf(ratio, numerator, denominator))
    above = float(f_law.sf(ratio, numerator, denominator))
    return ratio, 2 * min(below, above)
