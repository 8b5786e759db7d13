"""Tables in which rows of several clocks were merged, cells of the others left empty."""

import numpy as np
from numpy.typing import NDArray

from robotmodels.common.arrays import Array, IntArray
from robotmodels.logs.clocks import time_channel
from robotmodels.logs.log import Channel, Table
from robotmodels.logs.mapping_file import TimeChoice

_HEAD = 2000  # rows that tell whether there is anything to part
_SPARSE = 0.6  # share of filled rows below which a channel has another clock; others miss values
_LEAST_ROWS = 8


def part_merged_rows(table: Table) -> tuple[Table, ...]:
    """Return a table for each set of channels that are filled in the same rows.

    The one with most rows keeps the name; a table in which no channel is sparse stays as it is.
    """
    time = table.time or time_channel(table, TimeChoice())
    names = [name for name in table.channels if name != time]
    shares = [np.isfinite(np.real(table.values(name, _HEAD))).mean() for name in names]
    if not time or min(shares, default=1.0) >= _SPARSE:
        return (table,)
    groups: dict[bytes, list[str]] = {}
    for name in names:
        groups.setdefault(_filled(table, name).tobytes(), []).append(name)
    pairs = [(np.flatnonzero(np.unpackbits(np.frombuffer(bits, np.uint8), count=table.rows)), each)
             for bits, each in groups.items()]  # fmt: skip
    pairs = [(rows, each) for rows, each in pairs if len(rows) >= _LEAST_ROWS]
    if len(pairs) < 2:
        return (table,)
    pairs.sort(key=lambda pair: -len(pair[0]))
    parts = []
    for number, (rows, members) in enumerate(pairs):
        channels = {name: _selected(table.channels[name], rows) for name in (time, *members)}
        name = f"{table.name}.part_{number + 1}".strip(".") if number else table.name
        parts.append(Table(name, len(rows), channels, None, time))
    return tuple(parts)


def _filled(table: Table, name: str) -> NDArray[np.uint8]:
    pieces = [np.isfinite(np.real(piece)) for piece in table.pieces(name)]
    return np.packbits(np.concatenate(pieces))


def _selected(channel: Channel, rows: IntArray) -> Channel:
    def read(start: int, stop: int) -> Array:
        inside = rows[start:stop]
        if not len(inside):
            return np.empty(0)
        first = int(inside[0])
        return np.asarray(channel.read(first, int(inside[-1]) + 1)[inside - first])

    return Channel(read, channel.unit)
