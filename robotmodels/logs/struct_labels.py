"""Names and units in arrays of structs: scopes put them beside the values, as texts."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from robotmodels.logs.array_log import LazyArray

LABELS = ("Name", "name", "label")
"""Fields in which scopes name a signal."""
UNITS = ("Unit", "unit", "Units", "units")
"""Fields in which they state its unit."""
_VALUES = ("data", "values", "value")


def first_text(texts: Iterable[Any]) -> str:
    """Return the first text, empty if there is none."""
    plain = (
        text.ravel()[0] if isinstance(text, np.ndarray) and text.size else text for text in texts
    )
    return next((t.strip() for t in plain if isinstance(t, str) and t.strip()), "")


def first_label(texts: Iterable[Any]) -> str:
    """Return the first text as a part of a name, its dots replaced."""
    return first_text(texts).replace(".", "_")


def labelled_arrays(
    arrays: Iterable[tuple[str, LazyArray]], numbered: str, name: str, label: str, unit: str
) -> Iterator[tuple[str, LazyArray]]:
    """Yield the arrays of a struct; values beside a label, such as a scope's, are named so.

    They have the unit that stands beside them.
    """
    for each, array in arrays:
        if each.removeprefix(f"{numbered}.").lower() in _VALUES:
            yield f"{name}.{label}" if label else each, replace(array, unit=array.unit or unit)
        else:
            yield each, array
