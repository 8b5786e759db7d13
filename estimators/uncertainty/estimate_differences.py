"""Differences between the estimates of two fits, which may share data."""

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from estimators.fitting.fitted_model import FittedModel
from estimators.frf.frf_estimate import FrfEstimate
from estimators.trust.linearised_fit import LinearisedFit, Lines
from robotmodels.common.arrays import Array, IntArray


@dataclass(frozen=True, eq=False)
class Differences:
    """Estimates of a second fit less those of a first one.

    Attributes
    ----------
    names : tuple of str
        The r parameters of both.
    values : ndarray, (r,)
        Differences of ln theta.
    std : ndarray, (r,)
        Their standard deviations, errors in shared data being the same in both.
    correlation : ndarray, (r,)
        Correlation of the two estimates.
    probabilities : ndarray, (r,)
        p-value of each difference, two-sided; not a number where the estimates cannot differ.
    """

    names: tuple[str, ...]
    values: Array
    std: Array
    correlation: Array
    probabilities: Array


def estimate_differences(first: FittedModel, second: FittedModel) -> Differences:
    """Return how the estimates of two fits differ, and how certainly.

    Standard deviations are the recommended ones. To first order ln theta errs by Re(A e) with the
    errors e of the data, so that two estimates are correlated as their rows A on common data are.
    Data are common in positions with the same measured FRFs at the same frequencies; fits to runs,
    and fits of which one has logarithmic residuals and the other not, count as independent.
    """
    names = tuple(name for name in first.parameters.names if name in second.parameters.names)
    fits = first, second
    columns = [[fit.parameters.names.index(name) for name in names] for fit in fits]
    logs, std, dof = (
        [values[index] for values, index in zip(several, columns, strict=True)]
        for several in (
            [np.log(fit.parameters.values) for fit in fits],
            [fit.trust.std for fit in fits],
            [fit.trust.scatter.degrees_of_freedom for fit in fits],
        )
    )
    correlation = _correlation(first, second, columns)
    variance = std[0] ** 2 + std[1] ** 2 - 2 * correlation * std[0] * std[1]
    difference, scatter = logs[1] - logs[0], np.sqrt(np.maximum(variance, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(scatter > 1e-6 * std[0], np.abs(difference) / scatter, np.nan)
    freedom = np.minimum(np.nan_to_num(dof[0], nan=np.inf), np.nan_to_num(dof[1], nan=np.inf))
    return Differences(names, difference, scatter, correlation, 2 * student.sf(ratio, freedom))


def _correlation(first: FittedModel, second: FittedModel, columns: list[list[int]]) -> Array:
    """Return the correlation of the two estimates of each parameter."""
    one, other = first.linearise(), second.linearise()
    pairs = _common_positions(first, second)
    alike = (one.real, one.logarithmic) == (other.real, other.logarithmic)
    if not (len(pairs) and alike):
        return np.zeros(len(columns[0]))
    return shared_correlation(one, other, pairs, columns)


def shared_correlation(
    one: LinearisedFit, other: LinearisedFit, pairs: IntArray, columns: list[list[int]]
) -> Array:
    """Return the correlation of the estimates of two fits with data in common.

    Parameters
    ----------
    one, other : LinearisedFit
        The fits, at the same frequencies.
    pairs : ndarray of int, (c, 2)
        Positions of either that hold the same data.
    columns : list of list of int
        Parameters of either to compare.
    """
    rows = one.rows[columns[0]], other.rows[columns[1]]
    total = [_variance(fit, row) for fit, row in zip((one, other), rows, strict=True)]
    common = [np.zeros((len(rows[0]), *one.rows.shape[1:]), dtype=rows[0].dtype) for _ in rows]
    for target, row, positions in zip(common, rows, pairs.T, strict=True):
        target[:, pairs[:, 0]] = row[:, positions]
    remaining = _variance(one, common[0] - common[1])
    covariance = (_variance(one, common[0]) + _variance(one, common[1]) - remaining) / 2
    return np.asarray(np.clip(covariance / np.sqrt(total[0] * total[1]), -1.0, 1.0))


def _variance(fit: LinearisedFit, rows: Lines) -> Array:
    return np.asarray(fit.line_variances(rows).sum(axis=(1, 2)))


def _common_positions(first: FittedModel, second: FittedModel) -> IntArray:
    """Return pairs (c, 2) of positions in which two fits have the same FRFs."""
    one, other = first.problem.data, second.problem.data
    pairs: list[tuple[int, int]] = []
    if isinstance(one, FrfEstimate) and isinstance(other, FrfEstimate):
        pairs = [
            (i, j)
            for i, response in enumerate(one.response)
            for j, same in enumerate(other.response)
            if np.array_equal(one.omega, other.omega) and np.array_equal(response, same)
        ]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)
