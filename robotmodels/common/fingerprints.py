"""Fingerprints of numbers, settings and files: by them stored work is recognised."""

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robotmodels.common.plain_data import split_arrays


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
    plain, arrays = split_arrays(inputs)
    digest = hashlib.sha256(repr(plain).encode())
    for array in arrays.values():
        digest.update(repr(array.shape).encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    plain, arrays = split_arrays(computed)
    digest.update(repr(plain).encode())
    for array in arrays.values():
        digest.update(repr(array.shape).encode())
        digest.update(_rounded(array).encode())
    return digest.hexdigest()


def _rounded(array: NDArray[Any]) -> str:
    """Return five digits of each number; nothing of those that only rounding keeps from zero."""
    flat = np.ravel(array)
    size = np.abs(flat)
    least = 1e-12 * float(size.max(initial=0.0, where=np.isfinite(size)))
    return " ".join(
        "0" if s <= least else f"{x:.5g}" for x, s in zip(flat.tolist(), size.tolist(), strict=True)
    )


_CHUNK = 1 << 20


def json_digest(content: Any) -> str:
    """Return the SHA-256 of plain data, whatever the order of its keys."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def file_digest(path: Path, offset: int = 0, prefix: bytes = b"") -> str:
    """Return the SHA-256 of `prefix` and of a file's bytes from `offset` on."""
    digest = hashlib.sha256(prefix)
    with path.open("rb") as file:
        file.seek(offset)
        while chunk := file.read(_CHUNK):
            digest.update(chunk)
    return digest.hexdigest()


def folder_digest(folder: Path, leave_out: frozenset[str] = frozenset()) -> str:
    """Return the SHA-256 of all files of a folder, names included."""
    files = sorted(p for p in folder.rglob("*") if p.is_file() and p.name not in leave_out)
    return json_digest({p.relative_to(folder).as_posix(): file_digest(p) for p in files})
