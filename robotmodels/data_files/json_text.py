"""JSON as the standard has it: keys once, numbers finite, and arrays of it for array schemas."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from robotmodels.common.errors import InvalidInput
from robotmodels.common.file_paths import check_file
from robotmodels.data_files.array_schema import StoredArray
from robotmodels.data_files.file_guard import PathLike, library_errors

_CONTAINER = "valid JSON"


def read_json(path: PathLike) -> Any:
    """Return what a file of JSON holds.

    Raises
    ------
    InvalidInput
        Naming the file and what is wrong in it.
    """
    source = Path(path)
    check_file(source)
    with library_errors(source, _CONTAINER):
        text = source.read_text(encoding="utf-8")
    return parse_json(text, str(source))


def parse_json(text: str | bytes, where: str) -> Any:
    """Return what JSON text holds.

    Raises
    ------
    InvalidInput
        If it is no JSON, or a key is given twice; it starts with `where`.
    """

    def mapping(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        unique = dict(pairs)
        if len(unique) < len(pairs):
            keys = [key for key, _ in pairs]
            twice = next(key for key in keys if keys.count(key) > 1)
            raise InvalidInput(f"{where}: key {twice[:60]!r} is given twice")
        return unique

    def constant(name: str) -> float:
        raise InvalidInput(f"{where}: {name} is no number of JSON; finite numbers are needed")

    with library_errors(where, _CONTAINER):
        return json.loads(text, object_pairs_hook=mapping, parse_constant=constant)


def json_array(value: Any, where: str) -> StoredArray:
    """Return numbers, truth values or text of JSON, also in lists of lists, as an array.

    Parameters
    ----------
    where : str
        File and key, for errors.
    """
    shape: list[int] = []
    level = [value]
    while level and all(isinstance(item, list) for item in level):
        lengths = {len(item) for item in level}
        if len(lengths) > 1:
            return StoredArray("rows of unequal length", (), _nothing)
        shape.append(lengths.pop())
        level = [element for item in level for element in item]
    types = {type(item) for item in level}
    content = _CONTENTS.get(next(iter(types))) if len(types) == 1 else None
    if not types or types <= {int, float}:
        content = "numbers"

    def read() -> Any:
        if content == "text" and not shape:
            return value
        with library_errors(where, _CONTAINER):  # integers too large for any float
            whole = types == {int} and max(map(abs, level)) < 2**63
            kind = np.int64 if whole else bool if types == {bool} else float
            return np.array(level, dtype=kind).reshape(shape)

    return StoredArray(content or "a mixture of types", tuple(shape), read)


_CONTENTS = {
    bool: "truth values",
    int: "numbers",
    float: "numbers",
    str: "text",
    dict: "a mapping",
    list: "rows of unequal depth",
    type(None): "nothing",
}


def _nothing() -> None:
    return None
