"""A log as its file holds it: tables of named channels whose meaning is still open."""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robotmodels.common.errors import InvalidInput, nearest
from robotmodels.data_files.file_guard import listed

_SPAN = re.compile(r"\{(\d{1,4})\.\.(\d{1,4})\}")
PIECE = 1 << 18
"""Rows that are read at once."""


@dataclass(frozen=True, eq=False)
class Channel:
    """One column of a table.

    Attributes
    ----------
    read : callable
        Returns the values of rows ``start`` to ``stop``, real or complex.
    unit : str
        Unit that the file states, empty where it states none.
    """

    read: Callable[[int, int], NDArray[Any]]
    unit: str = ""


@dataclass(frozen=True, eq=False)
class Table:
    """Channels that were sampled together.

    Attributes
    ----------
    name : str
        Name of the table in its log, empty where there is one only.
    rows : int
        Number of rows.
    channels : mapping of str to Channel
        Channels by name, in the order of the file.
    sample_time : float or None, s
        As the file states it.
    time : str
        Channel that the file itself declares to be the time, else empty.
    abscissa : {"time", "frequency"}
        What a row stands for.
    """

    name: str
    rows: int
    channels: Mapping[str, Channel]
    sample_time: float | None = None
    time: str = ""
    abscissa: str = "time"

    def pieces(self, name: str, size: int = PIECE) -> Iterator[NDArray[Any]]:
        """Yield the values of a channel, `size` rows at a time."""
        for start in range(0, self.rows, size):
            yield self.channels[name].read(start, min(start + size, self.rows))

    def values(self, name: str, stop: int | None = None) -> NDArray[Any]:
        """Return the values of a channel, all or the first `stop`."""
        return self.channels[name].read(0, self.rows if stop is None else min(stop, self.rows))


@dataclass(frozen=True, eq=False)
class Log:
    """What one or several files of one recording hold.

    Attributes
    ----------
    files : tuple of Path
        The files.
    tables : tuple of Table
        Tables, each on its own clock.
    constants : mapping of str to ndarray
        Numbers beside the channels, such as gear ratios.
    notes : tuple of str
        What the reader had to pass over or to decide, in words.
    """

    files: tuple[Path, ...]
    tables: tuple[Table, ...]
    constants: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def where(self) -> str:
        """Name of the files, for errors."""
        return ", ".join(str(path) for path in self.files)

    def table_of(self, name: str) -> tuple[Table, str]:
        """Return the table that has a channel, and the channel's name in it.

        Parameters
        ----------
        name : str
            Name of the channel; ``table:channel`` where several tables have it.

        Raises
        ------
        InvalidInput
            If there is none of this name, or several.
        """
        hits = [(table, c) for table in self.tables for c in _named(table, name)]
        if len(hits) == 1:
            return hits[0]
        if hits:
            names = listed(f"{table.name}:{channel}" for table, channel in hits)
            raise InvalidInput(f"{self.where}: channel {name!r} is in several tables: {names}")
        channels = [channel for table in self.tables for channel in table.channels]
        raise InvalidInput(
            f"{self.where}: channel {name!r} is missing{nearest(name, channels)} (found: "
            f"{listed(channels)})"
        )

    def matching(self, pattern: str) -> list[tuple[Table, str]]:
        """Return tables and channels whose names match.

        ``*`` stands for any characters, ``{0..5}`` for each of the numbers, in this order.
        """
        if span := _SPAN.search(pattern):
            numbers = range(int(span[1]), int(span[2]) + 1)
            names = [f"{pattern[: span.start()]}{i}{pattern[span.end() :]}" for i in numbers]
            return [hit for name in names for hit in self.matching(name)]
        if "*" not in pattern:
            return [self.table_of(pattern)]
        plain = pattern.replace("[", "[[]")
        return [
            (table, channel)
            for table in self.tables
            for channel in table.channels
            if fnmatchcase(channel, plain) or fnmatchcase(f"{table.name}:{channel}", plain)
        ]


def _named(table: Table, name: str) -> list[str]:
    if name in table.channels:
        return [name]
    prefix, _, channel = name.partition(":")
    return [channel] if prefix == table.name and channel in table.channels else []


def array_channel(values: NDArray[Any], unit: str = "") -> Channel:
    """Return values that are in memory as a channel."""
    return Channel(lambda start, stop: values[start:stop], unit)


def unique_names(names: list[str]) -> list[str]:
    """Return names made different by a number in parentheses where they are alike."""
    counts: dict[str, int] = {}
    unique = []
    for name in names:
        counts[name] = counts.get(name, 0) + 1
        unique.append(name if counts[name] == 1 else f"{name} ({counts[name]})")
    return unique


def as_real(values: NDArray[Any]) -> NDArray[Any]:
    """Return numbers or truth values as doubles, complex numbers as they are."""
    return values if np.iscomplexobj(values) else values.astype(float, copy=False)
