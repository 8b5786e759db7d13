"""What files of FRFs and of distortion levels hold, whatever their container."""

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput
from robotmodels.data_files.array_schema import ArraySchema, Field
from robotmodels.description.ranges import MOST_LENGTH

FRF_SCHEMA, DISTORTION_SCHEMA = "frf/1", "distortion/1"
_LARGEST_MISFIT = 1e-9  # of frequencies told twice, relative

_POSITIONS = Field(("position", "coordinate"), least=-MOST_LENGTH, most=MOST_LENGTH)
# Axes of the covariance depend on its kind; `FrfEstimate` knows both.
FRF = ArraySchema(
    {
        "positions": _POSITIONS,
        "omega": Field(("frequency",)),
        "response": Field(("position", "frequency", "output", "motor"), "complex"),
        "covariance": Field(("position", "frequency", "", ""), "complex"),
        "repetitions": Field(("position",), "whole", least=1),
        "degrees_of_freedom": Field(("position",), finite=False, optional=True),
        "deviations": Field(
            ("position", "draw", "frequency", "output", "motor"), "complex", optional=True
        ),
        "line_correlation": Field(("lag",), least=-1, most=1, optional=True),
    }
)

DECLARED = 1e15
"""Stands for infinite degrees of freedom where a format has no infinity."""

_LINES = {"odd": "odd line", "even": "even line"}
DISTORTION = ArraySchema(
    {
        "positions": _POSITIONS,
        "omega": Field(("frequency",), least=0),
        "noise": Field(("position", "frequency", "output", "motor"), least=0),
        # One block alone tells no total.
        "total": Field(("position", "frequency", "output", "motor"), least=0, finite=False),
        "blocks": Field(("position",), "whole", least=1),
        "output": Field(("position", "frequency", "output"), least=0),
        **{f"{kind}_omega": Field((line,), least=0) for kind, line in _LINES.items()},
        **{
            f"{kind}{what}": Field(("position", line, "output"), least=0)
            for kind, line in _LINES.items()
            for what in ("", "_noise", "_raw")
        },
    }
)


def stored_freedom(degrees_of_freedom: Array) -> Array | None:
    """Return degrees of freedom as text and UFF hold them; None where they are unknown."""
    if np.isnan(degrees_of_freedom).any():
        return None
    return np.minimum(degrees_of_freedom, DECLARED)


def read_freedom(stored: Array | None, count: int) -> Array:
    """Return degrees of freedom (Q,) of a file; not a number where it says nothing of them."""
    if stored is None:
        return np.full(count, np.nan)
    freedom = np.asarray(stored, dtype=float)
    return np.where(freedom >= DECLARED, np.inf, freedom)


def check_hertz(hertz: Array, omega: Array, where: object) -> None:
    """Refuse frequencies [Hz] that are not those of `omega` [rad/s], of which one would be ignored.

    Raises
    ------
    InvalidInput
        Naming the first that differs.
    """
    expected = omega / (2 * np.pi)
    wrong = ~(np.abs(hertz - expected) <= _LARGEST_MISFIT * np.abs(expected))
    if wrong.any():
        i = int(np.argmax(wrong))
        raise InvalidInput(
            f"{where}: frequency_hz: {hertz[i]:.9g} Hz where omega is {omega[i]:.9g} rad/s; the "
            "same frequencies are needed"
        )
