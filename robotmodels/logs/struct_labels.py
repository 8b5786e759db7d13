"""Names in arrays of structs: scopes put them beside the values, as texts."""

from collections.abc import Iterable, Iterator
from typing import Any, TypeVar

import numpy as np

LABELS = ("Name", "name", "label")
"""Fields in which scopes name a signal."""
_VALUES = ("data", "values", "value")
_Array = TypeVar("_Array")


def first_label(texts: Iterable[Any]) -> str:
    """Return the first text, its dots replaced, empty if there is none."""
    plain = (
        text.ravel()[0] if isinstance(text, np.ndarray) and text.size else text for text in texts
    )
    return next(
        (t.strip().replace(".", "_") for t in plain if isinstance(t, str) and t.strip()), ""
    )


def labelled_arrays(
    arrays: Iterable[tuple[str, _Array]], numbered: str, name: str, label: str
) -> Iterator[tuple[str, _Array]]:
    """Yield the arrays of a struct; values of one with a label, such as a scope's, are named so."""
    for each, array in arrays:
        field = each.removeprefix(f"{numbered}.")
        yield f"{name}.{label}" if label and field.lower() in _VALUES else each, array
