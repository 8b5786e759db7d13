"""Damaged heaps of variable-length text in HDF5 files, over which HDF5 itself does not end.

HDF5 2.0 walks from object to object of a global heap by the sizes that stand in the file, also by
one of zero. Of a text it takes what its reference says, also beyond the object, and 4 GiB with it
(format specification, III.E, IV.A.2.d and IV.A.2.m).
"""

import struct
from collections.abc import Iterator
from pathlib import Path

from robotmodels.errors import InvalidInput

_SIGNATURE = b"GCOL\x01\x00\x00\x00"
_HEADER, _OBJECT, _REFERENCE = 16, struct.Struct("<HH4xQ"), struct.Struct("<IQI")
_MESSAGE = struct.Struct("<BBHHH")  # of an attribute: version, flags, sizes of name, type, space
_CHUNK = 2**24
_MOST_WORK = 10**11  # bytes to search, over all heaps
LENGTHS = 8
"""Of addresses and lengths in a file [bytes]; HDF5 allows for others, which nobody uses."""


def check_heaps(source: Path, base: int) -> None:
    """Refuse a file with such a heap.

    Parameters
    ----------
    base : int
        What addresses count from.

    Raises
    ------
    InvalidInput
        If there is one.
    """
    damaged = InvalidInput(f"{source}: not a sound HDF5 file (a heap of text is damaged)")
    heaps: dict[bytes, dict[int, int]] = {}
    for place in _places(source, [_SIGNATURE], 0):
        sizes = _object_sizes(source, place)
        if sizes is None:
            raise damaged
        heaps[(place - base).to_bytes(LENGTHS, "little", signed=True)] = sizes
    if len(heaps) * source.stat().st_size > _MOST_WORK:
        raise InvalidInput(f"{source}: {len(heaps)} heaps of text are more than such files have")
    before = _REFERENCE.size - LENGTHS - 4
    with source.open("rb") as file:
        for place in _places(source, list(heaps), before):
            file.seek(place - before)
            reference = file.read(_REFERENCE.size)
            if len(reference) == _REFERENCE.size:
                length, _, index = _REFERENCE.unpack(reference)
                if length > heaps[reference[before:-4]].get(index, length):
                    raise damaged


def check_text_dataset(source: Path, place: int, count: int) -> None:
    """Refuse `count` references to text, from `place` in the file on, longer than the file."""
    with source.open("rb") as file:
        file.seek(place)
        references = file.read(count * _REFERENCE.size)
    whole = len(references) // _REFERENCE.size * _REFERENCE.size
    size = source.stat().st_size
    if any(length > size for length, _, _ in _REFERENCE.iter_unpack(references[:whole])):
        raise InvalidInput(f"{source}: not a sound HDF5 file (a text is longer than the file)")


def check_text_attribute(source: Path, name: str, count: int) -> None:
    """Refuse references to text, longer than the file, in attributes called `name`."""
    word = name.encode() + b"\0"
    with source.open("rb") as file:
        for place in _places(source, [word], _MESSAGE.size + 1):
            for version in (1, 2, 3):
                start = place - _MESSAGE.size - (version == 3)  # the third tells the characters too
                file.seek(start)
                header = _MESSAGE.unpack(file.read(_MESSAGE.size))
                if header[0] != version or header[2] != len(word):
                    continue
                step = 8 if version == 1 else 1
                skipped = sum(-(-size // step) * step for size in header[2:])
                check_text_dataset(source, place + skipped, count)


def _places(source: Path, words: list[bytes], least: int) -> Iterator[int]:
    """Yield where one of `words`, of equal length, is in a file, from `least` on."""
    if not words:
        return
    with source.open("rb") as file:
        start, kept = 0, b""
        while chunk := file.read(_CHUNK):
            data = kept + chunk
            for word in words:
                at = data.find(word)
                while at >= 0:
                    if start + at >= least:
                        yield start + at
                    at = data.find(word, at + 1)
            kept = data[1 - max(map(len, words)) :]
            start += len(data) - len(kept)


def _object_sizes(source: Path, start: int) -> dict[int, int] | None:
    """Return the sizes of the objects of the heap at `start` by index, None if one has no end."""
    sizes: dict[int, int] = {}
    with source.open("rb") as file:
        file.seek(start + len(_SIGNATURE))
        stop = start + int.from_bytes(file.read(LENGTHS), "little")
        place = start + _HEADER
        while place + _OBJECT.size <= stop:
            file.seek(place)
            header = file.read(_OBJECT.size)
            if len(header) < _OBJECT.size:
                return None
            index, _, size = _OBJECT.unpack(header)
            needed = size if index == 0 else _OBJECT.size + (size + 7) // 8 * 8
            if not 0 < needed <= stop - place:
                return None
            if index:
                sizes[index] = size
            place += needed
    return sizes
