"""Columns on disk, written row by row as a file is read through and read column by column."""

import tempfile
from contextlib import ExitStack
from functools import partial
from itertools import pairwise

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.logs.log import Channel


class ColumnStore:
    """Numbers of a table in a nameless file of the folder for temporary files.

    Parameters
    ----------
    columns : int
        Number of columns.
    stack : ExitStack
        Closes the file.
    """

    def __init__(self, columns: int, stack: ExitStack) -> None:
        self._file = stack.enter_context(tempfile.TemporaryFile())  # noqa: SIM115
        self._columns = columns
        self._starts = [0]

    @property
    def rows(self) -> int:
        """Number of rows so far."""
        return self._starts[-1]

    def append(self, block: Array) -> None:
        """Add rows, (rows, columns)."""
        if len(block):
            self._file.seek(0, 2)
            np.ascontiguousarray(block.T, dtype=float).tofile(self._file)
            self._starts.append(self.rows + len(block))

    def read(self, column: int, start: int, stop: int) -> Array:
        """Return rows of a column."""
        values = np.empty(max(stop - start, 0))
        first = int(np.searchsorted(self._starts, start, "right")) - 1
        for low, high in pairwise(self._starts[first:]):
            if low >= stop:
                break
            begin, end = max(start, low), min(stop, high)
            self._file.seek(8 * (low * self._columns + column * (high - low) + begin - low))
            values[begin - start : end - start] = np.fromfile(self._file, count=end - begin)
        return values

    def channel(self, column: int, unit: str = "") -> Channel:
        """Return a column as a channel."""
        return Channel(partial(self.read, column), unit)
