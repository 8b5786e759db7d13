"""How much of many frequency responses a page has room for."""

import numpy as np

from robotmodels.arrays import IntArray

BUDGET = 3_200_000
"""Bytes that all panels of a page may take."""

_BYTES_OF_ELEMENT, _BYTES_OF_LINE, _FEWEST = 900, 46, 20
"""What an element of a position takes, and each of its lines; fewest lines to draw."""


def lines_drawn(shape: tuple[int, ...]) -> IntArray:
    """Return which lines of (Q, F, m, n) responses are drawn: all, or evenly so many as fit."""
    positions, lines, m, n = shape
    room = (BUDGET / (positions * m * n) - _BYTES_OF_ELEMENT) / _BYTES_OF_LINE
    count = min(lines, max(int(room), _FEWEST))
    return np.unique(np.linspace(0, lines - 1, count).round().astype(np.int64))
