"""Where the numbers of a message lie: messages laid out alike are decoded many at once."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from robotmodels.common.arrays import BoolArray, IntArray
from robotmodels.logs.optional_library import optional_library

_NAMES = ("name[", "joint_names[")
_BYTES = {"byte": "uint8", "char": "uint8"}


@dataclass(frozen=True, eq=False)
class MessageLayout:
    """Places of the numbers in messages that are laid out like an example.

    Attributes
    ----------
    example : ndarray of uint8, (bytes,)
        The message that the places come from.
    fields : dict of str to (int, dtype, int)
        First byte, type and count of the numbers of each field, by its path.
    fixed : ndarray of int
        Bytes with the lengths of arrays and texts, and with names of joints: messages in which
        they are the same are laid out alike.
    """

    example: NDArray[np.uint8]
    fields: dict[str, tuple[int, np.dtype[Any], int]]
    fixed: IntArray

    def alike(self, messages: NDArray[np.uint8]) -> BoolArray:
        """Return which messages, (N, bytes), are laid out like the example, (N,)."""
        same = messages[:, self.fixed] == self.example[self.fixed]
        return np.asarray(same.all(axis=1))

    def numbers(self, messages: NDArray[np.uint8], path: str) -> NDArray[Any]:
        """Return the numbers of a field of messages that are laid out alike, (N, count)."""
        first, kind, count = self.fields[path]
        part = messages[:, first : first + kind.itemsize * count]
        return np.ascontiguousarray(part).view(kind)


def message_layout(store: Any, kind: str, raw: bytes, *, cdr: bool) -> MessageLayout | None:
    """Return where the numbers of a message lie, None where it has parts of unusual types.

    Parameters
    ----------
    store : Typestore
        Types of messages, of rosbags.
    kind : str
        Name of the message's type.
    raw : bytes
        The message as it was recorded.
    cdr : bool
        Whether it is written as ROS 2 does, in CDR; else as ROS 1 does.
    """
    walk = _Walk(store, raw, cdr)
    try:
        walk.message(kind, "")
    except (TypeError, KeyError):
        return None
    example = np.frombuffer(raw, dtype=np.uint8)
    return MessageLayout(example, walk.fields, np.array(walk.fixed, dtype=int))


class _Walk:
    """One pass through a message, by the definition of its type."""

    def __init__(self, store: Any, raw: bytes, cdr: bool) -> None:
        self._store, self._raw, self._cdr = store, raw, cdr
        self._nodes = optional_library("rosbags.interfaces", "messages of ROS").Nodetype
        self._order: Literal["<", ">"] = "<" if not cdr or raw[1] else ">"
        self._offset = 4 if cdr else 0  # after the header of CDR, from which it is aligned
        self.fixed = list(range(self._offset))
        self.fields: dict[str, tuple[int, np.dtype[Any], int]] = {}

    def message(self, kind: str, prefix: str) -> None:
        for name, (node, content) in self._store.get_msgdef(kind).fields:
            self._field(node, content, f"{prefix}{name}")

    def _field(self, node: Any, content: Any, path: str) -> None:
        if node == self._nodes.NAME:
            self.message(content, f"{path}.")
        elif node == self._nodes.BASE and content[0] == "string":
            length = self._length()
            if path.startswith(_NAMES):
                self.fixed += range(self._offset, self._offset + length)
            self._offset += length
        elif node == self._nodes.BASE:
            self._numbers(content[0], path, 1)
        else:
            (inner, element), count = content
            if node == self._nodes.SEQUENCE:
                count = self._length()
            if inner == self._nodes.BASE and element[0] != "string":
                self._numbers(element[0], path, count)
            else:
                for index in range(count):
                    self._field(inner, element, f"{path}[{index}]")

    def _length(self) -> int:
        first, kind, _ = self._taken(np.dtype(f"{self._order}u4"), 1)
        self.fixed += range(first, self._offset)
        return int(np.frombuffer(self._raw, kind, 1, first)[0])

    def _numbers(self, name: str, path: str, count: int) -> None:
        kind = np.dtype(_BYTES.get(name, name)).newbyteorder(self._order)
        self.fields[path] = self._taken(kind, count)

    def _taken(self, kind: np.dtype[Any], count: int) -> tuple[int, np.dtype[Any], int]:
        if self._cdr and count:
            self._offset += -(self._offset - 4) % kind.itemsize
        first = self._offset
        self._offset += kind.itemsize * count
        return first, kind, count
