"""Dataclasses as plain data: what fingerprints, stored results and JSON are made from."""

import json
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robotmodels.common.atomic_files import write_text


def split_arrays(value: object) -> tuple[object, dict[str, NDArray[Any]]]:
    """Return plain data with a mark for each array, and the arrays in their order.

    Parameters
    ----------
    value : object
        Plain data, arrays, and dataclasses, tuples and mappings of them.

    Returns
    -------
    plain : object
        A dataclass is a pair of its name and its fields, an array its type.
    arrays : dict of str to ndarray
        Arrays by the path of fields, keys and five-digit indices that leads to them.

    Raises
    ------
    TypeError
        For anything else.
    """
    arrays: dict[str, NDArray[Any]] = {}

    def mark(array: NDArray[Any], path: str) -> str:
        arrays[path] = array
        return array.dtype.str

    return _plain(value, "", mark, lambda number: number, lambda *record: record), arrays


def json_data(value: object) -> Any:
    """Return plain data as JSON has it: lists for arrays, null for numbers that are not finite.

    Raises
    ------
    TypeError
        For anything but plain data, arrays, and dataclasses, tuples and mappings of them.
    """
    return _plain(
        value,
        "",
        lambda array, path: json_data(array.tolist()),
        lambda number: number if isfinite(number) else None,
        lambda name, content: content,
    )


def json_text(document: object, ascii: bool = False) -> str:
    """Return a document as JSON text, see `json_data`; `ascii` escapes all other characters."""
    return json.dumps(json_data(document), indent=1, ensure_ascii=ascii, allow_nan=False)


def write_json(path: Path, document: object) -> None:
    """Write a document as JSON, see `json_data`; the file appears when it is complete."""
    write_text(path, json_text(document, ascii=True) + "\n")


def _plain(
    value: object,
    path: str,
    array: Callable[[NDArray[Any], str], object],
    number: Callable[[float], object],
    record: Callable[[str, dict[str, object]], object],
) -> object:
    """Return plain data; the functions say what an array, a float and a dataclass become."""

    def inside(item: object, key: object) -> object:
        return _plain(item, f"{path}/{key}" if path else str(key), array, number, record)

    if isinstance(value, np.ndarray):
        return array(value, path)
    if isinstance(value, np.generic):
        value = value.item()
    if is_dataclass(value) and not isinstance(value, type):
        content = {f.name: inside(getattr(value, f.name), f.name) for f in fields(value) if f.init}
        return record(type(value).__name__, content)
    if isinstance(value, Mapping):
        return {key: inside(item, key) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return tuple(inside(item, f"{i:05d}") for i, item in enumerate(value))
    if isinstance(value, float):
        return number(value)
    if value is None or isinstance(value, str | int | complex):
        return value
    raise TypeError(f"{path}: {type(value).__name__} is neither plain data nor an array")
