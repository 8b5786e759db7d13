"""Records as HDF5, position by position, and what files of records hold."""

import os
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from robotmodels.atomic_files import atomic_write
from robotmodels.data_files.array_schema import ArraySchema, Field
from robotmodels.data_files.hdf5_file import open_hdf5
from robotmodels.description.ranges import MOST_LENGTH
from robotmodels.errors import InvalidInput
from robotmodels.records import SIGNALS, Records, check_alike

if TYPE_CHECKING:
    import h5py

RECORDS_SCHEMA = "records/1"
NEEDED = "records are"
_GROUP = "position_"
_RUNS = ("block", "run", "period", "sample")
_COMMON = {
    "sample_time": Field(attribute=True),
    "lines": Field(("line",), "whole", least=1),
    "detection": Field(("detection line",), "whole", least=1),
}
_COORDINATES = Field(("motor",), least=-MOST_LENGTH, most=MOST_LENGTH)
# Runs that are missing have NaN, of which `Records` itself takes care.
_SIGNAL_FIELDS = {
    "torque": Field((*_RUNS, "motor"), finite=False),
    "angle": Field((*_RUNS, "output"), finite=False),
    "reference": Field(("block", "run", "period or 1", "sample", "motor")),
    "saturated": Field(("block", "run", "period", "motor"), "truth"),
}
_POSITION = ArraySchema({"position": _COORDINATES, **_SIGNAL_FIELDS})
# Of files that hold all positions in one array; HDF5 has a group for each.
RECORDS = ArraySchema(
    {
        **_COMMON,
        "positions": replace(_COORDINATES, axes=("position", "motor")),
        **{
            name: replace(field, axes=("position", *field.axes))
            for name, field in _SIGNAL_FIELDS.items()
        },
    }
)


def save_records(path: str | os.PathLike[str], parts: Iterable[Records]) -> int:
    """Write records to HDF5 position by position, as they come; return how many there were.

    Layout: attributes ``schema`` ("records/1") and ``sample_time`` [s]; datasets ``lines`` and
    ``detection``; for position i a group ``position_00000`` (i in five digits) with the datasets
    ``position`` (n,) and ``reference``, ``torque``, ``angle``, ``saturated`` as in `Records`
    without their first axis. The file appears under its name when it is complete.

    Raises
    ------
    InvalidInput
        If there are no records, or they differ in sampling, lines or shape.
    """
    import h5py

    with atomic_write(path) as unfinished, h5py.File(unfinished, "w") as file:
        return write_records(file, parts, str(path))


def write_records(file: "h5py.File", parts: Iterable[Records], where: str) -> int:
    """Write records into an open file; otherwise as `save_records`, with `where` in errors."""
    count, first = 0, None
    for records in parts:
        if first is None:
            first = records
            file.attrs["schema"] = RECORDS_SCHEMA
            file.attrs["sample_time"] = records.sample_time
            file["lines"], file["detection"] = records.lines, records.detection
        check_alike(first, records, f"{where}: position {count}")
        for i in range(len(records)):
            group = file.create_group(f"{_GROUP}{count:05d}")
            group["position"] = records.positions[i]
            for name in SIGNALS:
                group[name] = getattr(records, name)[i]
            count += 1
    if first is None:
        raise InvalidInput(f"{where}: no records to write; at least one position is needed")
    return count


def iterate_records(path: str | os.PathLike[str]) -> Iterator[Records]:
    """Read an HDF5 file position by position; each item has Q = 1.

    Raises
    ------
    InvalidInput
        Naming the file and what is wrong in it.
    """
    with open_hdf5(path, NEEDED) as file:
        file.check_schema(RECORDS_SCHEMA)
        groups = file.numbered(_GROUP)
        common = file.read(ArraySchema(_COMMON), beside=groups)
        for name in groups:
            group = file.group(name)
            signals: dict[str, Any] = {
                key: np.asarray(value)[None] for key, value in group.read(_POSITION).items()
            }
            position = signals.pop("position")
            try:
                records = Records(positions=position, **common, **signals)
            except InvalidInput as error:
                raise InvalidInput(f"{group.where}: {error}") from error
            yield records
