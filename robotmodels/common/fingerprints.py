"""Fingerprints of numbers, settings and files: by them stored work is recognised."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


def fingerprint(inputs: object, computed: object = ()) -> str:
    """Return the SHA-256 of plain data, arrays, and dataclasses, tuples and mappings of them.

    Parameters
    ----------
    inputs : object
        Every bit of an array counts, and its shape.
    computed : object
        Five digits of an array's numbers count, whatever the order of its additions.

    Raises
    ------
    TypeError
        For anything else, which could change without a trace.
    """
    plain, arrays = _parted(inputs)
    digest = hashlib.sha256(repr(plain).encode())
    for array in arrays:
        digest.update(repr(array.shape).encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    plain, arrays = _parted(computed)
    digest.update(repr(plain).encode())
    for array in arrays:
        digest.update(repr(array.shape).encode())
        digest.update(_rounded(array).encode())
    return digest.hexdigest()


def _parted(value: object) -> tuple[object, list[NDArray[Any]]]:
    """Return plain data with a mark for each array, and the arrays in their order."""
    arrays: list[NDArray[Any]] = []

    def plain(item: object) -> object:
        if isinstance(item, np.ndarray):
            arrays.append(item)
            return item.dtype.str
        if isinstance(item, np.generic):
            return item.item()
        if is_dataclass(item) and not isinstance(item, type):
            named = {f.name: getattr(item, f.name) for f in fields(item) if f.init}
            return type(item).__name__, plain(named)
        if isinstance(item, Mapping):
            return {key: plain(one) for key, one in item.items()}
        if isinstance(item, tuple | list):
            return tuple(plain(one) for one in item)
        if item is None or isinstance(item, str | int | float | complex):
            return item
        raise TypeError(f"fingerprint: {type(item).__name__} is neither plain data nor an array")

    return plain(value), arrays


def _rounded(array: NDArray[Any]) -> str:
    """Return five digits of each number; nothing of those that only rounding keeps from zero."""
    flat = np.ravel(array)
    size = np.abs(flat)
    least = 1e-12 * float(size.max(initial=0.0, where=np.isfinite(size)))
    return " ".join("0" if s <= least else f"{x:.5g}" for x, s in zip(flat, size, strict=True))


_CHUNK = 1 << 20


def json_digest(content: Any) -> str:
    """Return the SHA-256 of plain data, whatever the order of its keys."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file's bytes."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while chunk := file.read(_CHUNK):
            digest.update(chunk)
    return digest.hexdigest()


def folder_digest(folder: Path, leave_out: frozenset[str] = frozenset()) -> str:
    """Return the SHA-256 of all files of a folder, names included."""
    files = sorted(p for p in folder.rglob("*") if p.is_file() and p.name not in leave_out)
    return json_digest({p.relative_to(folder).as_posix(): file_digest(p) for p in files})
