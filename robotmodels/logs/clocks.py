"""The clock of a table: a line through its stamps, gaps and doubled samples."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.errors import InvalidInput
from robotmodels.logs.log import Log, Table
from robotmodels.logs.mapping_file import TimeChoice
from robotmodels.logs.units import time_factor

_TIME_NAME = re.compile(r"(^|[^a-z])(t|time|timestamps?|stamps?|zeit)([^a-z]|$)", re.IGNORECASE)
_WINDOW = 8  # stamps on both sides that tell a gap from a late stamp
_RESTART = 5  # spacings that the time runs back by where it begins anew, and rises after


@dataclass(frozen=True, eq=False)
class Clock:
    """When the rows of a table were sampled: at ``start + sample_time * ticks``.

    Attributes
    ----------
    sample_time : float, s
        Slope of a line through the stamps over the ticks.
    start : float, s
        Time of tick zero.
    rows : ndarray of int, (N,)
        Rows of the table in use; doubled samples are left out.
    ticks : ndarray of int, (N,)
        Their ticks; they skip numbers where samples are missing.
    jitter, worst : float, s
        Root mean square and largest distance of the stamps from the line.
    doubled : int
        Rows left out because they repeat the time of the row before.
    restarts : tuple of int
        Rows at which the time begins anew; a gap is put before them.
    source : str
        What it was made from, in words.
    """

    sample_time: float
    start: float
    rows: IntArray
    ticks: IntArray
    jitter: float
    worst: float
    doubled: int
    source: str
    restarts: tuple[int, ...] = ()

    @property
    def gaps(self) -> list[tuple[int, int]]:
        """First row after each gap, and how many samples are missing before it."""
        steps = np.diff(self.ticks)
        return [(int(self.rows[i + 1]), int(steps[i]) - 1) for i in np.flatnonzero(steps > 1)]

    @property
    def segments(self) -> list[tuple[int, int]]:
        """Ranges of `rows` without a gap."""
        ends = [0, *(np.flatnonzero(np.diff(self.ticks) > 1) + 1).tolist(), len(self.rows)]
        return list(pairwise(ends))


def table_clock(log: Log, table: Table, choice: TimeChoice) -> Clock:
    """Return the clock of a table, as a mapping says or else as names suggest.

    Raises
    ------
    InvalidInput
        If nothing tells the time.
    """
    where = f"{log.where}: {table.name}".rstrip(": ")
    if choice.counter and choice.counter in table.channels:
        return _counted(table, choice, where)
    column = time_channel(table, choice)
    if column and not (choice.sample_time and not choice.column):
        unit = choice.unit or table.channels[column].unit
        stamps = np.asarray(table.values(column), dtype=float) * time_factor(unit)
        return fit_clock(stamps, where, f"stamps of {column!r}", choice.sample_time)
    sample_time = choice.sample_time or table.sample_time or _stated(log)
    if sample_time is None:
        raise InvalidInput(
            f"{where}: no channel tells the time (such as t or time), no sample time is stated; "
            "time: {sample_time: ...} [s] or {column: ...} in the mapping is needed"
        )
    rows = np.arange(table.rows)
    return Clock(sample_time, 0.0, rows, rows, 0.0, 0.0, 0, "the stated sample time")


def time_channel(table: Table, choice: TimeChoice) -> str:
    """Return the channel with a table's stamps, empty where there is none."""
    if choice.column in table.channels:
        return choice.column
    if table.time:
        return table.time
    names = [name for name in table.channels if _TIME_NAME.search(name.rpartition(".")[2])]
    plain = [name for name in names if _rises(table, name)]
    return min(plain, key=len, default="")


def fit_clock(stamps: Array, where: str, source: str, sample_time: float | None = None) -> Clock:
    """Return the clock that stamps show.

    Parameters
    ----------
    stamps : ndarray, (N,), s
        Stamps of all rows; NaN where a row has none.
    sample_time : float, optional, s
        Where it is stated, in place of the stamps' own.

    Raises
    ------
    InvalidInput
        If fewer than three stamps rise.
    """
    finite = np.flatnonzero(np.isfinite(stamps))
    stamps, restarts = _continued(stamps, finite)
    rows = finite[np.r_[True, _rising(stamps[finite])]] if len(finite) else finite
    if len(rows) < 3:
        raise InvalidInput(f"{where}: {source}: fewer than three of them rise; they are no times")
    times = stamps[rows]
    spacing = _spacing(np.diff(times)) if sample_time is None else sample_time
    ticks = _ticks(times, spacing)
    k = ticks - ticks.mean()
    slope = float(k @ (times - times.mean()) / (k @ k)) if sample_time is None else sample_time
    start = float(times.mean() - slope * ticks.mean())
    residual = times - start - slope * ticks
    return Clock(
        sample_time=slope,
        start=start,
        rows=rows,
        ticks=ticks,
        jitter=float(np.sqrt(np.mean(residual**2))),
        worst=float(np.abs(residual).max()),
        doubled=len(finite) - len(rows),
        restarts=restarts,
        source=source,
    )


def clock_messages(clock: Clock, name: str) -> list[str]:
    """Return what a person should know of a clock, in words."""
    step = clock.sample_time
    lines = [f"{name}: {len(clock.rows)} samples every {1e3 * step:.6g} ms, from {clock.source}"]
    if clock.jitter > 1e-3 * step:
        lines.append(
            f"{name}: stamps scatter by {1e3 * clock.jitter:.3g} ms (at most "
            f"{1e3 * clock.worst:.3g} ms) about the line; samples are taken as even"
        )
    if clock.doubled:
        lines.append(f"{name}: {clock.doubled} rows repeat a time or run back and are left out")
    for row in clock.restarts[:5]:
        lines.append(f"{name}: the time begins anew at row {row}, and with it a run")
    gaps = [(row, missing) for row, missing in clock.gaps if row not in clock.restarts]
    for row, missing in gaps[:5]:
        lines.append(f"{name}: a gap of {missing} missing samples before row {row}")
    if len(gaps) > 5:
        lines.append(f"{name}: {len(gaps)} gaps in all; each part becomes a run of its own")
    return lines


def _counted(table: Table, choice: TimeChoice, where: str) -> Clock:
    if choice.sample_time is None:
        raise InvalidInput(f"{where}: time: counter needs the sample_time of one count [s]")
    counts = np.asarray(table.values(choice.counter), dtype=float)
    steps = np.diff(counts)
    span = 2.0 ** np.ceil(np.log2(max(counts.max(), 1.0) + 1))
    counts = counts + span * np.r_[0, np.cumsum(steps < -span / 2)]  # it began anew
    source = f"counter {choice.counter!r}"
    return fit_clock(counts * choice.sample_time, where, source, None)


def _continued(stamps: Array, finite: IntArray) -> tuple[Array, tuple[int, ...]]:
    """Return stamps that go on rising where recordings were put one behind the other."""
    steps = np.diff(stamps[finite])
    if not (steps > 0).any():
        return stamps, ()
    spacing = float(np.median(steps[steps > 0], axis=0))
    backward = np.flatnonzero(steps < -_RESTART * spacing)
    # What runs back for a row or two is a stamp that came wrong, not a recording.
    starts = [i + 1 for i in backward if _rises_from(stamps[finite[i + 1 : i + 1 + _RESTART]])]
    shifted = stamps.copy()
    for start in starts:
        pause = stamps[finite[start - 1]] + _RESTART * spacing - stamps[finite[start]]
        shifted[finite[start] :] += pause
    return shifted, tuple(int(finite[start]) for start in starts)


def _rises_from(stamps: Array) -> bool:
    return len(stamps) > 2 and bool((np.diff(stamps) > 0).all())


def _rising(times: Array) -> Array:
    steps = np.diff(times)
    least = 1e-3 * np.median(steps[steps > 0], axis=0) if (steps > 0).any() else np.inf
    highest = np.maximum.accumulate(times)
    return np.asarray(times[1:] - highest[:-1] > least)


def _rises(table: Table, name: str) -> bool:
    head = np.asarray(table.values(name, 1000), dtype=float)
    steps = np.diff(head[np.isfinite(head)])
    return len(steps) > 1 and (steps >= 0).mean() > 0.98 and (steps > 0).mean() > 0.3


def _spacing(steps: Array) -> float:
    """Return the usual spacing; the mean of usual steps, where stamps are rounded."""
    middle = float(np.median(steps))
    usual = steps[(steps > 0.5 * middle) & (steps < 1.5 * middle)]
    return float(usual.mean()) if len(usual) else middle


def _ticks(times: Array, spacing: float) -> IntArray:
    """Return sample numbers; a step counts as a gap where later stamps stay behind it."""
    steps = np.diff(times)
    ticks = np.ones(len(steps), dtype=int)
    for i in np.flatnonzero(steps > 1.5 * spacing):
        before = times[max(0, i + 1 - _WINDOW) : i + 1]
        after = times[i + 1 : i + 1 + _WINDOW]
        ends = before + spacing * np.arange(len(before) - 1, -1, -1)
        shift = np.median(after - spacing * np.arange(len(after))) - np.median(ends)
        ticks[i] = max(1, round(shift / spacing))
    return np.concatenate([[0], np.cumsum(ticks)])


def _stated(log: Log) -> float | None:
    """Return a sample time among the constants of a file."""
    names: Sequence[str] = ("dt", "ts", "sample_time", "t_s", "sampletime")
    for name, values in log.constants.items():
        if name.rpartition(".")[2].lower() in names and values.size == 1:
            value = float(np.real(values[0]))
            return value if value > 0 else None
    return None
