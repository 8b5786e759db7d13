"""The robot that a fit found: its values in a robot file, how certain they are, and from what."""

from importlib.metadata import version

import numpy as np

from estimators.fitting.priors import Prior
from estimators.trust.trust import Trust
from robotmodels.common.arrays import Array, real_numbers
from robotmodels.common.errors import InvalidInput
from robotmodels.description.parameters import Parameters
from robotmodels.description.robot_file import Fitted
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.elastic.tool_response import underlying_robot
from robotmodels.exports.robot_files import with_friction, with_values
from robotmodels.library.robot_digest import robot_digest
from robotmodels.linear.response import Elastic


def fitted_robot(
    fitted_model: Elastic,
    values: Array,
    trust: Trust,
    provenance: dict[str, str],
    covariance: Array | None = None,
    levels: Array | None = None,
) -> ElasticRobot:
    """Return the robot of a fit with the fitted values, see `Fit.robot`.

    Parameters
    ----------
    fitted_model : Elastic
        Model that was fitted.
    values : ndarray, (p,), SI
        Fitted.
    trust : Trust
        Recommended intervals.
    provenance : dict of str to str
        What the fit rests on.
    covariance : ndarray, (p, p), optional
        Covariance of ln theta, whose correlations go along.
    levels : ndarray, (n,), N m, optional
        Fitted Coulomb friction of the motors, see `with_friction`.

    Raises
    ------
    InvalidInput
        If the model is no robot, or no body can have the fitted inertia.
    """
    model = underlying_robot(fitted_model)
    std = {
        interval.name: float(trust.std[i])
        for i, interval in enumerate(trust.intervals)
        if interval.verdict.gives_interval and np.isfinite(trust.std[i]) and trust.std[i] > 0
    }
    fitted = Fitted(
        relative_std=std,
        correlation=[]
        if covariance is None
        else _correlations(model.parameters, list(std), covariance),
        verdict=str(trust.verdict),
        provenance={
            "program": f"elastic-robot-oed {version('elastic-robot-oed')}",
            "start": f"robot file {model.name}, sha256 {robot_digest(model)}",
            **provenance,
            "standard deviations": trust.method,
            "verdict": trust.verdict.reason,
        },
    )
    robot = with_values(model, values, fitted)
    return robot if levels is None else with_friction(robot, levels)


def _correlations(parameters: Parameters, names: list[str], covariance: Array) -> list[list[float]]:
    """Return the rows below the diagonal of the correlation matrix of some parameters."""
    p = len(parameters)
    matrix = real_numbers(covariance, "covariance")
    if matrix.shape != (p, p):
        raise InvalidInput(f"covariance: shape {matrix.shape}; {(p, p)} is needed")
    columns = [parameters.index(name) for name in names]
    selected = matrix[np.ix_(columns, columns)]
    scale = np.sqrt(np.diag(selected))
    return [row[:i].tolist() for i, row in enumerate(selected / np.outer(scale, scale))]


def robot_prior(robot: ElasticRobot) -> Prior:
    """Return the prior that a robot file holds: of an earlier fit (`Fit.robot`), or of guesses.

    Its medians are the file's values; free parameters without a standard deviation have none.
    Those of a fit come before those of guesses. Correlations are those of the file.

    Raises
    ------
    InvalidInput
        If the file has no standard deviation of a free parameter.
    """
    fitted, parameters = robot.file.fitted, robot.parameters
    std = robot.file.guessed | (fitted.relative_std if fitted else {})
    names = tuple(name for name in parameters.names if name in std)
    if not names:
        raise InvalidInput(
            f"prior: robot file {robot.name!r} has no standard deviation of a free parameter, "
            "neither in fitted.relative_std, as that of a fit has, nor in guessed, as `oed init` "
            "writes"
        )
    values = parameters.values[[parameters.index(name) for name in names]]
    return Prior(names, values, np.array([std[name] for name in names]), _matrix(fitted, names))


def _matrix(fitted: Fitted | None, names: tuple[str, ...]) -> Array | None:
    """Return the correlations of some parameters from a robot file, (k, k); None without any."""
    if fitted is None or not fitted.correlation:
        return None
    order = list(fitted.relative_std)
    order += [name for name in names if name not in order]  # guesses
    matrix = np.eye(len(order))
    for i, row in enumerate(fitted.correlation):
        matrix[i, :i] = matrix[:i, i] = row
    columns = [order.index(name) for name in names]
    return matrix[np.ix_(columns, columns)]
