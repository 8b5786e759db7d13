"""Criteria for what the model is to be good for: compliance of a tool, resonances, margins."""

from estimators.validation.quantities import Quantity, log_gradients
from oed.criteria.criteria import ICriterion
from oed.criteria.prediction_variance import prediction_matrix
from robotmodels.common.arrays import Array
from robotmodels.linear.response import Elastic


def purpose_criterion(
    robot: Elastic, quantity: str | Quantity, positions: Array, parameters: Array | None = None
) -> ICriterion:
    """Return the mean relative variance of a quantity over positions: I- or V-optimality.

    Parameters
    ----------
    robot : Elastic
        Robot that designs are for.
    quantity : str or Quantity
        As in `estimators.predict`; any function of model, positions and parameters will do, such
        as one that returns `robotmodels.loop_margins(...).gain_margin`.
    positions : ndarray, (Q, n), rad
        Where it is to be known, measured in or not.
    parameters : ndarray, (p,), optional
        Parameters at which derivatives are taken; the robot's by default.

    Raises
    ------
    InvalidInput
        For an unknown quantity, or one that does not exist in a position.
    IdentificationError
        If the robot has no equilibrium in a position.
    """
    return ICriterion(prediction_matrix(log_gradients(robot, quantity, positions, parameters)))
