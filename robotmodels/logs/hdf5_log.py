"""HDF5: datasets of nested groups, read part by part, and what MATLAB's references lead to."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robotmodels.data_files.file_guard import library_errors
from robotmodels.logs.array_log import LazyArray, arrays_log, lazy_array
from robotmodels.logs.log import Log
from robotmodels.logs.struct_labels import LABELS, UNITS, first_label, first_text, labelled_arrays

_DEEPEST = 8  # of references to references


def read_hdf5_log(path: Path, stack: ExitStack) -> Log:
    """Read the datasets of an HDF5 file, groups nested, part by part."""
    import h5py

    with library_errors(path, "an HDF5 file"):
        file = stack.enter_context(h5py.File(path, "r"))
        arrays = dict(_hdf5_arrays(file, ""))
    return arrays_log(path, arrays)


def _hdf5_arrays(group: Any, prefix: str, depth: int = 0) -> Iterator[tuple[str, LazyArray]]:
    import h5py

    for name, value in group.attrs.items():
        if isinstance(value, np.ndarray | np.number) and value.dtype.kind in "fiu":
            yield f"{prefix}.{name}" if prefix else name, lazy_array(np.atleast_1d(value))
    for name in group:
        if name.startswith("#") or not isinstance(group.get(name, getlink=True), h5py.HardLink):
            continue  # MATLAB's references; links may lead out of the file
        member, label = group[name], f"{prefix}.{name}" if prefix else name
        if isinstance(member, h5py.Group):
            yield from _hdf5_arrays(member, label, depth)
        elif h5py.check_ref_dtype(member.dtype) is h5py.Reference and depth < _DEEPEST:
            yield from _referenced(group, member, prefix, name, depth)
        else:
            yield from _hdf5_dataset(member, label)


def _referenced(
    group: Any, member: Any, prefix: str, name: str, depth: int
) -> Iterator[tuple[str, LazyArray]]:
    """Yield what MATLAB's references lead to: elements of cells, and of arrays of structs."""
    import h5py

    cell = not prefix or member.attrs.get("MATLAB_class") == b"cell"
    path = f"{prefix}.{name}" if prefix else name
    for number, reference in enumerate(np.ravel(member[()])):
        if not reference:
            continue
        target, element = group.file[reference], f"{prefix}({number})"
        field = f"{path}({number})" if cell else f"{element}.{name}"
        if isinstance(target, h5py.Group):
            inner = _hdf5_arrays(target, field, depth + 1)
        elif h5py.check_ref_dtype(target.dtype) is None:
            inner = _hdf5_dataset(target, field)
        else:
            continue
        label = "" if cell else first_label(_text_of(group, each, number) for each in LABELS)
        unit = "" if cell else first_text(_text_of(group, each, number) for each in UNITS)
        yield from labelled_arrays(inner, element, prefix, label, unit)


def _text_of(group: Any, field: str, number: int) -> str:
    """Return a text that MATLAB refers to from a field of an array of structs."""
    import h5py

    if field not in group or h5py.check_ref_dtype(getattr(group[field], "dtype", None)) is None:
        return ""
    references = np.ravel(group[field][()])
    target = group.file[references[number]] if number < len(references) else None
    if not isinstance(target, h5py.Dataset) or target.attrs.get("MATLAB_class") != b"char":
        return ""
    return "".join(map(chr, np.ravel(target[()])))


def _hdf5_dataset(member: Any, label: str) -> Iterator[tuple[str, LazyArray]]:
    if member.shape is None or member.external or member.is_virtual or not member.size:
        return
    unit = str(member.attrs.get("units", member.attrs.get("unit", "")))
    if member.attrs.get("MATLAB_class") == b"char":
        return
    if member.dtype.names == ("real", "imag"):
        yield label, LazyArray(member.shape, _complex_part(member), unit)
    elif member.dtype.names:
        for field in member.dtype.names:
            kind = member.dtype[field]
            if kind.base.kind in "fiub":
                shape = (*member.shape, *kind.shape)
                yield f"{label}.{field}", LazyArray(shape, _field_part(member, field), unit)
    elif member.dtype.kind in "fiubc":
        yield label, LazyArray(member.shape, member.__getitem__, unit)


def _field_part(member: Any, field: str) -> Callable[[tuple[slice, ...]], NDArray[Any]]:
    rank = len(member.shape)

    def read(part: tuple[slice, ...]) -> NDArray[Any]:
        values = member.fields(field)[part[:rank]]
        return np.asarray(values[(slice(None),) * rank + part[rank:]])

    return read


def _complex_part(member: Any) -> Callable[[tuple[slice, ...]], NDArray[Any]]:
    return lambda part: member[part]["real"] + 1j * member[part]["imag"]
