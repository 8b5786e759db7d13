"""Results of stages as files, bit for bit: arrays, and dataclasses of arrays and plain data."""

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from estimators.frf.file_formats import read_frf, write_frf
from estimators.frf.frf_estimate import FrfEstimate
from oed.information_sets.information_set import InformationSet
from oed.information_sets.stored_information import StoredInformation
from oed.study.stages.stage_cache import Files
from robotmodels.common.arrays import Array, read_only
from robotmodels.common.errors import InvalidInput

T = TypeVar("T")
_RESULT, _PLAIN = "result.h5", "plain data"


def write_dataclass(path: Path, value: Any) -> None:
    """Write a dataclass: arrays as datasets, dataclasses as groups, the rest as JSON."""
    import h5py

    with h5py.File(path, "w") as file:
        _write(file, value)


def read_dataclass(path: Path, kind: type[T]) -> T:
    """Read a `kind` that `write_dataclass` wrote.

    Raises
    ------
    InvalidInput
        If the file cannot be read as one.
    """
    import h5py

    try:
        with h5py.File(path, "r") as file:
            found: T = _read(file, kind)
            return found
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise InvalidInput(f"{path}: not a stored {kind.__name__} ({error})") from error


def dataclass_files(kind: type[T]) -> Files[T]:
    """Return how a dataclass is kept."""
    return Files(
        save=lambda value, folder: write_dataclass(folder / _RESULT, value),
        load=lambda folder: read_dataclass(folder / _RESULT, kind),
    )


def _save_array(value: Array, folder: Path) -> None:
    np.save(folder / "result.npy", value, allow_pickle=False)


def _load_array(folder: Path) -> Array:
    return read_only(np.load(folder / "result.npy", allow_pickle=False))


ARRAY: Files[Array] = Files(_save_array, _load_array)
INFORMATION: Files[InformationSet] = Files(
    save=lambda info, folder: info.save(folder / "information.h5"),
    load=lambda folder: InformationSet.load(folder / "information.h5"),
)
STORE = "information.store"
"""Matrices that are read in chunks, see `StoredInformation`; a computation writes it itself."""
STORED: Files[StoredInformation] = Files(
    save=lambda info, folder: None,
    load=lambda folder: StoredInformation.open(folder / STORE),
)
FRF: Files[FrfEstimate] = Files(
    save=lambda estimate, folder: write_frf(folder / "frf.h5", estimate),
    load=lambda folder: read_frf(folder / "frf.h5"),
)


def _write(group: Any, value: Any) -> None:
    plain = {}
    for field in fields(value):
        item = getattr(value, field.name)
        if not field.init:
            continue
        if isinstance(item, np.ndarray):
            group.create_dataset(field.name, data=item)
        elif is_dataclass(item):
            _write(group.create_group(field.name), item)
        elif isinstance(item, tuple) and any(map(_is_large, item)):
            _write_tuple(group.create_group(field.name), item)
        else:
            plain[field.name] = _plain(item)
    group[_PLAIN] = json.dumps(plain)  # attributes hold 64 kB at most


def _is_large(item: Any) -> bool:
    return isinstance(item, np.ndarray) or is_dataclass(item)


def _write_tuple(group: Any, items: tuple[Any, ...]) -> None:
    for i, item in enumerate(items):
        name = f"{i:05d}"
        if isinstance(item, np.ndarray):
            group[name] = item
        else:
            _write(group.create_group(name), item)


def _read(group: Any, kind: Any) -> Any:
    types = get_type_hints(kind)
    plain = json.loads(group[_PLAIN].asstr()[()])
    found: dict[str, Any] = {}
    for field in fields(kind):
        if field.name in plain:
            found[field.name] = _tuples(plain[field.name])
        elif field.name in group:
            found[field.name] = _item(group[field.name], types[field.name])
        elif field.init:
            raise ValueError(f"{field.name} is missing")
    return kind(**found)


def _item(stored: Any, annotation: Any) -> Any:
    """Return an array, a dataclass, or a tuple of arrays or dataclasses."""
    if not hasattr(stored, "keys"):
        return read_only(np.asarray(stored[()]))
    kinds = () if get_origin(annotation) is tuple else (annotation, *get_args(annotation))
    if any(map(is_dataclass, kinds)):
        return _read(stored, _dataclass_of(annotation))
    inner = next(iter(get_args(annotation)), None)
    return tuple(_item(stored[name], inner) for name in sorted(stored))


def _plain(value: Any) -> Any:
    """Return numbers of numpy, tuples and mappings as JSON knows them."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, (tuple, list)) else value


def _tuples(value: Any) -> Any:
    return tuple(_tuples(item) for item in value) if isinstance(value, list) else value


def _dataclass_of(annotation: Any) -> Any:
    """Return the dataclass in an annotation such as ``Design | None``."""
    return next(t for t in (annotation, *get_args(annotation)) if is_dataclass(t))
