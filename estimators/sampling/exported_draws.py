"""Robots drawn from what a fit leaves open, each written for another program."""

from pathlib import Path

import numpy as np

from estimators.fitting.fitted_model import FittedModel
from estimators.uncertainty.covariance import Uncertainty
from robotmodels.common.arrays import Array, check_count, check_kind, real_numbers
from robotmodels.common.errors import InvalidInput
from robotmodels.exports.export import export
from robotmodels.exports.formats import Format
from robotmodels.exports.robot_files import with_values


def export_draws(
    fit: FittedModel,
    path: str | Path,
    format: Format = "mjcf",
    *,
    count: int,
    rng: np.random.Generator,
    covariance: Array | None = None,
    draws: Array | None = None,
    position: Array | None = None,
) -> tuple[Path, ...]:
    """Write robots whose parameters are drawn from a posterior or a covariance.

    Parameters
    ----------
    fit : Fit
        The fit of a robot.
    path : str or Path
        Name of the files, to which ``-1``, ``-2`` ... is added before the ending.
    format : str
        As in `robotmodels.export`.
    count : int
        Number of robots.
    rng : Generator
        Source of the draws.
    covariance : ndarray, (p, p), optional
        Of ln theta, about the fit.
    draws : ndarray, (N, p), optional
        Of ln theta, as `Posterior.draws` has; `count` of them are taken without replacement.
    position : ndarray, optional
        As in `robotmodels.export`.

    Returns
    -------
    tuple of Path
        The files.

    Raises
    ------
    InvalidInput
        If not one of `covariance` and `draws` is given, they do not fit the parameters, or
        `robotmodels.export` refuses a robot.
    """
    check_kind(fit, FittedModel, "export_draws: fit")
    check_count(count, "count")
    robot, p = fit.robot(), len(fit.parameters)
    if (covariance is None) == (draws is None):
        raise InvalidInput("export_draws: one of covariance and draws is needed")
    if covariance is None:
        assert draws is not None
        drawn = _checked(draws, "draws", (*np.shape(draws)[:1], p))
        if len(drawn) < count:
            raise InvalidInput(f"count: {count}; there are {len(drawn)} draws")
        drawn = rng.choice(drawn, count, replace=False)
    else:
        matrix = _checked(covariance, "covariance", (p, p))
        Uncertainty(fit.parameters.names, matrix, "given")  # refuses what is no covariance
        drawn = parameter_draws(fit.parameters.values, matrix, count, rng)
    path, width = Path(path), len(str(count))
    files = tuple(path.with_stem(f"{path.stem}-{i + 1:0{width}}") for i in range(count))
    for file, ln_theta in zip(files, drawn, strict=True):
        export(with_values(robot, np.exp(ln_theta)), file, format, position)
    return files


def parameter_draws(
    values: Array, covariance: Array, count: int, rng: np.random.Generator
) -> Array:
    """Return draws of ln theta, (count, p), about values (p,) [SI]."""
    return np.asarray(rng.multivariate_normal(np.log(values), covariance, count))


def _checked(values: Array, name: str, shape: tuple[int, int]) -> Array:
    array = real_numbers(values, name)
    if array.shape != shape or not np.isfinite(array).all():
        raise InvalidInput(f"{name}: shape {array.shape}; finite numbers of shape {shape} needed")
    return array
