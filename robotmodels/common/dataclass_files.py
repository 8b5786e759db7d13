"""Dataclasses of arrays and plain data as HDF5 files, bit for bit.

Each array is a dataset, whose path is that of its field. The dataset ``plain data`` holds JSON:
``content``, all else, ``shapes`` of the arrays and the ``fingerprint`` of the whole. A file is read
only as it was written, and only as the dataclass that is asked for, the type of every field
included.
"""

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from robotmodels.common.arrays import read_only
from robotmodels.common.errors import InvalidInput
from robotmodels.common.fingerprints import fingerprint
from robotmodels.common.plain_data import split_arrays

T = TypeVar("T")
_PLAIN = "plain data"
# A number of a field may come as one that needs less room, such as an integer for a float.
_ARRAYS = {np.bool_: "b", np.int64: "iu", np.float64: "biuf", np.complex128: "biufc"}
_NUMBERS: dict[type, tuple[type, ...]] = {float: (float, int), int: (int,), bool: (bool,)}


def write_dataclass(path: Path, value: Any) -> None:
    """Write a dataclass.

    Raises
    ------
    TypeError
        If a field is neither plain data nor an array, nor made of such.
    """
    import h5py

    plain, arrays = split_arrays(value)
    header = {
        "content": plain,
        "shapes": {name: array.shape for name, array in arrays.items()},
        "fingerprint": fingerprint(value),
    }
    with h5py.File(path, "w") as file:
        for name, array in arrays.items():
            file[name] = array
        file[_PLAIN] = json.dumps(header)  # attributes hold 64 kB at most


def read_dataclass(path: Path, kind: type[T]) -> T:
    """Read a `kind` that `write_dataclass` wrote.

    Raises
    ------
    InvalidInput
        If the file cannot be read as one, or is not as it was written.
    """
    import h5py

    try:
        with h5py.File(path, "r") as file:
            header = json.loads(file[_PLAIN].asstr()[()])
            value: T = _Reader(file, header["shapes"]).value(header["content"], kind, "")
        if fingerprint(value) != header["fingerprint"]:
            raise ValueError("its content is not what was written")
        return value
    except (OSError, KeyError, TypeError, ValueError, RecursionError, InvalidInput) as error:
        raise InvalidInput(f"{path}: not a stored {kind.__name__} ({error})") from error


class _Reader:
    """What is stored in an open file, as the types that a dataclass asks for."""

    def __init__(self, file: Any, shapes: Mapping[str, list[int]]) -> None:
        self.file = file
        self.shapes = shapes

    def value(self, plain: Any, kind: Any, path: str) -> Any:
        """Return plain data as a `kind`; `path` leads to it from the outermost dataclass.

        Raises
        ------
        ValueError
            If they are none.
        """
        origin, inner = get_origin(kind), get_args(kind)
        if origin in (Union, UnionType):
            return self._alternative(plain, inner, path)
        if kind is np.ndarray or origin is np.ndarray:
            return self._array(kind, path)
        if is_dataclass(kind):
            return self._dataclass(plain, kind, path)
        if origin is tuple and type(plain) is list:
            kinds = inner[:1] * len(plain) if inner[1:] == (...,) else inner
            pairs = enumerate(zip(plain, kinds, strict=True))
            return tuple(self.value(item, one, f"{path}/{i:05d}") for i, (item, one) in pairs)
        if isinstance(origin, type) and issubclass(origin, Mapping) and type(plain) is dict:
            return {key: self.value(item, inner[1], f"{path}/{key}") for key, item in plain.items()}
        if not (
            plain in inner if origin is Literal else type(plain) in _NUMBERS.get(kind, (kind,))
        ):
            raise ValueError(f"{path} is no {getattr(kind, '__name__', kind)}")
        return plain

    def _alternative(self, plain: Any, kinds: tuple[Any, ...], path: str) -> Any:
        """Return plain data as the first of the kinds that they fit."""
        if plain is None and NoneType in kinds:
            return None
        *others, last = (kind for kind in kinds if kind is not NoneType)
        for kind in others:
            try:
                return self.value(plain, kind, path)
            except ValueError:
                continue
        return self.value(plain, last, path)

    def _array(self, kind: Any, path: str) -> Any:
        """Return an array, whose size and type are looked at before it is read."""
        dtype = get_args(get_args(kind)[1])[0] if get_args(kind) else np.complex128
        stored = self.file.get(path)
        if stored is None or list(getattr(stored, "shape", None) or ()) != self.shapes.get(path):
            raise ValueError(f"{path} is not the array that was written")
        if stored.dtype.kind not in _ARRAYS[dtype]:
            raise ValueError(f"{path} is no array of {dtype.__name__}")
        return read_only(np.asarray(stored[()]))

    def _dataclass(self, plain: Any, kind: Any, path: str) -> Any:
        if type(plain) is not list or len(plain) != 2 or type(plain[1]) is not dict:
            raise ValueError(f"{path or 'the file'} is no {kind.__name__}")
        name, content = plain
        if name != kind.__name__:
            raise ValueError(f"{path or 'the file'} is a {name}")
        types, prefix = get_type_hints(kind), f"{path}/" if path else ""
        names = [field.name for field in fields(kind) if field.init]
        missing = [name for name in names if name not in content]
        if missing:
            raise ValueError(f"{prefix}{missing[0]} is missing")
        return kind(
            **{name: self.value(content[name], types[name], f"{prefix}{name}") for name in names}
        )
