"""Damaged heaps of variable-length text in HDF5 files, over which HDF5 itself does not end.

HDF5 2.0 walks from object to object of a global heap by the sizes that stand in the file, also by
one of zero. Of a text it takes what its reference says, also beyond the object, and 4 GiB with it
(format specification, III.E, IV.A.2.d and IV.A.2.m).
"""

import struct
from collections.abc import Iterator
from pathlib import Path

from robotmodels.common.errors import InvalidInput

_SIGNATURE = b"GCOL\x01\x00\x00\x00"
_HEADER, _OBJECT, _REFERENCE = 16, struct.Struct("<HH4xQ"), struct.Struct("<IQI")
_MESSAGE = struct.Struct("<BBHHH")  # of an attribute: version, flags, sizes of name, type, space
_CHUNK = 2**24
LENGTHS = 8
"""Of addresses and lengths in a file [bytes]; HDF5 allows for others, which nobody uses."""


def check_heaps(source: Path) -> None:
    """Refuse a file with a heap over which HDF5 does not end.

    Raises
    ------
    InvalidInput
        If there is one.
    """
    if any(_object_sizes(source, offset) is None for offset in _offsets(source, _SIGNATURE)):
        raise _damaged(source)


def check_text_dataset(source: Path, base: int, offset: int, count: int) -> None:
    """Refuse references to more text than there is where they lead.

    Only references that are read are judged: others may look like them.

    Parameters
    ----------
    base : int
        What addresses count from.
    offset : int
        Offset of the first of them in the file.
    count : int
        Count of references, one after the other.

    Raises
    ------
    InvalidInput
        If there is one.
    """
    with source.open("rb") as file:
        file.seek(offset)
        references = file.read(count * _REFERENCE.size)
    whole = len(references) // _REFERENCE.size * _REFERENCE.size
    most, heaps = source.stat().st_size, dict[int, dict[int, int]]()
    for length, address, index in _REFERENCE.iter_unpack(references[:whole]):
        if address not in heaps:
            heaps[address] = _object_sizes(source, base + address) or {}
        if length > heaps[address].get(index, most):
            raise _damaged(source)


def check_text_attribute(source: Path, base: int, name: str, count: int) -> None:
    """Do likewise for `count` references in each attribute called `name`."""
    word = name.encode() + b"\0"
    with source.open("rb") as file:
        for offset in _offsets(source, word):
            for version in (1, 2, 3):
                # Version 3 tells the characters too.
                start = offset - _MESSAGE.size - (version == 3)
                if start < 0:
                    continue
                file.seek(start)
                header = _MESSAGE.unpack(file.read(_MESSAGE.size))
                if header[0] != version or header[2] != len(word):
                    continue
                step = 8 if version == 1 else 1
                skipped = sum(-(-size // step) * step for size in header[2:])
                check_text_dataset(source, base, offset + skipped, count)


def _damaged(source: Path) -> InvalidInput:
    return InvalidInput(f"{source}: not a sound HDF5 file (a heap of text is damaged)")


def _offsets(source: Path, word: bytes) -> Iterator[int]:
    """Yield where `word` is in a file."""
    with source.open("rb") as file:
        start, tail = 0, b""
        while chunk := file.read(_CHUNK):
            data = tail + chunk
            at = data.find(word)
            while at >= 0:
                yield start + at
                at = data.find(word, at + 1)
            tail = data[1 - len(word) :]
            start += len(data) - len(tail)


def _object_sizes(source: Path, start: int) -> dict[int, int] | None:
    """Return the sizes of the objects of the heap at `start` by index, None if it is none."""
    sizes: dict[int, int] = {}
    with source.open("rb") as file:
        file.seek(start)
        if file.read(len(_SIGNATURE)) != _SIGNATURE:
            return None
        stop = start + int.from_bytes(file.read(LENGTHS), "little")
        offset = start + _HEADER
        while offset + _OBJECT.size <= stop:
            file.seek(offset)
            header = file.read(_OBJECT.size)
            if len(header) < _OBJECT.size:
                return None
            index, _, size = _OBJECT.unpack(header)
            needed = size if index == 0 else _OBJECT.size + (size + 7) // 8 * 8
            if not 0 < needed <= stop - offset:
                return None
            if index:
                sizes[index] = size
            offset += needed
    return sizes
