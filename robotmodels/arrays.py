"""Array types, and arrays that nobody can change by accident."""

from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robotmodels.errors import InvalidInput

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_T = TypeVar("_T", bound=np.generic)


def read_only(array: NDArray[_T]) -> NDArray[_T]:
    """Return a view of `array` that cannot be written to."""
    view = array.view()
    view.flags.writeable = False
    return view


def real_numbers(values: ArrayLike, what: str) -> Array:
    """Return `values` as a float array.

    Raises
    ------
    InvalidInput : if they are not real numbers, or rows differ in length; it starts with `what`.
    """
    try:
        array = np.asarray(values)
        if not np.iscomplexobj(array):
            return array.astype(float)
    except (TypeError, ValueError):
        pass
    raise InvalidInput(f"{what}: an array of real numbers is needed, found {str(values)[:60]}")
