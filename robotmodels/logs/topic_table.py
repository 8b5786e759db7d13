"""The messages of one topic as rows of numbers."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from operator import attrgetter
from typing import Any

import numpy as np

from robotmodels.logs.column_store import ColumnStore
from robotmodels.logs.log import Channel, Table, unique_names

_BATCH = 4096  # rows
_MOST_COLUMNS = 2000  # images have more
_SECOND = 1_000_000_000


class TopicTable:
    """Numbers of all messages of a topic, with the fields of its first message.

    Parameters
    ----------
    example : Any
        The first message.
    stack : ExitStack
        Closes the file that the numbers go to.

    Attributes
    ----------
    columns : list of str
        Names of the channels, none where the messages have no numbers.
    dropped : int
        Messages whose arrays have other lengths.
    first : int or None, ns
        Time of the first message, its own stamp before that of the recorder.
    """

    def __init__(self, example: Any, stack: ExitStack) -> None:
        self._names_as_read = _names_of(example)
        self._labels = [str(name) for name in self._names_as_read or ()]
        self._fields = list(_fields(example, ""))
        columns = [name for path, length in self._fields for name in self._names(path, length)]
        self.columns = unique_names(columns) if len(columns) <= _MOST_COLUMNS else []
        self._getters = [attrgetter(path) for path, _ in self._fields]
        self._stamp = _stamp_getter(example)
        self._store = ColumnStore(2 * bool(self.columns) + len(self.columns), stack)
        self._rows: list[list[float]] = []
        self._times: list[tuple[int, int]] = []
        self._origin: tuple[int, int] | None = None
        self.dropped = 0

    @property
    def first(self) -> int | None:
        """Time of the first message [ns]."""
        if self._origin is None:
            return None
        return self._origin[1] or self._origin[0]

    def append(self, log_time: int, message: Any) -> None:
        """Add a message."""
        if not self.columns:
            return
        row = self._numbers(message)
        if len(row) != len(self.columns):
            self.dropped += 1
            return
        stamp = self._stamp(message) if self._stamp is not None else 0
        if self._origin is None:
            self._origin = (log_time, stamp)
        # Differences of whole numbers: doubles hold nanoseconds since 1970 to 0.2 us only.
        times = ((log_time - self._origin[0]) / _SECOND, (stamp - self._origin[1]) / _SECOND)
        self._rows.append([*times, *row])
        if len(self._rows) == _BATCH:
            self._flush()

    def _numbers(self, message: Any) -> list[float]:
        """Return the numbers of a message, fewer than columns where an array has another length."""
        row: list[float] = []
        order = self._order(message)
        for getter, (_, length) in zip(self._getters, self._fields, strict=True):
            value = getter(message)
            if length is None:
                row.append(float(value))
            elif len(value) == length:
                # Lists of Python's numbers: an array of them all is made batch by batch.
                numbers = value.tolist() if isinstance(value, np.ndarray) else value
                named = order is not None and length == len(self._labels)
                row.extend([numbers[i] for i in order or ()] if named else numbers)
        return row

    def table(self, name: str, origin: int) -> Table:
        """Return the table of all messages, times from `origin` [ns] on."""
        self._flush()
        log, stamp = self._origin or (0, 0)
        offset = ((stamp or log) - origin) / _SECOND
        # Stamps of messages that are all alike are none.
        stamped = self._stamp is not None and bool(self._store.read(1, 0, self._store.rows).any())
        if not stamped and stamp:
            offset = 0.0

        def time(start: int, stop: int) -> Any:
            return self._store.read(int(stamped), start, stop) + offset

        channels = {"time": Channel(time, "s")}
        channels |= {column: self._store.channel(i + 2) for i, column in enumerate(self.columns)}
        return Table(name, self._store.rows, channels, time="time")

    def _flush(self) -> None:
        if self._rows:
            self._store.append(np.array(self._rows, dtype=float))
            self._rows = []

    def _names(self, path: str, length: int | None) -> list[str]:
        if length is None:
            return [path]
        named = self._labels if length == len(self._labels) else list(map(str, range(length)))
        return [f"{path}[{label}]" for label in named]

    def _order(self, message: Any) -> list[int] | None:
        """Return the order of this message's joints, None where it is that of the first."""
        if not self._labels or (names := _names_of(message)) == self._names_as_read:
            return None
        names = [str(name) for name in names or ()]
        if sorted(names) != sorted(self._labels):
            return []
        return [names.index(label) for label in self._labels]


def _names_of(message: Any) -> Any:
    """Return the names of the joints of a message's arrays, None where it has none."""
    names = getattr(message, "name", None) or getattr(message, "joint_names", None)
    return names if isinstance(names, list | tuple) else None


def _fields(message: Any, prefix: str) -> Iterator[tuple[str, int | None]]:
    """Yield paths of numbers and, of arrays, their lengths; headers and stamps apart."""
    for name, value in vars(message).items():
        if name in ("header", "stamp", "__msgtype__"):
            continue
        path = f"{prefix}{name}"
        if isinstance(value, bool | int | float | np.number):
            yield path, None
        elif _is_vector(value):
            yield path, len(value)
        elif hasattr(value, "__dict__") and not callable(value):
            yield from _fields(value, f"{path}.")


def _is_vector(value: Any) -> bool:
    if isinstance(value, np.ndarray):
        return value.dtype.kind in "fiub" and value.ndim == 1
    return isinstance(value, list) and bool(value) and isinstance(value[0], int | float)


def _stamp_getter(message: Any) -> Callable[[Any], int] | None:
    """Return what reads a message's own stamp in nanoseconds."""
    for path in ("header.stamp", "stamp"):
        try:
            attrgetter(f"{path}.nanosec")(message)
        except AttributeError:
            continue
        getter = attrgetter(path)
        return lambda each: int(getter(each).sec) * _SECOND + int(getter(each).nanosec)
    return None
