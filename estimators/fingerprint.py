"""Fingerprints of numbers: by them kept work knows whether it belongs to what is asked now."""

import hashlib
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray


def fingerprint(
    said: object = "",
    exact: Iterable[NDArray[Any]] = (),
    rounded: Iterable[NDArray[Any]] = (),
) -> str:
    """Return the SHA-256 of settings and arrays.

    Parameters
    ----------
    said : plain data, told apart by their `repr`.
    exact : arrays that were given: every bit counts, and their shapes.
    rounded : arrays that were computed, in whatever order of additions: five digits count.
    """
    digest = hashlib.sha256(repr(said).encode())
    for array in exact:
        digest.update(repr(array.shape).encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    for array in rounded:
        digest.update("".join(f"{x:.5g} " for x in np.ravel(array)).encode())
    return digest.hexdigest()
