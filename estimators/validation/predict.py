"""Predictions of any quantity of a fit, or of a robot file with standard deviations, with bands."""

from dataclasses import dataclass

import numpy as np

from estimators.fitting.fitted_model import FittedModel
from estimators.uncertainty.recommended import recommended_uncertainty
from estimators.validation.bands import Spread, checked_spread, propagate
from estimators.validation.quantities import Quantity, find_quantity
from robotmodels.common.arrays import Array, ComplexArray, real_numbers
from robotmodels.elastic.robot import ElasticRobot


@dataclass(frozen=True, eq=False)
class Prediction:
    """A predicted quantity in Q positions, with its uncertainty due to the parameters.

    Attributes
    ----------
    positions : ndarray, (Q, n), rad
        Positions.
    values : ndarray, (Q, ...)
        The quantity at the fit, SI units; complex if it is a response.
    std : ndarray, (Q, ...), dimensionless
        Standard deviations of ln |values|, so relative ones.
    phase_std : ndarray, (Q, ...), rad
        Of phases; zero of real quantities.
    lower, upper : ndarray, (Q, ...)
        Ends of the intervals of |values|.
    level : float
        Nominal coverage of each interval.
    """

    positions: Array
    values: Array | ComplexArray
    std: Array
    phase_std: Array
    lower: Array
    upper: Array
    level: float


def predict(
    source: FittedModel | ElasticRobot,
    quantity: str | Quantity,
    positions: Array,
    omega: Array | None = None,
    *,
    spread: Spread | None = None,
    level: float = 0.95,
) -> Prediction:
    """Return a fit's prediction of a quantity in any positions, with its band.

    Parameters
    ----------
    source : Fit, RunFit or ElasticRobot
        A fit; or a robot whose file has standard deviations, of a fit or of guesses.
    quantity : str or Quantity
        "tool_compliance", "tool_response", "resonances", "damping_ratios"; or an object such as
        `ToolCompliance`, `ToolResponse`, `Resonances`, `DampingRatios`, or any function of model,
        positions and parameters.
    positions : ndarray, (Q, n), rad
        Measured in or not.
    omega : ndarray, (F,), rad/s, optional
        Any angular frequencies, of "tool_response".
    spread : Uncertainty or ndarray, (N, p), optional
        Covariance of ln theta, or draws of it such as `Posterior.draws`; by default
        `recommended_uncertainty`. Draws are better where standard deviations exceed some 20 %.
    level : float
        Nominal coverage of each interval.

    Raises
    ------
    NotIdentifiable
        If the fit leaves a combination of parameters open.
    InvalidInput
        For an unknown quantity, a level outside (0, 1), a spread of other parameters, or a robot
        file without standard deviations.
    IdentificationError
        If the model has no equilibrium in a position.
    """
    model = source if isinstance(source, ElasticRobot) else source.model
    spread = recommended_uncertainty(source) if spread is None else spread
    spread = checked_spread(model.parameters.names, spread, level)
    evaluated = find_quantity(quantity, omega)
    at = np.atleast_2d(real_numbers(positions, "positions"))
    theta = np.asarray(source.parameters.values)
    values, band = propagate(lambda x: evaluated(model, at, x), theta, spread, level)
    return Prediction(at, values, band.std, band.phase_std, band.lower, band.upper, level)
