"""Score tests along single directions in which a model may be wrong."""

from collections.abc import Iterator
from dataclasses import Field, dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.trust.line_correlation import LineCorrelation
from estimators.trust.line_scatter import cautious_scatter
from estimators.trust.linearised_fit import LinearisedFit, Lines
from robotmodels.common.arrays import Array, IntArray

DETECTION = 5.3
"""Standard deviations that an error needs to be seen with 95 %: at a level of 1 % over 38 tests."""

_VISIBLE = 1e-6
"""Share of a direction off the parameters below which it is theirs but for rounding."""

_TOGETHER = 2**21
"""Numbers in the columns that are tested in one go."""


@dataclass(frozen=True, eq=False)
class Directions:
    """Ways in which the model may be wrong.

    Attributes
    ----------
    names, units : tuple of str
        Of all directions: those of `columns`, then those of the parameters in one position or in
        the lower half of the lines.
    columns : Lines, (Q, F, k, r)
        Change of the modelled values with a coefficient of one.
    jacobian : Lines, (Q, F, k, p)
        Change with ln theta, of which single positions and half of the lines are directions.
    visits : tuple of ndarray of int
        Rows of each position that is tested alone: its visits.
    half : int
        How many lines are the lower half.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    columns: Lines
    jacobian: Lines
    visits: tuple[IntArray, ...] = ()
    half: int = 0

    @cached_property
    def _joined(self) -> list[Lines]:
        """The columns of all directions in one array, where they are few."""
        lines = int(np.prod(self.columns.shape[:-1]))
        if not self.names or lines * len(self.names) > _TOGETHER:
            return []
        return [np.concatenate(list(self._parts()), axis=-1)]

    def batches(self) -> Iterator[Lines]:
        """Yield the columns (Q, F, k, .) of all directions, some at a time."""
        yield from self._joined or self._parts()

    def _parts(self) -> Iterator[Lines]:
        lines, p = int(np.prod(self.columns.shape[:-1])), self.jacobian.shape[-1]
        step = max(1, _TOGETHER // max(lines, 1))
        for first in range(0, self.columns.shape[-1], step):
            yield self.columns[..., first : first + step]
        for rows in self.visits:
            for first in range(0, p, step):
                part = np.zeros_like(self.jacobian[..., first : first + step])
                part[rows] = self.jacobian[rows, ..., first : first + step]
                yield part
        for first in range(0, p if self.half else 0, step):
            part = self.jacobian[..., first : first + step].copy()
            part[:, self.half :] = 0
            yield part

    def column(self, index: int) -> Lines:
        """Return the column (Q, F, k, 1) of one direction."""
        for batch in self.batches():
            if index < batch.shape[-1]:
                return batch[..., index : index + 1]
            index -= batch.shape[-1]
        raise IndexError(index)


@dataclass(frozen=True, eq=False)
class DirectedTests:
    """Estimates along directions, each as one more parameter.

    Attributes
    ----------
    names, units : tuple of str
        As in `Directions`, but for those that the parameters imitate.
    index : ndarray of int, (r,)
        Their index in `Directions`.
    estimates, std : ndarray, (r,)
        Coefficients by one step, and their standard deviations.
    probabilities : ndarray, (r,)
        Two-sided, of estimates as large if the model is right; not corrected for their number.
    moved : ndarray of int, (r,)
        The parameter that an error at the limit of detection moves most.
    shift : ndarray, (r,)
        Number of its standard deviations.
    degrees_of_freedom : ndarray, (r,)
        Degrees of freedom of the standard deviations.
    shifts : ndarray, (r, p)
        How far coefficients of one, left out of the model, move ln theta.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    index: IntArray
    estimates: Array
    std: Array
    probabilities: Array
    moved: IntArray
    shift: Array
    degrees_of_freedom: Array
    shifts: Array

    def significant(self, level: float = 0.01) -> NDArray[np.intp]:
        """Return the directions whose test fires at `level` over all (Bonferroni), strongest first.

        A probability that is not a number fires.
        """
        order = np.argsort(self.probabilities, kind="stable")
        limit = level / max(len(self.names), 1)
        return np.asarray(order[~(self.probabilities[order] >= limit)])


def directed_tests(
    fit: LinearisedFit,
    directions: Directions,
    correlation: LineCorrelation,
    std: Array,
    expected: float | None = None,
) -> DirectedTests:
    """Return one-degree score tests along `directions`.

    Each direction is projected off the parameters and treated as one more of them, by the same
    scatter and t law.

    Parameters
    ----------
    std : ndarray, (p,)
        Standard deviations of ln theta.
    expected : float, optional
        Expected sum of squared residuals, where they are larger: variances are then scaled by what
        remains of the sum beside a direction, as those of the parameters are.
    """
    if not directions.names:
        return _no_tests(len(std))
    parts, offset = [], 0
    for columns in directions.batches():
        parts.append(_tested(fit, columns, offset, correlation, std, expected))
        offset += columns.shape[-1]
    joined = {
        f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in _columns_of()
    }
    index = joined["index"]
    return DirectedTests(
        tuple(directions.names[i] for i in index),
        tuple(directions.units[i] for i in index),
        **joined,
    )


def _no_tests(parameters: int) -> DirectedTests:
    """Return the tests along no direction."""
    whole = ("index", "moved")
    empty = {f.name: np.empty(0, int if f.name in whole else float) for f in _columns_of()}
    return DirectedTests((), (), **(empty | {"shifts": np.empty((0, parameters))}))


def _columns_of() -> tuple[Field[Any], ...]:
    """Return the fields of `DirectedTests` that are arrays over directions."""
    return fields(DirectedTests)[2:]


@dataclass(frozen=True, eq=False)
class OneStep:
    """Coefficients of columns by one linear step, each column beside the parameters.

    Attributes
    ----------
    seen : ndarray of bool, (all columns,)
        Columns that the parameters do not imitate: the r of which all else is.
    off : Lines, (Q, F, k, r)
        Columns less what the parameters imitate of them.
    rows : Lines, (r, Q, F, k)
        Rows of their estimators.
    estimates : ndarray, (r,)
        Coefficients.
    powers : ndarray, (r,)
        Weighted squares of `off`: the cost falls by a coefficient's square times its power.
    """

    seen: NDArray[np.bool_]
    off: Lines
    rows: Lines
    estimates: Array
    powers: Array


def one_step(fit: LinearisedFit, columns: Lines) -> OneStep:
    """Return the coefficients of columns (Q, F, k, r), each as one more parameter."""
    off = fit.off_parameters(columns)
    weighted = fit.weighted(off)
    size = (np.conj(off) * weighted).real.sum(axis=(0, 1, 2))
    whole = (np.conj(columns) * fit.weighted(columns)).real.sum(axis=(0, 1, 2))
    seen = (size > _VISIBLE**2 * whole) & (whole > 0)
    rows = np.moveaxis(np.conj(weighted[..., seen]) / size[seen], -1, 0)
    return OneStep(seen, off[..., seen], rows, fit.estimates(rows, fit.residuals), size[seen])


def _tested(
    fit: LinearisedFit,
    columns: Lines,
    offset: int,
    correlation: LineCorrelation,
    std: Array,
    expected: float | None,
) -> DirectedTests:
    step = one_step(fit, columns)
    seen, rows, estimates = step.seen, step.rows, step.estimates
    if not seen.any():
        return _no_tests(len(std))
    scatter = cautious_scatter(fit, rows, correlation)
    if expected is not None:
        remaining = fit.squares_beside(step.off, estimates)
        scatter = scatter.scaled(np.maximum(remaining / expected, 1.0))
    deviation = np.sqrt(scatter.variance)
    shifts = fit.shifts(columns[..., seen]).T
    with np.errstate(divide="ignore", invalid="ignore"):
        shift = np.abs(shifts) * DETECTION * deviation[:, None] / std
    shift = np.nan_to_num(shift, nan=0.0)
    return DirectedTests(
        (),
        (),
        offset + np.flatnonzero(seen),
        estimates,
        deviation,
        scatter.probability(estimates),
        shift.argmax(axis=1),
        shift.max(axis=1, initial=0.0),
        scatter.degrees_of_freedom,
        shifts,
    )
