"""Predictions at positions that were not fitted, and their calibration."""

from dataclasses import dataclass

import numpy as np

from estimators.fitting.fit_problem import FitProblem, Measured
from estimators.fitting.frf_problem import frf_problem
from estimators.fitting.run_problem import run_problem
from estimators.frf.frf_estimate import FrfEstimate
from estimators.input_output.run_scatter import square_spread
from estimators.trust.linearised_fit import LinearisedFit
from estimators.uncertainty.covariance import Uncertainty
from robotmodels.common.arrays import IMPROBABLE, Array, read_only
from robotmodels.common.errors import InvalidInput
from robotmodels.linear.response import Elastic

LEVELS = np.linspace(0.05, 0.95, 19)


@dataclass(frozen=True, eq=False)
class Validation:
    """Coverage of measured FRFs, or outputs of runs, by their predicted bands.

    Attributes
    ----------
    levels : ndarray, (L,)
        Nominal.
    coverage : ndarray, (L,)
        Share of the measured elements inside the predicted region of each level.
    by_position : ndarray, (Q, L)
        The same in each position.
    mean_squares : ndarray, (Q, F)
        Squared errors over their predicted variances, the mean of all elements of a line; one is
        expected.
    misfit : float
        Squared distance of all data from their prediction in the metric of the predicted
        covariance, per datum; one is expected.
    probability : float
        Probability of a misfit as large as this, or as small, if predictions are right, two-sided.
    """

    levels: Array
    coverage: Array
    by_position: Array
    mean_squares: Array
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
    held_out: Measured,
    uncertainty: Uncertainty,
    levels: Array = LEVELS,
) -> Validation:
    """Return how well a fit predicts FRFs or runs it has not seen.

    The predicted covariance of a measured FRF, or of a run's outputs less their prediction, is the
    parameters' by the delta method plus the noise. Regions are ellipses in the complex plane;
    elements share the parameters' errors, so a single validation's coverage scatters more than a
    binomial number. The misfit of all data together takes that into account, and has an F law if
    predictions are right.

    Parameters
    ----------
    model : Elastic
        Model that was fitted.
    values : ndarray, (p,)
        Fitted parameters [SI].
    held_out : FrfEstimate or RunSpectra
        Data in positions that were not fitted.
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
    problem, spread = _problem(model, held_out)
    fit = problem.linearise(values)
    # chi square of two degrees
    squares = _squares(fit, uncertainty.covariance)
    inside = -np.expm1(-squares / 2)[..., None] <= levels
    by_position = inside.mean(axis=(1, 2))
    misfit, probability = _joint(*problem.evaluate(values), fit, uncertainty, spread)
    return Validation(
        read_only(levels),
        read_only(by_position.mean(axis=0)),
        read_only(by_position),
        read_only(squares.mean(axis=2) / 2),
        misfit,
        probability,
    )


def _problem(model: Elastic, held_out: Measured) -> tuple[FitProblem, Array]:
    """Return the problem of the data, by the likelihood, and `square_spread` of positions (Q,)."""
    if isinstance(held_out, FrfEstimate):
        ones = np.ones(len(held_out.positions))
        return frf_problem(model, held_out, "nls", "optimal"), ones
    problem, runs = run_problem(model, held_out), held_out.inputs.shape[1]
    return problem, square_spread(held_out.degrees_of_freedom, problem.rows, runs)


def _squares(fit: LinearisedFit, covariance: Array) -> Array:
    """Return squared errors by their predicted covariance in the complex plane, (Q, F, k)."""
    parts = np.stack([fit.jacobian.real, fit.jacobian.imag], axis=-2)
    shape = parts @ covariance @ np.swapaxes(parts, -1, -2)
    shape = shape + _variance(fit)[..., None, None] / 2 * np.eye(2)
    errors = np.stack([fit.residuals.real, fit.residuals.imag], axis=-1)
    return np.asarray(np.sum(errors * np.linalg.solve(shape, errors[..., None])[..., 0], axis=-1))


def _variance(fit: LinearisedFit) -> Array:
    """Return the variances (Q, F, k) of the noise, as smooth as its weights."""
    stated = fit.element_variances * fit.noise_weights
    return np.asarray(stated.mean(axis=(1, 2), keepdims=True) / fit.noise_weights)


def _joint(
    white: Array, slopes: Array, fit: LinearisedFit, uncertainty: Uncertainty, spread: Array
) -> tuple[float, float]:
    """Return e^T (noise + J C J^T)^-1 e per datum by Woodbury's formula, and its probability.

    `white` and `slopes` are e and J whitened by the noise, its variances one half. Of a covariance
    with few degrees of freedom the ratio to its own size has an F law, as in
    `estimators.trust.residual_size`; of correlated elements fewer count, and fewer by `spread` (Q,)
    where covariances are sampled line by line.
    """
    from scipy.stats import f as f_law

    white, slopes = np.sqrt(2) * white, np.sqrt(2) * slopes
    # In units of the standard deviations along independent directions of ln theta.
    variances, vectors = np.linalg.eigh(uncertainty.covariance)
    slopes = slopes @ (vectors * np.sqrt(np.maximum(variances, 0.0)))
    seen = slopes.T @ white
    explained = seen @ np.linalg.solve(np.eye(len(seen)) + slopes.T @ slopes, seen)
    stated = fit.element_variances * fit.noise_weights
    squares = stated**2
    if fit.covariance.ndim > fit.weights.ndim:  # correlations that whitening leaves
        root = np.sqrt(fit.noise_weights)
        squares = (np.abs(root[..., None] * fit.covariance * root[..., None, :]) ** 2).sum(axis=-1)
    ratio = float(white @ white - explained) / white.size / float(stated.mean())
    nu = fit.degrees_of_freedom[:, None, None]
    finite_freedom = np.where(np.isfinite(nu), nu, 1e9)
    # The F law has the scatter (nu + 1)/nu of variances that are sampled.
    squares = squares * spread[:, None, None] * finite_freedom / (finite_freedom + 1)
    numerator = white.size * stated.mean() ** 2 / squares.mean()
    denominator = numerator * float(finite_freedom.mean())
    below = float(f_law.cdf(ratio, numerator, denominator))
    above = float(f_law.sf(ratio, numerator, denominator))
    return ratio, 2 * min(below, above)
