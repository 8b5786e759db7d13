"""Universal files: the functions at nodal degrees of freedom, dataset 58, through pyuff."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from robotmodels.common.errors import InvalidInput
from robotmodels.common.file_paths import check_file
from robotmodels.data_files.file_guard import PathLike, library_errors

_CONTAINER = "a universal file that pyuff can read"
_FUNCTION, _UNITS = 58, 164
_WHOLE = (
    *("func_type", "ver_num", "rsp_node", "rsp_dir", "ref_node", "ref_dir", "num_pts"),
    *(f"{axis}_spec_data_type" for axis in ("abscissa", "ordinate", "orddenom")),
)
_TEXT = ("id1", "id2")
_MOST = 10**9  # of what a header of ten letters holds


def read_functions(path: PathLike) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return the functions and the units (dataset 164) of a file as pyuff names their entries.

    Other datasets are passed over. Abscissa ``x`` and ordinate ``data`` of functions are of one
    length and finite.

    Raises
    ------
    InvalidInput
        Naming the file, the function and what is wrong in it.
    """
    import pyuff

    source = Path(path)
    check_file(source)
    # pyuff raises nothing more particular than Exception.
    with library_errors(source, _CONTAINER, Exception), ignore_unclosed_files():
        file = pyuff.UFF(str(source))
        kinds = list(file.get_set_types())
        numbers = [i for i, kind in enumerate(kinds) if kind == _FUNCTION]
        functions = [file.read_sets(i) for i in numbers]
        units = [file.read_sets(i) for i, kind in enumerate(kinds) if kind == _UNITS]
    for number, function in zip(numbers, functions, strict=True):
        _check(function, f"{source}: dataset {number + 1}")
    return functions, units


@contextmanager
def ignore_unclosed_files() -> Iterator[None]:
    """Accept that pyuff leaves its files to be closed when it is done with them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)
        yield


def _check(function: dict[str, Any], where: str) -> None:
    for key in _WHOLE:
        value: Any = function.get(key)
        if not isinstance(value, int) or abs(value) > _MOST:
            raise InvalidInput(f"{where}: {key} is {str(value)[:60]!r}; a whole number is needed")
    for key in _TEXT:
        if not isinstance(function.get(key), str):
            raise InvalidInput(f"{where}: {key} is missing; a line of text is needed")
    if "x" not in function or "data" not in function:
        raise InvalidInput(
            f"{where}: ordinates of type {function.get('ord_data_type')}; real or complex ones, of "
            "type 2, 4, 5 or 6, are needed"
        )
    x, data, points = function["x"], function["data"], function["num_pts"]
    if len(x) != points or len(data) != points:
        raise InvalidInput(
            f"{where}: {len(data)} values at {len(x)} abscissae, its header says {points}; it is "
            "cut off or damaged"
        )
    if not (np.isfinite(x).all() and np.isfinite(data).all()):
        raise InvalidInput(f"{where}: values that are not finite")
