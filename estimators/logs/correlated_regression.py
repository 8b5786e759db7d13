"""Linear regression whose residuals are correlated in time.

Covariances come from means over a tenth of a second, whose residuals are taken as autoregressive of
order one: correlations to the power of the distance. Covariances that add up sampled correlations,
and block bootstraps, claim half of the scatter where a record is worth ten samples.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import stats

from robotmodels.common.arrays import Array, BoolArray, IntArray

_LARGEST_CORRELATION = 0.98


@dataclass(frozen=True, eq=False)
class Series:
    """Samples of one record that a regression uses.

    Attributes
    ----------
    target : ndarray, (N,)
        What is to be explained.
    shared : ndarray, (N, s)
        Regressors whose coefficients all records share.
    per_record : ndarray, (N, o)
        Regressors with coefficients for each record.
    used : ndarray of bool, (N,)
        Which samples count.
    block : int
        Number of samples in a mean.
    """

    target: Array
    shared: Array
    per_record: Array
    used: BoolArray
    block: int


@dataclass(frozen=True, eq=False)
class Regression:
    """A least-squares fit of several series.

    Attributes
    ----------
    coefficients : ndarray, (p,)
        Shared ones, then those of each record.
    residuals : ndarray, (N,)
        Of the samples used, series after series.
    means, regressors : ndarray, (B,) and (B, p)
        Residuals and regressors, averaged over blocks.
    times : ndarray of int, (B,)
        Number of each block.
    series : ndarray of int, (B,)
        Series of each block.
    """

    coefficients: Array
    residuals: Array
    means: Array
    regressors: Array
    times: IntArray
    series: IntArray

    @property
    def rms(self) -> float:
        """Root of the mean square of the residuals."""
        return float(np.sqrt(np.mean(self.residuals**2)))

    @cached_property
    def correlation(self) -> float:
        """Correlation of neighbouring means, its bias corrected to first order.

        Of p regressors, the expected sample value is less by (p + (p + 2) correlation) / B.
        """
        neighbours = (np.diff(self.times) == 1) & (np.diff(self.series) == 0)
        products = (self.means[1:] * self.means[:-1])[neighbours]
        sampled = np.mean(products) / np.mean(self.means**2) if neighbours.any() else 0.0
        B, p = self.regressors.shape
        corrected = (sampled + p / B) / max(1 - (p + 2) / B, 0.1)
        return float(np.clip(corrected, 0.0, _LARGEST_CORRELATION))

    @cached_property
    def _correlations(self) -> Array:
        distance = np.abs(self.times[:, None] - self.times)
        same = self.series[:, None] == self.series
        return np.asarray(np.where(same, self.correlation**distance, 0.0))

    @property
    def effective_samples(self) -> float:
        """How many independent samples would make as good a mean."""
        return float(len(self.means) ** 2 / self._correlations.sum())

    @property
    def degrees_of_freedom(self) -> float:
        """Effective samples less the number of coefficients, at least one."""
        return max(self.effective_samples - len(self.coefficients), 1.0)

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the coefficients, (p, p); the variance allows for what the fit took."""
        X = self.regressors
        inverse = np.linalg.pinv(X.T @ X)
        spread = X.T @ self._correlations @ X
        expected = len(X) - np.trace(inverse @ spread)
        variance = self.means @ self.means / max(expected, 0.05 * len(X))
        return np.asarray(variance * inverse @ spread @ inverse)

    def std(self, index: int) -> float:
        """Return the standard deviation of a coefficient."""
        return float(np.sqrt(self.covariance[index, index]))

    def p_value(self, indices: Sequence[int]) -> float:
        """Probability of coefficients as large as these where the true ones are zero."""
        some = list(indices)
        part = self.covariance[np.ix_(some, some)]
        value = self.coefficients[some] @ np.linalg.pinv(part) @ self.coefficients[some]
        return float(stats.f.sf(value / len(some), len(some), self.degrees_of_freedom))


def regress(records: Sequence[Series]) -> Regression:
    """Fit the samples of all records by least squares."""
    width = records[0].per_record.shape[1]
    rows = []
    for i, record in enumerate(records):
        left = np.zeros((len(record.target), i * width))
        right = np.zeros((len(record.target), (len(records) - 1 - i) * width))
        rows.append(np.hstack([record.shared, left, record.per_record, right]))
    X = np.concatenate([x[r.used] for x, r in zip(rows, records, strict=True)])
    y = np.concatenate([r.target[r.used] for r in records])
    scale = np.sqrt(np.mean(X**2, axis=0))
    scale[scale == 0] = 1.0
    coefficients = np.linalg.lstsq(X / scale, y, rcond=None)[0] / scale
    means = [
        _block_means(np.c_[r.target - x @ coefficients, x], r)
        for x, r in zip(rows, records, strict=True)
    ]
    blocks = np.concatenate([values for values, _ in means])
    return Regression(
        coefficients=coefficients,
        residuals=y - X @ coefficients,
        means=blocks[:, 0],
        regressors=blocks[:, 1:],
        times=np.concatenate([times for _, times in means]),
        series=np.repeat(np.arange(len(records)), [len(times) for _, times in means]),
    )


def _block_means(columns: Array, record: Series) -> tuple[Array, IntArray]:
    """Return means over blocks, and their numbers; at least half of a block must be used."""
    numbers = np.arange(len(columns)) // record.block
    count = np.bincount(numbers, weights=record.used)
    sums = np.array([np.bincount(numbers, weights=c * record.used) for c in columns.T]).T
    full = count >= record.block / 2
    return sums[full] / count[full, None], np.flatnonzero(full)
