"""Files of MATLAB, version 4 to 7.3: structs nested, arrays of structs, cells."""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from robotmodels.data_files.file_guard import library_errors
from robotmodels.logs.array_log import LazyArray, arrays_log, lazy_array
from robotmodels.logs.hdf5_log import read_hdf5_log
from robotmodels.logs.log import Log
from robotmodels.logs.struct_labels import LABELS, UNITS, first_label, first_text, labelled_arrays

_VERSION_7_3 = b"MATLAB 7.3"


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
    return arrays_log(path, arrays)


def _matlab_arrays(value: Any, name: str) -> Iterator[tuple[str, LazyArray]]:
    """Yield arrays of numbers of variables, structs, arrays of structs and cells."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _matlab_arrays(inner, f"{name}.{key}" if name else str(key))
    elif hasattr(value, "_fieldnames"):
        yield from _matlab_arrays({f: getattr(value, f) for f in value._fieldnames}, name)
    elif isinstance(value, np.ndarray) and value.dtype == object:
        for number, inner in enumerate(value.ravel()):
            label = first_label(getattr(inner, field, None) for field in LABELS)
            unit = first_text(getattr(inner, field, None) for field in UNITS)
            number_name = name if value.size == 1 else f"{name}({number})"
            members = _matlab_arrays(inner, number_name)
            yield from labelled_arrays(members, number_name, name, label, unit)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "fiubc" and value.size:
        yield name, lazy_array(value)
