"""Schemas of files of arrays: names, types, axes and ranges, from which errors are made."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from robotmodels.common.arrays import check_memory, truth_values, whole_numbers
from robotmodels.common.errors import InvalidInput, nearest
from robotmodels.data_files.file_guard import listed

Kind = Literal["real", "whole", "complex", "truth", "text"]

# What a container may have stored where a schema asks for a kind: MATLAB has doubles throughout.
_SUITABLE: dict[Kind, tuple[str, ...]] = {
    "real": ("numbers",),
    "whole": ("numbers",),
    "complex": ("numbers", "complex numbers"),
    "truth": ("numbers", "truth values"),
    "text": ("text",),
}
_WORDS: dict[Kind, str] = {
    "real": "real numbers",
    "whole": "whole numbers",
    "complex": "complex numbers",
    "truth": "truth values, or 0 and 1,",
    "text": "text",
}


@dataclass(frozen=True)
class StoredArray:
    """An array in a file, described before it is read.

    Attributes
    ----------
    content : str
        "numbers", "complex numbers", "truth values", "text", or in words what else it is.
    shape : tuple of int
        Shape in the file.
    read : callable
        Returns it, under the guard of its container.
    capacity : int or None
        The most elements of it that the file can hold; None where the file does not tell.
    loose : bool
        Whether the container drops trailing axes of length one and has no vectors, as MATLAB's.
    """

    content: str
    shape: tuple[int, ...]
    read: Callable[[], Any]
    capacity: int | None = None
    loose: bool = False


def stored_array(values: NDArray[Any]) -> StoredArray:
    """Return numbers that are in memory as a stored array."""
    return StoredArray("numbers", values.shape, lambda: values)


@dataclass(frozen=True)
class Field:
    """One array, or one value where there are no axes.

    Attributes
    ----------
    axes : tuple of str
        Names of the axes; axes of one name have one length throughout a file. An empty name stands
        for any length, and ``"x or 1"`` for the length of x or one.
    kind : Kind
        Kind of its elements.
    least, most : float
        Of the values.
    finite : bool
        Whether NaN and infinities are refused.
    optional : bool
        Whether it may be missing.
    attribute : bool
        Whether HDF5 keeps it as an attribute instead of a dataset.
    """

    axes: tuple[str, ...] = ()
    kind: Kind = "real"
    least: float = -math.inf
    most: float = math.inf
    finite: bool = True
    optional: bool = False
    attribute: bool = False

    def fitted_shape(self, stored: StoredArray) -> tuple[int, ...] | None:
        """Return the shape by the axes, None where it does not fit."""
        shape, count = stored.shape, len(self.axes)
        if stored.loose and self.kind == "text":
            return ()
        if stored.loose and count < 2:
            long = [length for length in shape if length != 1]
            flat = (math.prod(shape),)
            if count == 1:
                return flat if len(long) < 2 or 0 in shape else None
            return None if long else ()
        if stored.loose:
            shape = shape + (1,) * (count - len(shape))
        return shape if len(shape) == count else None

    def values(self, array: Any, shape: tuple[int, ...], where: str) -> Any:
        """Return what was read in the schema's type and shape.

        Raises
        ------
        InvalidInput
            Naming the first value that is of another type or out of range.
        """
        if self.kind == "text":
            return array
        stored = np.asarray(array)
        if self.kind != "complex" and np.iscomplexobj(stored):
            raise InvalidInput(f"{where}: complex numbers; {_WORDS[self.kind]} are needed")
        stored = stored.reshape(shape)
        if self.kind == "whole":
            values: NDArray[Any] = whole_numbers(stored, where)
        elif self.kind == "truth":
            values = truth_values(stored, where)
        else:
            with np.errstate(over="ignore"):  # long doubles; infinities are told below
                kind = complex if np.iscomplexobj(stored) else float
                values = stored.astype(kind, copy=False)
        if self.finite:
            self._refuse(~np.isfinite(values), values, where, "a finite number")
        if self.kind in ("real", "whole"):
            self._refuse(values < self.least, values, where, f"a number >= {self.least:g}")
            self._refuse(values > self.most, values, where, f"a number <= {self.most:g}")
        return values if self.axes else values[()].item()

    def _refuse(self, wrong: Any, values: Any, where: str, right: str) -> None:
        if np.any(wrong):
            index = tuple(int(i) for i in np.argwhere(wrong)[0])
            location = f" at {listed_index(self.axes, index)}" if index else ""
            raise InvalidInput(f"{where}: {values[index]}{location}; {right} is needed")


def listed_index(axes: tuple[str, ...], index: tuple[int, ...]) -> str:
    """Return ``position 0, motor 2 (counted from 0)``."""
    named = zip(axes, index, strict=True)
    return ", ".join(f"{axis or 'index'} {i}" for axis, i in named) + " (counted from 0)"


@dataclass(frozen=True)
class ArraySchema:
    """What a file, or a group in it, holds.

    Attributes
    ----------
    fields : mapping of str to Field
        Fields by name.
    """

    fields: Mapping[str, Field]

    def read(self, stored: Mapping[str, StoredArray], where: str) -> dict[str, Any]:
        """Return arrays and values by name, all of them checked before the first is read.

        Parameters
        ----------
        stored : mapping of str to StoredArray
            What the file holds.
        where : str
            File, and the group or key in it.

        Raises
        ------
        InvalidInput
            Naming the file, the array, the value read and the value needed.
        """
        self._check_names(stored, where)
        shapes = self._shapes(stored, where)
        total = sum(
            math.prod(shape) * _ITEM[self.fields[name].kind] for name, shape in shapes.items()
        )
        check_memory(_COPIES * total, f"{where}: arrays")
        return {
            name: self.fields[name].values(stored[name].read(), shape, f"{where}: {name}")
            for name, shape in shapes.items()
        }

    def _check_names(self, stored: Mapping[str, StoredArray], where: str) -> None:
        missing = [n for n, field in self.fields.items() if not field.optional and n not in stored]
        unknown = [name for name in stored if name not in self.fields]
        if missing:
            verb = "is" if len(missing) == 1 else "are"
            there = f"(found: {listed(stored)})"
            raise InvalidInput(f"{where}: {listed(missing)} {verb} missing {there}")
        if unknown:
            verb = "is" if len(unknown) == 1 else "are"
            near = nearest(unknown[0], self.fields) if len(unknown) == 1 else ""
            raise InvalidInput(
                f"{where}: {listed(unknown)} {verb} unknown{near}; there may be "
                f"{', '.join(self.fields)}"
            )

    def _shapes(self, stored: Mapping[str, StoredArray], where: str) -> dict[str, tuple[int, ...]]:
        shapes: dict[str, tuple[int, ...]] = {}
        lengths: dict[str, tuple[int, str]] = {}
        for name, field in self.fields.items():
            if name not in stored:
                continue
            array = stored[name]
            if array.content not in _SUITABLE[field.kind]:
                raise InvalidInput(f"{where}: {name}: {array.content}; {_described(field)} needed")
            shape = field.fitted_shape(array)
            if shape is None:
                raise InvalidInput(
                    f"{where}: {name}: shape {array.shape}; {_described(field)} needed"
                )
            if array.capacity is not None and math.prod(shape) > array.capacity:
                raise InvalidInput(
                    f"{where}: {name}: shape {array.shape}, but the file holds at most "
                    f"{array.capacity} values of it; it is cut off, damaged or was never written"
                )
            for axis, length in zip(field.axes, shape, strict=True):
                axis, _, single = axis.partition(" or ")
                if not axis or (single and length == 1):
                    continue
                other, owner = lengths.setdefault(axis, (length, name))
                if length != other:
                    raise InvalidInput(
                        f"{where}: {name}: shape {array.shape}, of {length} for the axis "
                        f"{axis!r}; {owner} has {other}, {_described(field)} needed"
                    )
            shapes[name] = shape
        return shapes


_COPIES = 2  # checks take a second one
_ITEM: dict[Kind, int] = {"real": 8, "whole": 8, "complex": 16, "truth": 1, "text": 1}


def _described(field: Field) -> str:
    """Return ``real numbers (position, motor) are`` or ``one real number is``."""
    if field.axes:
        axes = ", ".join(axis or "any" for axis in field.axes) + "," * (len(field.axes) == 1)
        return f"{_WORDS[field.kind]} of shape ({axes}) are"
    one = {"text": "text", "truth": "true or false"}.get(field.kind)
    return f"{one or 'one ' + _WORDS[field.kind][:-1]} is"
