"""Types of arrays, and checks of numbers that people give."""

import os
from collections.abc import Iterable, Sequence
from math import isfinite, prod
from numbers import Real
from typing import Any, TypeGuard, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robotmodels.common.errors import InvalidInput

# NDArray of numpy 2.5 is an alias whose origin is no class, which files of dataclasses ask for.
Array = np.ndarray[tuple[Any, ...], np.dtype[np.float64]]
ComplexArray = np.ndarray[tuple[Any, ...], np.dtype[np.complex128]]
IntArray = np.ndarray[tuple[Any, ...], np.dtype[np.int64]]
BoolArray = np.ndarray[tuple[Any, ...], np.dtype[np.bool_]]

_T = TypeVar("_T", bound=np.generic)
_NUMBERS = "biuf"  # kinds of numpy
_LARGEST_WHOLE = 2**53  # beyond it floats leave out whole numbers


def read_only(array: NDArray[_T]) -> NDArray[_T]:
    """Return a view of `array` that cannot be written to."""
    view = array.view()
    view.flags.writeable = False
    return view


def cartesian_grid(axes: Sequence[ArrayLike]) -> Array:
    """Return all combinations of the values on n axes, (Q, n); the last axis runs fastest."""
    # Column by column: numpy's arrays have at most 64 axes, broadcast ones 32.
    values = [np.asarray(axis, dtype=float) for axis in axes]
    step = np.arange(prod(map(len, values)))
    columns = []
    for axis in reversed(values):
        step, index = np.divmod(step, len(axis))
        columns.append(axis[index])
    return np.stack(columns[::-1], axis=1)


def real_numbers(values: ArrayLike, what: str, *, copy: bool = True) -> Array:
    """Return `values` as a float array, a copy unless `copy` is false.

    Raises
    ------
    InvalidInput
        If they are not real numbers, or rows differ in length; it starts with `what`.
    """
    try:
        array = np.asarray(values)
        # Text, times and objects such as None would turn into numbers too; what is empty has no
        # type that tells.
        if array.dtype.kind in _NUMBERS or not array.size:
            return array.astype(float, copy=copy)
    except (TypeError, ValueError, OverflowError):
        pass
    raise InvalidInput(f"{what}: an array of real numbers is needed, found {str(values)[:60]}")


def complex_numbers(values: ArrayLike, what: str) -> ComplexArray:
    """Return `values` as an array of complex numbers of its own.

    Raises
    ------
    InvalidInput
        If they are no numbers, or rows differ in length; it starts with `what`.
    """
    try:
        array = np.asarray(values)
    except ValueError:
        array = np.empty(1, dtype=object)
    if array.dtype.kind == "c":
        return array.astype(complex)
    return real_numbers(values, what).astype(complex)


def chosen_positions(indices: ArrayLike, count: int) -> IntArray:
    """Return which of `count` positions are meant, (k,), as an array; at least one.

    Raises
    ------
    InvalidInput
        If they are not whole numbers from 0 to count - 1.
    """
    rows = whole_numbers(indices, "subset: positions")
    if rows.ndim != 1 or not rows.size or rows.min() < 0 or rows.max() >= count:
        raise InvalidInput(
            f"subset: {rows.tolist()} does not choose from positions 0 to {count - 1}"
        )
    return rows


def check_kind(value: object, kinds: type | tuple[type, ...], what: str) -> None:
    """Refuse an argument of another kind.

    Raises
    ------
    InvalidInput
        Starting with `what`, naming the kinds that are needed.
    """
    if not isinstance(value, kinds):
        names = [k.__name__ for k in (kinds if isinstance(kinds, tuple) else (kinds,))]
        raise InvalidInput(f"{what}: {type(value).__name__} given; {' or '.join(names)} is needed")


def whole_numbers(values: ArrayLike, what: str) -> IntArray:
    """Return `values` as an array of integers; floats such as 5.0 are taken, 5.9 is not.

    Raises
    ------
    InvalidInput
        If one is no whole number, or none that a float or int64 holds exactly; it starts with
        `what`.
    """
    array = np.asarray(values)
    if not array.size or array.dtype.kind == "i":
        return array.astype(np.int64)
    reals = real_numbers(values, what)
    wrong = ~(np.abs(reals) <= _LARGEST_WHOLE) | (reals != np.rint(reals))
    if wrong.any():
        index = tuple(int(i) for i in np.argwhere(wrong)[0])
        location = f" at {', '.join(map(str, index))} (counted from 0)" if index else ""
        raise InvalidInput(f"{what}: {reals[index]:.17g}{location}; whole numbers are needed")
    return reals.astype(np.int64)


def one_or_each(values: ArrayLike, count: int, what: str, of: str = "motors") -> Array:
    """Return one number for each of `count` things, (count,), where there is one for all or each.

    Raises
    ------
    InvalidInput
        If there are as many as neither, or one is no real number; it starts with `what`.
    """
    array = real_numbers(values, what)
    if array.shape not in ((), (count,)):
        raise InvalidInput(
            f"{what}: shape {array.shape}; one number, or one for each of {count} {of}, is needed"
        )
    return np.array(np.broadcast_to(array, (count,)))


def check_ranges(
    positions: Array, limits: Array, what: str, names: Sequence[str], slack: float
) -> None:
    """Refuse the first of `positions` (Q, n) outside `limits` (n, 2).

    Raises
    ------
    InvalidInput
        Naming the position, after `what`, and the coordinate by its name.
    """
    low, high = limits.T
    outside = np.argwhere(~((positions >= low - slack) & (positions <= high + slack)))
    if len(outside):
        i, j = outside[0]
        raise InvalidInput(
            f"{what} {i}: {names[j]} at {positions[i, j]:.4g} is outside its limits "
            f"[{low[j]:.4g}, {high[j]:.4g}]"
        )


def is_count(value: object, least: int = 1) -> TypeGuard[int]:
    """Tell whether a number of things is whole, and at least `least`; True is no number."""
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    return whole and bool(value >= least)  # type: ignore[operator]


def check_count(value: object, what: str, least: int = 1) -> int:
    """Return a number of things, which must be whole and at least `least`.

    Raises
    ------
    InvalidInput
        Starting with `what`.
    """
    if not is_count(value, least):
        raise InvalidInput(f"{what}: {value!r}; a whole number >= {least} is needed")
    return int(value)


def check_above_zero(value: object, what: str, *, zero: bool = False) -> None:
    """Refuse what is not a finite number above zero, or, with `zero`, from zero on.

    Raises
    ------
    InvalidInput
        Starting with `what`.
    """
    finite = isinstance(value, Real) and isfinite(value)
    if not (finite and (value > 0 or (zero and value == 0))):  # type: ignore[operator]
        shown = f"{value:g}" if isinstance(value, np.floating) else repr(value)
        raise InvalidInput(f"{what}: {shown} is not a number {'>=' if zero else '>'} 0")


def truth_values(values: ArrayLike, what: str) -> BoolArray:
    """Return `values`, true and false or 1 and 0, as an array of truth values.

    Raises
    ------
    InvalidInput
        If one is neither; it starts with `what`.
    """
    array = np.asarray(values)
    if array.dtype.kind == "b":
        return array
    reals = real_numbers(values, what)
    wrong = (reals != 0) & (reals != 1)
    if wrong.any():
        raise InvalidInput(f"{what}: {reals[wrong][0]:g}; true and false, or 1 and 0, are needed")
    return reals.astype(bool)


def check_memory(needed: float, what: str) -> None:
    """Refuse what needs more than this machine has.

    Parameters
    ----------
    needed : float, bytes
        Estimate.
    what : str
        Whose memory it is, and the keys it grows with.

    Raises
    ------
    InvalidInput
        Naming `what`, the estimate and the memory there is.
    """
    try:
        there = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):  # not on Windows
        return
    if needed > there:
        raise InvalidInput(
            f"{what}: {needed / 1e9:.3g} GB are needed, this machine has {there / 1e9:.3g} GB"
        )


IMPROBABLE = 1e-3
"""Chance explains costs, residuals or misses with less than this probability no more."""


def check_level(level: float, where: str) -> None:
    """Refuse a level that is no probability.

    Raises
    ------
    InvalidInput
        Naming `where` it was given.
    """
    if not 0 < level < 1:
        raise InvalidInput(f"{where}: level {level} does not lie between 0 and 1")


def equal_rows(columns: Iterable[Array], tolerance: float) -> IntArray:
    """Return a group number for each row of columns (Q,): rows within the tolerance share one.

    In each column values are one where the next larger is not farther than the tolerance: unlike
    rounding, this tears no equals apart at the edge of a multiple.
    """
    group = np.zeros(1, dtype=np.int64)
    for column in columns:
        order = np.argsort(column)
        value = np.empty(len(column), dtype=np.int64)
        value[order] = np.cumsum(np.diff(column[order], prepend=column[order[:1]]) > tolerance)
        group = _renumbered(group * (value.max(initial=0) + 1) + value)
    return group


def distinct_rows(
    columns: Sequence[NDArray[np.integer]], count: int
) -> tuple[IntArray, IntArray] | None:
    """Return an index of each distinct row of columns (count,), and which of them each row is.

    None where more than half as many rows are distinct. Values are whole numbers from 0.
    """
    group = np.zeros(count, dtype=np.int64)
    for column in columns:
        group = _renumbered(group * (int(column.max(initial=0)) + 1) + column)
        if group.max() >= count // 2:
            return None
    index = np.empty(group.max() + 1, dtype=np.int64)
    index[group] = np.arange(count)  # of several the last one stays
    return index, group


def _renumbered(numbers: IntArray) -> IntArray:
    """Return whole numbers from 0 without gaps, in the same order."""
    largest = int(numbers.max(initial=0))
    if largest >= 4 * len(numbers):  # too large for a table
        return np.unique(numbers, return_inverse=True)[1]
    used = np.zeros(largest + 1, dtype=bool)
    used[numbers] = True
    return (np.cumsum(used) - 1)[numbers]
