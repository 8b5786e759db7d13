"""HDF5 files of arrays: links that leave the file, and what was never written, are refused."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from robotmodels.common.errors import InvalidInput
from robotmodels.common.file_paths import check_file
from robotmodels.data_files.array_schema import ArraySchema, StoredArray
from robotmodels.data_files.file_guard import PathLike, library_errors, listed
from robotmodels.data_files.hdf5_heaps import (
    LENGTHS,
    check_heaps,
    check_text_attribute,
    check_text_dataset,
)

_CONTAINER = "a sound HDF5 file"
MOST_COMPRESSED = 1100  # deflate makes of a byte at most 1032
_SCHEMA = "schema"
_CONTENTS = {
    "f": "numbers",
    "i": "numbers",
    "u": "numbers",
    "c": "complex numbers",
    "b": "truth values",
}


class Hdf5Group:
    """A group of an open file, or the file itself.

    Parameters
    ----------
    group : Any
        Group of h5py.
    where : str
        File and group, for errors.
    checked : set of tuple of (str, int)
        Names and lengths of attributes of text that were checked throughout the file.
    """

    def __init__(self, group: Any, where: str, checked: set[tuple[str, int]]) -> None:
        self._group = group
        self.where = where
        self._checked = checked

    def names(self) -> list[str]:
        """Return the names of its datasets and groups."""
        with library_errors(self.where, _CONTAINER):
            return [str(name) for name in self._group]

    def check_schema(self, needed: str) -> None:
        """Refuse a file whose attribute ``schema`` is not `needed`."""
        schema = self._attribute_value(_SCHEMA)
        if not isinstance(schema, str) or schema != needed:
            actual = schema if schema is None else str(schema)[:60]
            raise InvalidInput(f"{self.where}: 'schema' is {actual!r}; {needed!r} is needed")

    def group(self, name: str) -> "Hdf5Group":
        """Return a group in this one.

        Raises
        ------
        InvalidInput
            If there is none of this name.
        """
        import h5py

        member = self._member(name)
        if not isinstance(member, h5py.Group):
            raise InvalidInput(f"{self.where}: {name!r} is a dataset; a group is needed")
        return Hdf5Group(member, f"{self.where}: {name}", self._checked)

    def read(self, schema: ArraySchema, beside: tuple[str, ...] = ()) -> dict[str, Any]:
        """Return its datasets and attributes by name, as `schema` says.

        Parameters
        ----------
        beside : tuple of str
            Names of groups that the caller reads.

        Raises
        ------
        InvalidInput
            Naming the file, the dataset, the value read and the value needed.
        """
        stored = {name: self.stored(name) for name in self.names() if name not in beside}
        for name, field in schema.fields.items():
            if field.attribute and self._has_attribute(name):
                stored[name] = self._attribute(name)
        return schema.read(stored, self.where)

    def numbered(self, prefix: str, digits: int = 5) -> tuple[str, ...]:
        """Return the names prefix00000, prefix00001, ... of what is there, one at least.

        Parameters
        ----------
        digits : int
            Digits of the numbers, with leading zeros.

        Raises
        ------
        InvalidInput
            If one of them is missing.
        """
        names = {name for name in self.names() if name.startswith(prefix)}
        numbered = tuple(f"{prefix}{i:0{digits}d}" for i in range(max(len(names), 1)))
        missing = [name for name in numbered if name not in names]
        if missing:
            there = listed(sorted(names))
            raise InvalidInput(f"{self.where}: {missing[0]!r} is missing (found: {there})")
        return numbered

    def stored(self, name: str) -> StoredArray:
        """Return the description of a dataset, or of another object with its name."""
        import h5py

        member = self._member(name)
        if not isinstance(member, h5py.Dataset):
            return StoredArray("a group" if isinstance(member, h5py.Group) else "a type", (), _none)
        where = f"{self.where}: {name}"
        with library_errors(where, _CONTAINER):
            if member.is_virtual or member.external:
                raise InvalidInput(f"{where}: its values are in another file; they are needed here")
            plain = member.compression is None and not member.id.get_create_plist().get_nfilters()
            size = member.id.get_storage_size() * (1 if plain else MOST_COMPRESSED)
            capacity = size // max(member.dtype.itemsize, 1)
            content = _content(member.dtype)
            if member.shape is None:
                return StoredArray("nothing", (), _none)
            if content == "text":
                return StoredArray(
                    content, member.shape, lambda: self._texts(member, where), capacity
                )

        def read() -> Any:
            with library_errors(where, _CONTAINER):
                values = member[()]
                if values.dtype.names:
                    values = values["real"] + 1j * values["imag"]
                return values

        return StoredArray(content, member.shape, read, capacity)

    def attribute_of(self, name: str, attribute: str) -> Any:
        """Return a number or text beside a dataset or group, None where there is none."""
        return Hdf5Group(
            self._member(name), f"{self.where}: {name}", self._checked
        )._attribute_value(attribute)

    def root_attribute(self, name: str) -> Any:
        """Return a number or text beside the group itself, None where there is none."""
        return self._attribute_value(name)

    def _member(self, name: str) -> Any:
        import h5py

        with library_errors(f"{self.where}: {name}", _CONTAINER):
            link = self._group.get(name, getlink=True)
            if not isinstance(link, h5py.HardLink):
                goal = f"{getattr(link, 'filename', '')} {getattr(link, 'path', '')}".strip()
                raise InvalidInput(
                    f"{self.where}: {name!r} is a link to {goal!r}; what it points to is needed "
                    "in the file itself"
                )
            return self._group[name]

    def _check_text(self, name: str) -> None:
        import h5py

        attribute = self._group.attrs.get_id(name)
        text = h5py.check_string_dtype(attribute.dtype)
        if text is not None and text.length is None and attribute.shape is not None:
            kind = name, math.prod(attribute.shape)
            if kind not in self._checked:  # wherever they are in the file
                check_text_attribute(*_source(self._group), *kind)
                self._checked.add(kind)

    def _texts(self, dataset: Any, where: str) -> Any:
        import h5py

        with library_errors(where, _CONTAINER):
            if h5py.check_string_dtype(dataset.dtype).length is None:
                offset = dataset.id.get_offset()
                if offset is None and dataset.size:
                    raise InvalidInput(f"{where}: text in chunks; it is needed in one piece")
                check_text_dataset(*_source(dataset), offset or 0, dataset.size)
            texts = np.asarray(dataset.asstr()[()])
        return str(texts[()]) if texts.ndim == 0 else tuple(map(str, texts.ravel()))

    def _has_attribute(self, name: str) -> bool:
        with library_errors(self.where, _CONTAINER):
            return name in self._group.attrs

    def _attribute(self, name: str) -> StoredArray:
        where = f"{self.where}: attribute {name!r}"
        with library_errors(where, _CONTAINER):
            identifier = self._group.attrs.get_id(name)
            shape = identifier.shape
            content = _content(identifier.dtype)
            capacity = identifier.get_storage_size() // max(identifier.dtype.itemsize, 1)
        if shape is None:
            return StoredArray("nothing", (), _none)
        return StoredArray(content, shape, lambda: self._attribute_value(name), capacity)

    def _attribute_value(self, name: str) -> Any:
        with library_errors(f"{self.where}: attribute {name!r}", _CONTAINER):
            if name in self._group.attrs:
                self._check_text(name)
            value = self._group.attrs.get(name)
            if isinstance(value, bytes):
                return value.decode()
            if isinstance(value, np.ndarray) and value.dtype.kind in "OSU":
                return tuple(v.decode() if isinstance(v, bytes) else str(v) for v in value.ravel())
            return value


@contextmanager
def open_hdf5(path: PathLike, needed: str) -> Iterator[Hdf5Group]:
    """Open a file for reading.

    Parameters
    ----------
    needed : str
        What the file should be, in words, with a verb: ``"records are"``.

    Raises
    ------
    InvalidInput
        If there is no such file, or it is no HDF5 file or a damaged one.
    """
    import h5py

    source = Path(path)
    check_file(source)
    with library_errors(source, _CONTAINER):
        if not h5py.is_hdf5(source):
            raise InvalidInput(f"{source}: not an HDF5 file; {needed} needed")
        file = h5py.File(source, "r")
    try:
        with library_errors(source, _CONTAINER):
            layout = file.id.get_create_plist()
            if layout.get_sizes() != (LENGTHS, LENGTHS):
                raise InvalidInput(f"{source}: its lengths have not {LENGTHS} bytes, as is usual")
            check_heaps(source)
        yield Hdf5Group(file, str(source), set())
    finally:
        with library_errors(source, _CONTAINER):
            file.close()


def read_hdf5(path: PathLike, schema: ArraySchema, name: str, needed: str) -> dict[str, Any]:
    """Return what a file of one level holds.

    Parameters
    ----------
    name : str
        Name that its attribute ``schema`` must be.
    needed : str
        As in `open_hdf5`.
    """
    with open_hdf5(path, needed) as file:
        file.check_schema(name)
        return file.read(schema)


def _source(member: Any) -> tuple[Path, int]:
    """Return the file that has `member`, and what its addresses count from."""
    return Path(member.file.filename), member.file.userblock_size


def _content(dtype: Any) -> str:
    import h5py

    if h5py.check_string_dtype(dtype) is not None:
        return "text"
    if dtype.names == ("real", "imag"):  # MATLAB's
        return "complex numbers"
    return _CONTENTS.get(dtype.kind, f"elements of type {dtype}"[:60])


def _none() -> None:
    return None
