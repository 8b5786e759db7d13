"""Information of more candidates than memory holds: a file of packed matrices, read in chunks.

After a header of one line of JSON, padded to `_HEADER` bytes, follow the sum of all matrices, the
positions, (Q, n), and the matrices, (Q, p (p + 1) / 2), all float64 of this machine; of matrices
the upper triangles. A pass over gigabytes
reads them into one megabyte after the other.
"""

import json
import os
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Annotated, BinaryIO, Literal

import numpy as np
from pydantic import Field, NonNegativeInt, PositiveInt

from oed.information_sets.candidates import OneValue
from oed.information_sets.matrix_checks import check_matrices, check_positions
from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.atomic_files import atomic_write
from robotmodels.common.deprecation import renamed_attributes
from robotmodels.common.errors import InvalidInput
from robotmodels.common.file_paths import check_file
from robotmodels.common.yaml_files import FileSection, parse
from robotmodels.common.yaml_reader import Node
from robotmodels.data_files.json_text import parse_json

_FORMAT, _HEADER = "oed-information/1", 65536
_CHUNK_BYTES = 2**20
"""Read at once, into the same memory, which then stays in the cache."""
_READ = 100_000
"""Candidates that a worker reads in a task."""


class StoreHeader(FileSection):
    """The first line of a store."""

    format: Literal["oed-information/1"]
    names: Annotated[list[str], Field(min_length=1)]
    candidates: PositiveInt
    axes: NonNegativeInt


@renamed_attributes("0.2", prices="directional_derivatives")
@dataclass(frozen=True, eq=False)
class StoredInformation(OneValue):
    """The information of Q candidates in a file; a set of candidates like `InformationSet`.

    Attributes
    ----------
    path : Path
        Path of the file.
    names : tuple of str
        p parameter names.
    shape : tuple of (int, int)
        Q candidates, n coordinates of each position.
    executor : Executor or None
        Workers that read the file for `directional_derivatives`; None reads it here.

    Raises
    ------
    InvalidInput
        If there is no such file, it is no store, or it is cut off.
    """

    path: Path
    names: tuple[str, ...]
    shape: tuple[int, int]
    executor: Executor | None = field(default=None, repr=False)

    @classmethod
    def open(cls, path: str | os.PathLike[str]) -> "StoredInformation":
        """Return what `write_store` wrote; nothing is read but the header."""
        source = Path(path)
        check_file(source)
        with source.open("rb") as file:
            line = file.read(_HEADER)
        try:
            content = parse_json(line, "its header")
            header = parse(Node(0, content), StoreHeader, "its header")
        except InvalidInput as error:
            raise InvalidInput(f"{source}: not an information store ({_FORMAT}): {error}") from None
        names, shape = tuple(header.names), (header.candidates, header.axes)
        size = _packed_size(len(names))
        needed = _HEADER + 8 * (size + shape[0] * (shape[1] + size))
        size_on_disk = source.stat().st_size
        if size_on_disk != needed:
            raise InvalidInput(
                f"{source}: {size_on_disk} bytes, {needed} are needed; it is cut off"
            )
        return cls(source.absolute(), names, shape)

    def __len__(self) -> int:
        return self.shape[0]

    def __getstate__(self) -> dict[str, object]:
        return self.__dict__ | {"executor": None}  # workers give no work to others

    @property
    def positions(self) -> Array:
        """All positions, (Q, n) [rad], mapped and not read."""
        return np.memmap(self.path, np.float64, "r", _HEADER + 8 * self._size, self.shape)

    @cached_property
    def total(self) -> Array:
        """The sum of all candidates' information, (p, p)."""
        return self._unpacked(np.fromfile(self.path, np.float64, self._size, offset=_HEADER))

    @property
    def matrices(self) -> Array:
        """All matrices, (Q, p, p), in memory: for few candidates only."""
        return self.take(np.arange(len(self)))

    def take(self, indices: IntArray) -> Array:
        """Return the matrices of some candidates, (n, p, p)."""
        packed = np.empty((len(indices), self._size))
        # Reading ahead, as maps do, would take fifty times as much from the disk.
        with self.path.open("rb", buffering=0) as file:
            for row, index in zip(packed, indices.tolist(), strict=True):
                file.seek(self._offset + index * row.nbytes)
                file.readinto(row.data)
        return self._unpacked(packed)

    def directional_derivatives(self, weight: Array) -> Array:
        """Return tr(W H_i), (Q,), for W, (p, p)."""
        rows, columns = np.triu_indices(len(self.names))
        packed = (weight + weight.T)[rows, columns] / np.where(rows == columns, 2.0, 1.0)
        if self.executor is None:
            return self._times(packed, 0, len(self))
        starts = range(0, len(self), _READ)
        ends = (min(start + _READ, len(self)) for start in starts)
        read = self.executor.map(partial(_times, self, packed), starts, ends)
        parts = [
            self._times(packed, start, min(start + _READ, len(self))) if part is None else part
            for start, part in zip(starts, read, strict=True)
        ]
        return np.concatenate(parts)

    def _times(self, packed: Array, start: int, end: int) -> Array:
        """Return products of a vector and some candidates' packed matrices."""
        products = np.empty(end - start)
        for at, part in self._parts(start, end):
            np.matmul(part, packed, out=products[at - start : at - start + len(part)])
        return products

    def combined(self, weights: Array) -> Array:
        """Return sum_i w_i H_i, (p, p), for weights (Q,)."""
        used = np.flatnonzero(weights)
        if len(used) < len(self) // 8:
            return np.asarray(np.tensordot(weights[used], self.take(used), axes=1))
        if (weights == weights[0]).all():
            return np.asarray(weights[0] * self.total)
        parts = self._parts()
        return self._unpacked(
            sum(weights[start : start + len(part)] @ part for start, part in parts)
        )

    @property
    def _size(self) -> int:
        return _packed_size(len(self.names))

    @property
    def _offset(self) -> int:
        return _HEADER + 8 * (self._size + self.shape[0] * self.shape[1])

    def _parts(self, start: int = 0, end: int | None = None) -> Iterator[tuple[int, Array]]:
        """Yield packed chunks of candidates that are valid until the next one only."""
        last, size = len(self) if end is None else end, self._size
        buffer = np.empty((max(1, _CHUNK_BYTES // (8 * size)), size))
        with self.path.open("rb") as file:
            file.seek(self._offset + 8 * start * size)
            for at in range(start, last, len(buffer)):
                part = buffer[: last - at]
                file.readinto(part.data)
                yield at, part

    def _unpacked(self, packed: Array | float) -> Array:
        values, p = np.asarray(packed), len(self.names)
        full = np.empty((*values.shape[:-1], p, p))
        rows, columns = np.triu_indices(p)
        full[..., rows, columns] = values
        full[..., columns, rows] = values
        return full


def _times(store: StoredInformation, packed: Array, start: int, end: int) -> Array | None:
    """Return `StoredInformation._times` in a worker; None where it does not see the file."""
    return store._times(packed, start, end) if store.path.exists() else None


def write_store(
    path: str | os.PathLike[str],
    positions: Array,
    names: Sequence[str],
    chunks: Iterable[Array],
    of_sums: bool = False,
) -> StoredInformation:
    """Write a store from chunks of matrices, (n, p, p), in the order of the positions.

    The file appears under its name when it is complete. Matrices that are sums of squares
    (`of_sums`) are checked only where they are not finite.

    Raises
    ------
    InvalidInput
        Naming the candidate, if a matrix is not finite, symmetric or semidefinite; if there are not
        as many as positions; if the file cannot be written.
    """
    total, written = np.zeros(_packed_size(len(names))), 0
    with begun_store(path, positions, names) as file:
        for matrices in chunks:
            packed = packed_matrices(matrices, written, of_sums)
            file.write(packed.tobytes())
            total += packed.sum(axis=0)
            written += len(matrices)
        if written != len(positions):
            raise InvalidInput(f"{path}: {written} matrices for {len(positions)} positions")
        write_total(file, total)
    return StoredInformation.open(path)


@contextmanager
def begun_store(
    path: str | os.PathLike[str], positions: Array, names: Sequence[str]
) -> Iterator[BinaryIO]:
    """Yield a file with all but the matrices, and zero for their sum; it ends where they begin.

    Raises
    ------
    InvalidInput
        As `write_store`, of positions, names and file.
    """
    positions = np.ascontiguousarray(positions, dtype=np.float64)
    check_positions(positions)
    candidates, axes = positions.shape
    header = {"format": _FORMAT, "names": list(names), "candidates": candidates, "axes": axes}
    line = json.dumps(header).encode()
    if len(line) > _HEADER:
        raise InvalidInput(f"{path}: the names take {len(line)} bytes; at most {_HEADER} fit")
    with atomic_write(path) as part, _opened(part, path) as file:
        file.write(line.ljust(_HEADER))
        write_total(file, np.zeros(_packed_size(len(names))))
        file.write(positions.data)
        yield file


def write_total(file: BinaryIO, total: Array) -> None:
    """Write the sum of all matrices, packed, to a store."""
    file.seek(_HEADER)
    file.write(total.tobytes())


def packed_matrices(matrices: Array, first: int, of_sums: bool) -> Array:
    """Return upper triangles (n, p (p + 1) / 2) of matrices (n, p, p), checked as in `write_store`.

    The first one is that of candidate `first`.
    """
    check_matrices(matrices, first, of_sums)
    rows, columns = np.triu_indices(matrices.shape[-1])
    packed = 0.5 * (matrices[:, rows, columns] + matrices[:, columns, rows])
    return np.ascontiguousarray(packed)


def _opened(part: Path, path: str | os.PathLike[str]) -> BinaryIO:
    try:
        return part.open("wb")
    except OSError as error:
        raise InvalidInput(f"{path}: cannot be written: {error.strerror}") from error


def _packed_size(p: int) -> int:
    return p * (p + 1) // 2
