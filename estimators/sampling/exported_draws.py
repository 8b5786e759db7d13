"""Robots drawn from what a fit leaves open, each written for another program, and their table."""

import csv
import io
from pathlib import Path

import numpy as np

from estimators.fitting.fitted_model import FittedModel
from estimators.uncertainty.covariance import Uncertainty
from estimators.uncertainty.recommended import recommended_uncertainty
from robotmodels.common.arrays import Array, check_count, check_kind, real_numbers
from robotmodels.common.atomic_files import write_text
from robotmodels.common.errors import InvalidInput
from robotmodels.description.parameters import Parameters
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.exports.export import export
from robotmodels.exports.formats import Format
from robotmodels.exports.robot_files import with_values


def export_draws(
    fit: FittedModel | ElasticRobot,
    path: str | Path,
    format: Format = "mjcf",
    *,
    count: int,
    rng: np.random.Generator,
    covariance: Array | None = None,
    draws: Array | None = None,
    position: Array | None = None,
    models: bool = True,
    table: bool = False,
) -> tuple[Path, ...]:
    """Write robots whose parameters are drawn from a posterior or a covariance.

    Parameters
    ----------
    fit : Fit, RunFit or ElasticRobot
        The fit of a robot, or a robot whose file has standard deviations.
    path : str or Path
        Name of the files, to which ``-1``, ``-2`` ... is added before the ending.
    format : str
        As in `robotmodels.export`.
    count : int
        Number of robots.
    rng : Generator
        Source of the draws.
    covariance : ndarray, (p, p), optional
        Of ln theta, about the fit; by default `recommended_uncertainty`.
    draws : ndarray, (N, p), optional
        Of ln theta, as `Posterior.draws` has; `count` of them are taken without replacement.
    position : ndarray, optional
        As in `robotmodels.export`.
    models : bool
        Whether to write a model for each draw.
    table : bool
        Whether to write ``-draws.csv``: the draws' parameters, jointly, a row each, in the order of
        the models.

    Returns
    -------
    tuple of Path
        The files, the table last.

    Raises
    ------
    InvalidInput
        If both `covariance` and `draws` are given, they do not fit the parameters, or
        `robotmodels.export` refuses a robot.
    """
    check_kind(fit, (FittedModel, ElasticRobot), "export_draws: fit")
    check_count(count, "count")
    robot = fit if isinstance(fit, ElasticRobot) else fit.robot()
    drawn = _draws(fit, covariance, draws, count, rng)
    path, width = Path(path), len(str(count))
    files = [path.with_stem(f"{path.stem}-{i + 1:0{width}}") for i in range(count * models)]
    for file, ln_theta in zip(files, drawn, strict=models):
        export(with_values(robot, np.exp(ln_theta)), file, format, position)
    if table:
        files.append(path.with_name(f"{path.stem}-draws.csv"))
        write_text(files[-1], _table(robot.parameters, np.exp(drawn)))
    return tuple(files)


def _draws(
    fit: FittedModel | ElasticRobot,
    covariance: Array | None,
    draws: Array | None,
    count: int,
    rng: np.random.Generator,
) -> Array:
    """Return draws of ln theta, (count, p)."""
    names = fit.parameters.names
    p = len(names)
    if covariance is not None and draws is not None:
        raise InvalidInput("export_draws: one of covariance and draws is needed, not both")
    if draws is not None:
        drawn = _checked(draws, "draws", (*np.shape(draws)[:1], p))
        if len(drawn) < count:
            raise InvalidInput(f"count: {count}; there are {len(drawn)} draws")
        return np.asarray(rng.choice(drawn, count, replace=False))
    if covariance is None:
        matrix = recommended_uncertainty(fit).covariance
    else:
        matrix = _checked(covariance, "covariance", (p, p))
        Uncertainty(names, matrix, "given")  # refuses what is no covariance
    return parameter_draws(fit.parameters.values, matrix, count, rng)


def _table(parameters: Parameters, values: Array) -> str:
    """Return values (N, p) [SI] as CSV, one name and unit a column."""
    lines = io.StringIO()
    writer = csv.writer(lines, lineterminator="\n")
    units = zip(parameters.names, parameters.units, strict=True)
    writer.writerow(["draw", *(f"{name} [{unit}]" for name, unit in units)])
    writer.writerows([i + 1, *(f"{x:.12g}" for x in row)] for i, row in enumerate(values))
    return lines.getvalue()


def parameter_draws(
    values: Array, covariance: Array, count: int, rng: np.random.Generator
) -> Array:
    """Return draws of ln theta, (count, p), about values (p,) [SI]."""
    return np.asarray(rng.multivariate_normal(np.log(values), covariance, count))


def fit_draws(
    fit: FittedModel | ElasticRobot, posterior: Array | None, count: int, rng: np.random.Generator
) -> Array:
    """Return draws of ln theta, (count, p): of a posterior (N, p), all if it is shorter.

    Without a posterior, of `recommended_uncertainty`.
    """
    if posterior is not None:
        return np.asarray(rng.choice(posterior, min(count, len(posterior)), replace=False))
    covariance = recommended_uncertainty(fit).covariance
    return parameter_draws(np.asarray(fit.parameters.values), covariance, count, rng)


def spread_words(fit: FittedModel | ElasticRobot, posterior: Array | None) -> str:
    """Return what draws and bands rest on: a posterior or a covariance."""
    if posterior is not None:
        return "draws of the study's posterior"
    return f"covariance, {recommended_uncertainty(fit).method}"


def _checked(values: Array, name: str, shape: tuple[int, int]) -> Array:
    array = real_numbers(values, name)
    if array.shape != shape or not np.isfinite(array).all():
        raise InvalidInput(f"{name}: shape {array.shape}; finite numbers of shape {shape} needed")
    return array
