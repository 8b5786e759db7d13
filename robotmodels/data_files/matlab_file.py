"""MATLAB files of arrays, versions 4 to 7 through scipy and 7.3, which is HDF5, through h5py.

MATLAB drops trailing axes of length one and has no vectors, so shapes are compared loosely. Version
7.3 stores axes in reverse.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from robotmodels.common.errors import InvalidInput
from robotmodels.common.file_paths import check_file
from robotmodels.data_files.array_schema import ArraySchema, Field, StoredArray
from robotmodels.data_files.file_guard import PathLike, library_errors, listed
from robotmodels.data_files.hdf5_file import MOST_COMPRESSED, Hdf5Group, open_hdf5

_CONTAINER = "a MATLAB file"
_VERSION_7_3 = b"MATLAB 7.3"
_MOST_AXES = 32
_CONTENTS = {
    "double": "numbers",
    "single": "numbers",
    "logical": "truth values",
    "char": "text",
    "cell": "a cell array",
    "struct": "a struct",
    "sparse": "a sparse matrix",
    **{f"{sign}int{bits}": "numbers" for sign in ("", "u") for bits in (8, 16, 32, 64)},
}


def read_mat(path: PathLike, schema: ArraySchema, name: str) -> dict[str, Any]:
    """Return the variables of a file, as `schema` says.

    Parameters
    ----------
    name : str
        Name that its variable ``schema`` must be.

    Raises
    ------
    InvalidInput
        Naming the file, the variable, the value read and the value needed.
    """
    source = Path(path)
    check_file(source)
    with source.open("rb") as file:
        new = file.read(len(_VERSION_7_3)) == _VERSION_7_3
    if not new:
        return _read(_variables(source), schema, name, str(source))
    with open_hdf5(source, "MATLAB 7.3 writes HDF5, which is") as group:
        return _read(_variables_7_3(group), schema, name, str(source))


def _read(
    stored: Mapping[str, StoredArray], schema: ArraySchema, name: str, where: str
) -> dict[str, Any]:
    if "schema" in stored:
        actual = ArraySchema({"schema": Field(kind="text")}).read(
            {"schema": stored["schema"]}, where
        )["schema"]
        if actual != name:
            raise InvalidInput(f"{where}: 'schema' is {actual[:60]!r}; {name!r} is needed")
    values = ArraySchema({"schema": Field(kind="text"), **schema.fields}).read(stored, where)
    del values["schema"]
    return values


def _variables(source: Path) -> dict[str, StoredArray]:
    from scipy.io import loadmat, whosmat
    from scipy.io.matlab import MatReadError

    where = str(source)
    with library_errors(where, _CONTAINER, MatReadError):
        variables = [v for v in whosmat(where, appendmat=False) if not v[0].startswith("__")]
        size = source.stat().st_size
    names = [name for name, _, _ in variables]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InvalidInput(f"{where}: variable {listed(twice[:1])} is there twice")

    def reader(name: str) -> Any:
        with library_errors(f"{where}: {name}", _CONTAINER, MatReadError):
            value = loadmat(where, appendmat=False, variable_names=[name])[name]
        return _text(value, f"{where}: {name}") if value.dtype.kind in "US" else value

    return {
        name: StoredArray(
            _CONTENTS.get(kind, f"a {kind}"),
            tuple(int(length) for length in shape),
            lambda name=name: reader(name),  # type: ignore[misc]
            MOST_COMPRESSED * size,
            loose=True,
        )
        for name, shape, kind in variables
    }


def _variables_7_3(group: Hdf5Group) -> dict[str, StoredArray]:
    names = [name for name in group.names() if not name.startswith("#")]
    return {name: _variable_7_3(group, name) for name in names}


def _variable_7_3(group: Hdf5Group, name: str) -> StoredArray:
    stored, where = group.stored(name), f"{group.where}: {name}"
    kind = str(group.attribute_of(name, "MATLAB_class"))
    content = _CONTENTS.get(kind, f"a {kind}")
    if stored.content not in ("numbers", "complex numbers"):
        return replace(stored, content=content if stored.content == "a group" else stored.content)
    if group.attribute_of(name, "MATLAB_empty"):
        # The values are the lengths of the axes, one of them zero.
        lengths = np.ravel(stored.read())
        if len(lengths) > _MOST_AXES or 0 not in lengths or (lengths < 0).any():
            raise InvalidInput(f"{where}: an empty array without an axis of length zero")
        shape = tuple(int(length) for length in lengths)
        return StoredArray(content, shape, lambda: np.zeros(shape), 0, loose=True)

    def read() -> Any:
        value = np.asarray(stored.read()).T
        return _text(value, where) if content == "text" else value

    return StoredArray(content, stored.shape[::-1], read, stored.capacity, loose=True)


def _text(value: Any, where: str) -> str:
    """Return the one line of a character array."""
    if value.dtype.kind in "iu":  # codes, of version 7.3
        value = np.array(["".join(chr(int(c)) for c in value.ravel())]) if len(value) == 1 else []
    lines = np.ravel(value)
    if len(lines) != 1:
        raise InvalidInput(f"{where}: {len(lines)} lines of text; one is needed")
    return str(lines[0])
