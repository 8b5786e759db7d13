"""The part of a log that statistics look at: numbers of a family beside their times."""

from dataclasses import dataclass

import numpy as np

from estimators.logs.families import Family
from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.errors import InvalidInput
from robotmodels.logs.clocks import Clock, table_clock, time_channel, time_unit
from robotmodels.logs.log import Log, Table
from robotmodels.logs.mapping_file import TimeChoice
from robotmodels.logs.units import time_factor

_ROWS = 20_000


@dataclass(frozen=True, eq=False)
class TableTime:
    """Clock of a table, and the stamps of its rows.

    Attributes
    ----------
    table : Table
        The table.
    clock : Clock
        Clock.
    choice : TimeChoice
        Where it comes from; what had to be guessed is filled in.
    column : str
        Channel with the stamps, empty where the clock does without.
    """

    table: Table
    clock: Clock
    choice: TimeChoice
    column: str

    def samples(self, start: int, stop: int) -> tuple[IntArray, Array]:
        """Return the rows in use from `start` to `stop`, and their real stamps [s]."""
        first, last = self.clock.samples_before(start), self.clock.samples_before(stop)
        rows = self.clock.sample_rows(first, last)
        if not self.column or self.clock.restarts:
            return rows, self.clock.sample_times(first, last)
        unit = self.choice.unit or self.table.channels[self.column].unit
        stamps = np.asarray(self.table.channels[self.column].read(start, stop), dtype=float)
        return rows, stamps[rows - start] * time_factor(unit)


def table_times(log: Log, choice: TimeChoice) -> tuple[dict[str, TableTime], dict[str, str]]:
    """Return the times of tables by name, and why others have none."""
    times, missing = {}, {}
    for table in log.tables:
        if table.abscissa != "time":
            continue
        try:
            times[table.name] = _table_time(log, table, choice)
        except InvalidInput as error:
            missing[table.name] = str(error)
    return times, missing


def family_samples(family: Family, time: TableTime) -> tuple[Array, Array]:
    """Return stamps (N,) and values (N, n) of the part of a family that moves most."""
    start, stop = _window(family, time)
    rows, stamps = time.samples(start, stop)
    columns = [
        np.asarray(family.table.channels[name].read(start, stop), dtype=float)[rows - start]
        for name in family.channels
    ]
    return stamps, np.stack(columns, axis=1)


def _window(family: Family, time: TableTime) -> tuple[int, int]:
    rows = family.table.rows
    if rows <= _ROWS:
        return 0, rows
    name = family.channels[0]
    spans = [
        float(np.nanstd(np.asarray(piece, dtype=float)))
        for piece in family.table.pieces(name, _ROWS)
        if len(piece) == _ROWS
    ]
    start = int(np.argmax(spans)) * _ROWS
    return start, start + _ROWS


def _table_time(log: Log, table: Table, choice: TimeChoice) -> TableTime:
    column = "" if choice.counter in table.channels else time_channel(table, choice)
    if choice.sample_time is None and column and not choice.unit:
        unit = time_unit(table, column)
        choice = choice.model_copy(update={"unit": "" if unit == "s" else unit})
    clock = table_clock(log, table, choice)
    stamped = bool(column) and (choice.sample_time is None or bool(choice.column))
    return TableTime(table, clock, choice, column if stamped else "")
