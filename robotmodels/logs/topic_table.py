"""The messages of one topic as rows of numbers."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from operator import attrgetter
from typing import Any

import numpy as np

from robotmodels.common.arrays import Array, BoolArray, IntArray
from robotmodels.logs.column_store import ColumnStore
from robotmodels.logs.log import Channel, Table, unique_names
from robotmodels.logs.message_layout import MessageLayout
from robotmodels.logs.message_types import MessageType

_BATCH = 4096  # messages that are decoded at once
_BATCH_BYTES = 1 << 23
_MOST_COLUMNS = 2000  # images have more
_SECOND = 1_000_000_000


class TopicTable:
    """Numbers of all messages of a topic, with the fields of its first message.

    Messages that are laid out like the first are decoded many at once, others one by one.

    Parameters
    ----------
    kind : MessageType
        Their type.
    raw : bytes
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

    def __init__(self, kind: MessageType, raw: bytes, stack: ExitStack) -> None:
        self._kind, example = kind, kind.decode(raw)
        self._names_as_read = _names_of(example)
        self._labels = [str(name) for name in self._names_as_read or ()]
        self._fields = list(_fields(example, ""))
        columns = [name for path, length in self._fields for name in self._names(path, length)]
        self.columns = unique_names(columns) if len(columns) <= _MOST_COLUMNS else []
        self._getters = [attrgetter(path) for path, _ in self._fields]
        self._stamp = _stamp_path(example)
        self._layout = self._checked_layout(raw, example) if self.columns else None
        self._store = ColumnStore(2 * bool(self.columns) + len(self.columns), stack)
        self._batch: list[tuple[int, bytes]] = []
        self._bytes = 0
        self._origin: tuple[int, int] | None = None
        self.dropped = 0

    @property
    def first(self) -> int | None:
        """Time of the first message [ns]."""
        if self._origin is None:
            return None
        return self._origin[1] or self._origin[0]

    def append(self, log_time: int, raw: bytes) -> None:
        """Add a message."""
        if self.columns:
            self._batch.append((log_time, raw))
            self._bytes += len(raw)
            if len(self._batch) == _BATCH or self._bytes > _BATCH_BYTES:
                self.flush()

    def flush(self) -> None:
        """Decode the messages that were added since the last time."""
        times, messages = [time for time, _ in self._batch], [raw for _, raw in self._batch]
        self._batch, self._bytes = [], 0
        numbers, stamps = np.empty((len(times), len(self.columns))), np.zeros(len(times), dtype=int)
        complete = self._decode_alike(messages, numbers, stamps)
        for i in np.flatnonzero(~complete):
            message = self._kind.decode(messages[i])
            row = self._numbers(message)
            if len(row) == len(self.columns):
                numbers[i], stamps[i], complete[i] = row, self._stamp_of(message), True
        self.dropped += int((~complete).sum())
        if complete.any():
            self._store_rows(np.array(times)[complete], stamps[complete], numbers[complete])

    def _store_rows(self, times: IntArray, stamps: IntArray, numbers: Array) -> None:
        if self._origin is None:
            self._origin = (int(times[0]), int(stamps[0]))
        # Differences of whole numbers: doubles hold nanoseconds since 1970 to 0.2 us only.
        since = np.stack([times - self._origin[0], stamps - self._origin[1]], axis=1) / _SECOND
        self._store.append(np.concatenate([since, numbers], axis=1))

    def _decode_alike(
        self, messages: Sequence[bytes], numbers: Array, stamps: IntArray
    ) -> BoolArray:
        """Decode the messages that are laid out like the first; return which they are."""
        alike, layout = np.zeros(len(messages), dtype=bool), self._layout
        if layout is None:
            return alike
        size = len(layout.example)
        index = np.array([i for i, raw in enumerate(messages) if len(raw) == size], dtype=int)
        raw = np.frombuffer(b"".join(messages[i] for i in index), dtype=np.uint8).reshape(-1, size)
        same = layout.alike(raw)
        index, raw = index[same], raw[same]
        column = 0
        for path, length in self._fields:
            part = layout.numbers(raw, path)
            numbers[index, column : column + part.shape[1]] = part
            column += 1 if length is None else length
        if self._stamp:
            seconds, nanoseconds = (
                layout.numbers(raw, f"{self._stamp}.{part}")[:, 0].astype(int)
                for part in ("sec", "nanosec")
            )
            stamps[index] = seconds * _SECOND + nanoseconds
        alike[index] = True
        return alike

    def _checked_layout(self, raw: bytes, example: Any) -> MessageLayout | None:
        """Return the layout of the first message if it yields what decoding it yields."""
        numbers, stamps = np.empty((1, len(self.columns))), np.zeros(1, dtype=int)
        try:
            self._layout = self._kind.layout(raw)
            decoded = self._decode_alike([raw], numbers, stamps).all()
        except (KeyError, ValueError):
            return None
        same = np.array_equal(numbers[0], self._numbers(example), equal_nan=True)
        return self._layout if decoded and same and stamps[0] == self._stamp_of(example) else None

    def _stamp_of(self, message: Any) -> int:
        """Return the stamp of a message [ns], zero where it has none."""
        if not self._stamp:
            return 0
        stamp = attrgetter(self._stamp)(message)
        return int(stamp.sec) * _SECOND + int(stamp.nanosec)

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
        log, stamp = self._origin or (0, 0)
        offset = ((stamp or log) - origin) / _SECOND
        # Stamps of messages that are all alike are none.
        stamped = bool(self._stamp) and bool(self._store.read(1, 0, self._store.rows).any())
        if not stamped and stamp:
            offset = 0.0

        def time(start: int, stop: int) -> Any:
            return self._store.read(int(stamped), start, stop) + offset

        channels = {"time": Channel(time, "s")}
        channels |= {column: self._store.channel(i + 2) for i, column in enumerate(self.columns)}
        return Table(name, self._store.rows, channels, time="time")

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


def _stamp_path(message: Any) -> str:
    """Return where a message has its own stamp, empty where it has none."""
    for path in ("header.stamp", "stamp"):
        try:
            attrgetter(f"{path}.nanosec")(message)
        except AttributeError:
            continue
        return path
    return ""
