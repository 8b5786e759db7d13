"""Named arrays as tables of channels, first or last; files of NumPy."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from robotmodels.common.errors import InvalidInput
from robotmodels.data_files.file_guard import library_errors
from robotmodels.logs.log import Channel, Log, Table, as_real

_LEAST_ROWS = 8
"""Rows from which an array is a signal and not a constant."""
_MOST_COLUMNS = 4096
_TIME_NAMES = ("t", "time", "stamp", "timestamp")


@dataclass(frozen=True, eq=False)
class LazyArray:
    """An array in a file: its shape, and how to read a part of it."""

    shape: tuple[int, ...]
    part: Callable[[tuple[slice, ...]], NDArray[Any]]
    unit: str = ""


def read_numpy_log(path: Path, stack: ExitStack) -> Log:
    """Read the arrays of an .npz or .npy file."""
    with library_errors(path, "a file of NumPy arrays", BadZipFile):
        loaded = np.load(path, allow_pickle=False)
        if isinstance(loaded, np.ndarray):
            arrays = {"data": loaded}
        else:
            with loaded:
                arrays = dict(_plain_arrays(loaded))
    named = dict(_structured(arrays))
    return arrays_log(path, {name: lazy_array(values) for name, values in named.items()})


def _plain_arrays(loaded: Any) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the arrays of an archive; those of Python objects, which could run code, apart."""
    for name in loaded.files:
        try:
            yield name, loaded[name]
        except ValueError as error:
            if "allow_pickle" not in str(error):
                raise


def arrays_log(path: Path, arrays: Mapping[str, LazyArray]) -> Log:
    """Return arrays as tables: those of one length that lie beside one time belong together.

    Raises
    ------
    InvalidInput
        If no array is long enough to be a signal.
    """
    tables: dict[tuple[str, int], dict[str, Channel]] = {}
    constants: dict[str, NDArray[Any]] = {}
    timed = {
        (name.rpartition(".")[0], max(array.shape))
        for name, array in arrays.items()
        if name.rpartition(".")[2].lower() in _TIME_NAMES and max(array.shape, default=0) > 1
    }
    for name, array in arrays.items():
        rows = max(array.shape, default=1)
        if rows < _LEAST_ROWS or np.prod(array.shape) > rows * _MOST_COLUMNS:
            with library_errors(f"{path}: {name}", "an array"):
                constants[name] = np.ravel(array.part((slice(None),) * len(array.shape)))
            continue
        key = _timed_group(name, [group for group, length in timed if length == rows]), rows
        tables.setdefault(key, {}).update(_channels(name, array, f"{path}: {name}"))
    if not tables:
        raise InvalidInput(
            f"{path}: no arrays of {_LEAST_ROWS} or more numbers; signals are needed"
        )
    names = _table_names(list(tables))
    parts = [Table(names[key], key[1], channels) for key, channels in tables.items()]
    return Log((path,), tuple(parts), constants)


def _timed_group(name: str, groups: Sequence[str]) -> str:
    """Return the group whose time is nearest to an array, empty where two are as near."""
    path = name.split(".")[:-1]

    def common(group: str) -> int:
        same = [a == b for a, b in zip(path, group.split("."), strict=False)]
        return (*same, False).index(False)

    nearest = max((common(group) for group in groups), default=0)
    near = [group for group in groups if common(group) == nearest]
    return near[0] if len(near) == 1 else ""


def _table_names(keys: list[tuple[str, int]]) -> dict[tuple[str, int], str]:
    if len(keys) == 1:
        return {keys[0]: ""}
    groups = [group for group, _ in keys]
    return {
        (group, rows): group if group and groups.count(group) == 1 else f"{group}_{rows}".strip("_")
        for group, rows in keys
    }


def _channels(name: str, array: LazyArray, where: str) -> Iterator[tuple[str, Channel]]:
    """Yield the rows or columns of an array as channels, along its longest axis."""
    axis = int(np.argmax(array.shape))
    others = array.shape[:axis] + array.shape[axis + 1 :]
    long = [length for length in others if length != 1]
    for index in np.ndindex(*others):
        numbers = [str(i) for i, length in zip(index, others, strict=True) if length != 1]
        label = f"{name}[{','.join(numbers)}]" if long else name
        yield label, Channel(_reader(array, axis, index, where), array.unit)


def _reader(
    array: LazyArray, axis: int, index: tuple[int, ...], where: str
) -> Callable[[int, int], NDArray[Any]]:
    def read(start: int, stop: int) -> NDArray[Any]:
        parts = [slice(i, i + 1) for i in index]
        parts.insert(axis, slice(start, stop))
        with library_errors(where, "an array"):
            return as_real(np.ravel(array.part(tuple(parts))))

    return read


def lazy_array(values: NDArray[Any]) -> LazyArray:
    """Return an array in memory as one of a file."""
    return LazyArray(values.shape, lambda part: values[part])


def _structured(arrays: Mapping[str, NDArray[Any]]) -> Iterator[tuple[str, NDArray[Any]]]:
    for name, values in arrays.items():
        if values.dtype.names:
            yield from _structured(
                {f"{name}.{field}": values[field] for field in values.dtype.names}
            )
        elif values.dtype.kind in "fiubc" and values.size:
            yield name, values
