"""Files of named arrays: MATLAB (structs nested, channels first or last), HDF5 and NumPy."""

from collections.abc import Callable, Iterator, Mapping
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
_VERSION_7_3 = b"MATLAB 7.3"
_TIME_NAMES = ("t", "time", "stamp", "timestamp")


@dataclass(frozen=True, eq=False)
class LazyArray:
    """An array in a file: its shape, and how to read a part of it."""

    shape: tuple[int, ...]
    part: Callable[[tuple[slice, ...]], NDArray[Any]]
    unit: str = ""


def read_matlab_log(path: Path, stack: ExitStack) -> Log:
    """Read the arrays of a .mat file, version 4 to 7.3."""
    with path.open("rb") as file:
        new = file.read(len(_VERSION_7_3)) == _VERSION_7_3
    if new:
        return read_hdf5_log(path, stack)
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    with library_errors(path, "a MATLAB file", MatReadError):
        variables = loadmat(path, appendmat=False, struct_as_record=False)
        arrays = dict(_matlab_arrays({n: v for n, v in variables.items() if n[:2] != "__"}, ""))
    return arrays_log(path, {name: _lazy(values) for name, values in arrays.items()})


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
    return arrays_log(path, {name: _lazy(values) for name, values in named.items()})


def _plain_arrays(loaded: Any) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the arrays of an archive; those of Python objects, which could run code, apart."""
    for name in loaded.files:
        try:
            yield name, loaded[name]
        except ValueError as error:
            if "allow_pickle" not in str(error):
                raise


def read_hdf5_log(path: Path, stack: ExitStack) -> Log:
    """Read the datasets of an HDF5 file, groups nested, part by part."""
    import h5py

    with library_errors(path, "an HDF5 file"):
        file = stack.enter_context(h5py.File(path, "r"))
        arrays = dict(_hdf5_arrays(file, "", str(path)))
    return arrays_log(path, arrays)


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
        name.rpartition(".")[0]
        for name, array in arrays.items()
        if name.rpartition(".")[2].lower() in _TIME_NAMES and max(array.shape, default=0) > 1
    }
    for name, array in arrays.items():
        rows = max(array.shape, default=1)
        if rows < _LEAST_ROWS or np.prod(array.shape) > rows * _MOST_COLUMNS:
            with library_errors(f"{path}: {name}", "an array"):
                constants[name] = np.ravel(array.part((slice(None),) * len(array.shape)))
            continue
        group = name.rpartition(".")[0]
        key = (group if group in timed else "", rows)
        tables.setdefault(key, {}).update(_channels(name, array, f"{path}: {name}"))
    if not tables:
        raise InvalidInput(
            f"{path}: no arrays of {_LEAST_ROWS} or more numbers; signals are needed"
        )
    names = _table_names(list(tables))
    parts = [Table(names[key], key[1], channels) for key, channels in tables.items()]
    return Log((path,), tuple(parts), constants)


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


def _lazy(values: NDArray[Any]) -> LazyArray:
    return LazyArray(values.shape, lambda part: values[part])


def _matlab_arrays(value: Any, name: str) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield arrays of numbers of variables, structs, arrays of structs and cells."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _matlab_arrays(inner, f"{name}.{key}" if name else str(key))
    elif hasattr(value, "_fieldnames"):
        yield from _matlab_arrays({f: getattr(value, f) for f in value._fieldnames}, name)
    elif isinstance(value, np.ndarray) and value.dtype == object:
        for number, inner in enumerate(value.ravel()):
            yield from _matlab_arrays(inner, name if value.size == 1 else f"{name}({number})")
    elif isinstance(value, np.ndarray) and value.dtype.kind in "fiubc" and value.size:
        yield name, value


def _structured(arrays: Mapping[str, NDArray[Any]]) -> Iterator[tuple[str, NDArray[Any]]]:
    for name, values in arrays.items():
        if values.dtype.names:
            yield from _structured(
                {f"{name}.{field}": values[field] for field in values.dtype.names}
            )
        elif values.dtype.kind in "fiubc" and values.size:
            yield name, values


def _hdf5_arrays(group: Any, prefix: str, where: str) -> Iterator[tuple[str, LazyArray]]:
    import h5py

    for name in group:
        if name.startswith("#") or not isinstance(group.get(name, getlink=True), h5py.HardLink):
            continue  # MATLAB's references; links may lead out of the file
        member, label = group[name], f"{prefix}.{name}" if prefix else name
        if isinstance(member, h5py.Group):
            yield from _hdf5_arrays(member, label, where)
        elif isinstance(member, h5py.Dataset) and member.shape and not member.external:
            if member.is_virtual or not member.size:
                continue
            unit = member.attrs.get("units", member.attrs.get("unit", ""))
            if member.dtype.names == ("real", "imag"):
                yield label, LazyArray(member.shape, _complex_part(member), str(unit))
            elif member.dtype.names:
                for field in member.dtype.names:
                    if member.dtype[field].kind in "fiub":
                        read = _field_part(member, field)
                        yield f"{label}.{field}", LazyArray(member.shape, read, str(unit))
            elif member.dtype.kind in "fiubc":
                yield label, LazyArray(member.shape, member.__getitem__, str(unit))


def _field_part(member: Any, field: str) -> Callable[[tuple[slice, ...]], NDArray[Any]]:
    return lambda part: member[part][field]


def _complex_part(member: Any) -> Callable[[tuple[slice, ...]], NDArray[Any]]:
    return lambda part: member[part]["real"] + 1j * member[part]["imag"]
