"""Stamps in two channels, whole seconds and nanoseconds, as one."""

import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.logs.log import Channel, Table

_SECONDS = re.compile(r"sec(ond)?s?(?![a-z])", re.IGNORECASE)
_NANOSECONDS = re.compile(
    r"nano_?sec(ond)?s?(?![a-z])|nanos(?![a-z])|(?<![a-z])nsec(ond)?s?(?![a-z])", re.IGNORECASE
)
_PLUS = " + "
_MOST_NANOSECONDS = 1e9


def with_joined_stamps(table: Table) -> Table:
    """Return a table with a channel of seconds for the first pair of seconds and nanoseconds.

    Their names differ in nothing but the unit, such as ``stamp.sec`` and ``stamp.nanosec``. The
    channel is the table's time unless the file declares another one.
    """
    parts = [name for name in table.channels if _NANOSECONDS.search(name)]
    seconds = {_SECONDS.sub("§", name): name for name in table.channels if name not in parts}
    for name in parts:
        whole = seconds.get(_NANOSECONDS.sub("§", name))
        if whole is None or not _is_fraction(table, name):
            continue
        joined = _joined(table.channels, whole, name)
        both = f"{whole}{_PLUS}{name}"
        return replace(table, channels={both: joined, **table.channels}, time=table.time or both)
    return table


def stamp_parts(column: str) -> tuple[str, ...]:
    """Return a channel of stamps, and those that it is made from."""
    return column, *column.split(_PLUS)


def _is_fraction(table: Table, name: str) -> bool:
    head = table.values(name, 1000)
    return bool((head >= 0).all() and (head < _MOST_NANOSECONDS).all())


def _joined(channels: Mapping[str, Channel], seconds: str, nanoseconds: str) -> Channel:
    def read(start: int, stop: int) -> Array:
        whole, part = channels[seconds].read(start, stop), channels[nanoseconds].read(start, stop)
        return np.asarray(whole + 1e-9 * part)

    return Channel(read, "s")
