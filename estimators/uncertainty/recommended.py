"""The covariance to predict and to draw with: of a fit as recommended, or as a robot file says."""

import numpy as np

from estimators.fitting.fitted_model import FittedModel
from estimators.fitting.fitted_robot import robot_prior
from estimators.uncertainty.covariance import Uncertainty, covariance
from robotmodels.elastic.robot import ElasticRobot


def recommended_uncertainty(source: FittedModel | ElasticRobot) -> Uncertainty:
    """Return the covariance of ln theta to predict with.

    Of a fit it is that of Theorem 1 with the standard deviations of the recommended intervals; of a
    robot what its file says, parameters without a standard deviation being certain.

    Raises
    ------
    NotIdentifiable
        If the fit leaves a combination of parameters open.
    InvalidInput
        If the robot file has no standard deviation.
    """
    if isinstance(source, ElasticRobot):
        return _of_file(source)
    theorem, std = covariance(source), source.trust.std
    scale = np.where(np.isfinite(std) & (theorem.std > 0), std, theorem.std)
    scale = scale / np.where(theorem.std > 0, theorem.std, 1.0)
    freedom = source.trust.scatter.degrees_of_freedom
    matrix = scale[:, None] * theorem.covariance * scale
    return Uncertainty(theorem.names, matrix, source.trust.method, freedom)


def _of_file(robot: ElasticRobot) -> Uncertainty:
    prior, names = robot_prior(robot), robot.parameters.names
    columns = prior.columns(names)
    correlation = np.eye(len(columns)) if prior.correlation is None else prior.correlation
    matrix = np.zeros((len(names), len(names)))
    matrix[np.ix_(columns, columns)] = prior.std[:, None] * correlation * prior.std
    return Uncertainty(names, matrix, "standard deviations of the robot file")
