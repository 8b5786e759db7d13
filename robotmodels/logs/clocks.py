"""The clock of a table: a line through its stamps, gaps and doubled samples."""

import re
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.errors import InvalidInput
from robotmodels.logs.clock_line import continued_stamps, fit_line, rising
from robotmodels.logs.log import Log, Table
from robotmodels.logs.mapping_file import TimeChoice
from robotmodels.logs.units import time_factor

_UNITS = ("s", "ms", "us", "µs", "ns", "sec")
_TIME_NAME = re.compile(
    r"(^|[^a-z])(t|time|timestamps?|stamps?|zeit|zeitstempel|temps|tempo|tiempo|clock|elapsed|ticks?"
    r"|secs?|seconds|msecs?|millis|milliseconds|usecs?|micros|nsecs?|nanos)([^a-z]|$)",
    re.IGNORECASE,
)
_ABSCISSA = re.compile(r"(^|\.)x(\(0\))?(\.|$)", re.IGNORECASE)  # of scopes, such as rec.X.Data
_STEPS = ("dt", "ts", "sample_time", "t_s", "sampletime", "sampling_time", "sample_period")
_FREQUENCIES = ("fs", "f_s", "fps", "rate", "sample_rate", "samplerate", "sampling_rate",
                "sampling_frequency", "sample_frequency", "control_freq")  # fmt: skip
_WINDOW = 8  # stamps on both sides that tell a gap from a late stamp


@dataclass(frozen=True, eq=False)
class Clock:
    """When the rows of a table were sampled: at ``start + sample_time * tick``.

    Samples are the rows in use: doubled ones are left out. They are kept as stretches in which rows
    and ticks both rise by one, since long logs have few of those.

    Attributes
    ----------
    sample_time : float, s
        Slope of a line through the stamps over the ticks.
    start : float, s
        Time of tick zero.
    rows, ticks, counts : ndarray of int, (stretches,)
        First row and first tick of each stretch, and its number of samples. Ticks skip numbers
        where samples are missing.
    jitter, worst : float, s
        Root mean square and largest distance of the stamps from the line.
    doubled : int
        Rows left out because they repeat the time of a row before, or run back.
    source : str
        What it was made from, in words.
    restarts : tuple of int
        Rows at which the time begins anew; a gap is put before them.
    """

    sample_time: float
    start: float
    rows: IntArray
    ticks: IntArray
    counts: IntArray
    jitter: float
    worst: float
    doubled: int
    source: str
    restarts: tuple[int, ...] = ()

    def __len__(self) -> int:
        return int(self.counts.sum())

    @cached_property
    def _starts(self) -> IntArray:
        """Number of the first sample of each stretch."""
        return np.asarray(np.cumsum(self.counts) - self.counts, dtype=int)

    @cached_property
    def gaps(self) -> list[tuple[int, int]]:
        """First row after each gap, and how many samples are missing before it."""
        missing = self.ticks[1:] - self.ticks[:-1] - self.counts[:-1]
        return [(int(self.rows[i + 1]), int(missing[i])) for i in np.flatnonzero(missing)]

    @cached_property
    def segments(self) -> list[tuple[int, int]]:
        """Ranges of samples without a gap."""
        missing = self.ticks[1:] - self.ticks[:-1] - self.counts[:-1]
        inner = self._starts[1:][missing > 0].tolist()
        return list(pairwise([0, *inner, len(self)]))

    def sample_rows(self, low: int, high: int) -> IntArray:
        """Return the rows of samples `low` to `high`."""
        return self._of(self.rows, low, high)

    def sample_times(self, low: int, high: int) -> Array:
        """Return the times of samples `low` to `high` [s]."""
        return np.asarray(self.start + self.sample_time * self._of(self.ticks, low, high))

    def samples_before(self, row: int) -> int:
        """Return the number of samples in rows before `row`."""
        stretch = int(np.searchsorted(self.rows, row, "right")) - 1
        if stretch < 0:
            return 0
        inside = min(row - int(self.rows[stretch]), int(self.counts[stretch]))
        return int(self._starts[stretch]) + inside

    def time_of(self, sample: int) -> float:
        """Return the time of a sample, the last one for -1 [s]."""
        index = sample % len(self)
        return float(self.sample_times(index, index + 1)[0])

    def _of(self, firsts: IntArray, low: int, high: int) -> IntArray:
        samples = np.arange(low, high)
        stretch = np.searchsorted(self._starts, samples, "right") - 1
        return np.asarray(firsts[stretch] + samples - self._starts[stretch])


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
        unit = choice.unit or time_unit(table, column)
        stamps, factor = np.asarray(table.values(column), dtype=float), time_factor(unit)
        stamps = stamps if factor == 1 else stamps * factor  # no copy of a long log's
        told = "" if choice.unit or unit == "s" else f" in {unit}"
        return fitted_clock(stamps, where, f"stamps of {column!r}{told}", choice.sample_time)
    sample_time = choice.sample_time or table.sample_time or _stated(log)
    if sample_time is None:
        raise InvalidInput(
            f"{where}: no channel has time stamps (such as t or time), no sample time is stated; "
            "time: {sample_time: ...} [s] or {column: ...} in the mapping is needed"
        )
    first, all_rows = np.zeros(1, dtype=int), np.array([table.rows])
    source = "the stated sample time"
    return Clock(sample_time, 0.0, first, first, all_rows, 0.0, 0.0, 0, source)


def time_channel(table: Table, choice: TimeChoice) -> str:
    """Return the channel with a table's stamps, empty where there is none."""
    if choice.column in table.channels:
        return choice.column
    if table.time:
        return table.time
    names = [name for name in table.channels if _TIME_NAME.search(_spaced(name))]
    names = names or [name for name in table.channels if _ABSCISSA.search(name)]
    plain = [name for name in names if _rises(table, name)]
    return min(plain, key=lambda name: (_unevenness(table, name), len(name)), default="")


def _spaced(name: str) -> str:
    """Return the last part of a name, camelCase parted."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name.rpartition(".")[2])


def time_unit(table: Table, column: str) -> str:
    """Return the unit of stamps: as file or name say, else the likeliest.

    Controllers sample at 1 Hz to 100 kHz.
    """
    stated = table.channels[column].unit
    words = re.findall(r"[a-zµ]+", column.lower())
    scaled = re.search(r"(?<![a-z\d])(\d+) ?([nuµm]?s)(?![a-z])", column.lower())
    if scaled:
        return f"{scaled[1]} {scaled[2]}"  # such as 100 ns of Windows
    told = next((unit for unit in (stated, *words) if unit in _UNITS), "")
    if told:
        return told
    head = np.asarray(table.values(column, 2000), dtype=float)
    steps = np.diff(head[np.isfinite(head)])
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    if step < 0.9:
        return "s"
    return "ms" if step < 900 else "us" if step < 9e5 else "ns"


def clock_messages(clock: Clock, name: str) -> list[str]:
    """Return what a person should know of a clock, in words."""
    step = clock.sample_time
    lines = [f"{name}: {len(clock)} samples every {1e3 * step:.6g} ms, from {clock.source}"]
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
    return fitted_clock(counts * choice.sample_time, where, source)


def fitted_clock(stamps: Array, where: str, source: str, sample_time: float | None = None) -> Clock:
    """Return the clock that stamps show; NaN where a row has none.

    Parameters
    ----------
    stamps : ndarray, (rows,), s
        Stamps.
    sample_time : float, optional, s
        Where it is stated, in place of the stamps' own.

    Raises
    ------
    InvalidInput
        If fewer than three stamps rise.
    """
    stamps, restarts = continued_stamps(stamps)
    valid = rising(stamps)
    if int(valid.sum()) < 3:
        raise InvalidInput(f"{where}: {source}: fewer than three of them rise; they are no times")
    line = fit_line(stamps, valid, sample_time)
    return Clock(
        sample_time=line.slope,
        start=line.offset,
        rows=line.rows,
        ticks=line.ticks,
        counts=line.counts,
        jitter=line.jitter,
        worst=line.worst,
        doubled=int(np.isfinite(stamps).sum()) - int(valid.sum()),
        source=source,
        restarts=restarts,
    )


def _rises(table: Table, name: str) -> bool:
    head = np.asarray(table.values(name, 1000), dtype=float)
    steps = np.diff(head[np.isfinite(head)])
    return len(steps) > 1 and (steps >= 0).mean() > 0.98 and (steps > 0).mean() > 0.3


def _unevenness(table: Table, name: str) -> int:
    """Return how much the usual steps of stamps differ, in powers of two, all below 1e-3 alike."""
    steps = np.diff(np.asarray(table.values(name, 1000), dtype=float))
    middle = float(np.nanmedian(steps))
    spread = float(np.nanmedian(np.abs(steps - middle)))
    return round(np.log2(max(spread, 1e-3 * middle) / middle)) if middle > 0 else 0


def _stated(log: Log) -> float | None:
    """Return a sample time among the constants of a file."""
    for name, values in log.constants.items():
        tail = name.rpartition(".")[2].lower()
        value = float(np.real(values[0])) if values.size == 1 else 0.0
        if value > 0 and tail in _STEPS:
            return value
        if value > 0 and tail in _FREQUENCIES:
            return 1 / value
    return None
