"""Movements: evenly sampled signals of joints, periodic or not, and their files."""

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from robotmodels.common.arrays import Array, check_above_zero, read_only, real_numbers
from robotmodels.common.atomic_files import atomic_write
from robotmodels.common.errors import InvalidInput
from robotmodels.data_files.array_schema import ArraySchema, Field
from robotmodels.data_files.file_guard import listed
from robotmodels.data_files.hdf5_file import open_hdf5

MOVEMENTS_SCHEMA = "movements/1"
_GROUP = "movement_"
_OTHERS = "others"


@dataclass(frozen=True, eq=False)
class Movement:
    """Signals of one movement, in SI units and on the joints' side of the gears.

    Attributes
    ----------
    joints : tuple of str
        Names of the motors, or of joints without, one for each column.
    sample_time : float, s
        Sample time.
    signals : mapping of str to ndarray, (N, n)
        By role, such as ``motor_angle``, ``link_angle``, ``motor_torque`` (times gear ratio),
        ``motor_current`` [A]; a joint without this signal has NaN throughout.
    others : mapping of str to ndarray, (N,)
        Accelerometers and signals of no joint, by name.
    start : float, s
        Time of the first sample on the log's clock.
    provenance : mapping
        Files with their digests, mapping, what was changed; plain data.

    Raises
    ------
    InvalidInput
        If shapes do not fit each other.
    """

    joints: tuple[str, ...]
    sample_time: float
    signals: Mapping[str, Array]
    others: Mapping[str, Array] = field(default_factory=dict)
    start: float = 0.0
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_above_zero(self.sample_time, "sample_time [s]")
        for name in ("signals", "others"):
            arrays = {
                key: read_only(real_numbers(values, key, copy=False))
                for key, values in getattr(self, name).items()
            }
            object.__setattr__(self, name, arrays)
        shapes = {values.shape for values in self.signals.values()}
        rows = {len(values) for values in (*self.signals.values(), *self.others.values())}
        if len(rows) != 1 or any(shape[1:] != (len(self.joints),) for shape in shapes):
            raise InvalidInput(
                f"movement: signals of shapes {sorted(shapes)} for {len(self.joints)} joints; "
                "(samples, joints) is needed, with one number of samples"
            )

    def __len__(self) -> int:
        return len(next(iter((*self.signals.values(), *self.others.values()))))

    @property
    def time(self) -> Array:
        """Times of the samples, (N,) [s]."""
        return np.asarray(self.start + self.sample_time * np.arange(len(self)))

    @property
    def motor_angle(self) -> Array:
        """Motor angles over gear ratios, (N, n) [rad or m]."""
        return self.signal("motor_angle")

    @property
    def link_angle(self) -> Array:
        """Angles behind the gears, (N, n) [rad or m]."""
        return self.signal("link_angle")

    @property
    def motor_torque(self) -> Array:
        """Motor torques times gear ratios, (N, n) [N m or N]."""
        return self.signal("motor_torque")

    def signal(self, role: str) -> Array:
        """Return the signals of a role, (N, n).

        Raises
        ------
        InvalidInput
            If there is none.
        """
        if role not in self.signals:
            raise InvalidInput(
                f"movement: {role} is missing (found: {listed(self.signals)}); the mapping of the "
                "log names no channel of this role"
            )
        return self.signals[role]


def save_movements(path: str | os.PathLike[str], movements: Iterable[Movement]) -> int:
    """Write movements to HDF5, one group each; return how many there were.

    Layout: attributes ``schema`` ("movements/1") and ``provenance`` (JSON); for movement i a group
    ``movement_00000`` with the attributes ``sample_time``, ``start`` [s] and ``joints``, a dataset
    (N, n) for each role, and in its group ``others`` a dataset (N,) for each other signal.

    Raises
    ------
    InvalidInput
        If there are none.
    """
    import h5py

    count = 0
    with atomic_write(path) as unfinished, h5py.File(unfinished, "w") as file:
        for movement in movements:
            if not count:
                write_header(file, movement.provenance)
            group = movement_group(file, count, movement)
            for role, values in movement.signals.items():
                group[role] = values
            for name, values in movement.others.items():
                group[_OTHERS][name] = values
            count += 1
        if not count:
            raise InvalidInput(f"{path}: no movements to write; at least one is needed")
    return count


def write_header(file: Any, provenance: Mapping[str, Any]) -> None:
    """Write the attributes of a file of movements."""
    file.attrs["schema"] = MOVEMENTS_SCHEMA
    file.attrs["provenance"] = json.dumps(provenance)


def movement_group(file: Any, number: int, movement: Any) -> Any:
    """Return a new group for a movement, or for anything with its sampling, attributes written."""
    group = file.create_group(f"{_GROUP}{number:05d}")
    group.attrs["sample_time"], group.attrs["start"] = movement.sample_time, movement.start
    group.attrs["joints"] = json.dumps(list(movement.joints))
    group.create_group(_OTHERS)
    return group


def iterate_movements(path: str | os.PathLike[str]) -> Iterator[Movement]:
    """Read what `save_movements` wrote, movement by movement.

    Raises
    ------
    InvalidInput
        Naming the file and what is wrong in it.
    """
    with open_hdf5(path, "movements are") as file:
        file.check_schema(MOVEMENTS_SCHEMA)
        provenance = _json(file.root_attribute("provenance"), f"{path}: provenance")
        for name in file.numbered(_GROUP):
            group = file.group(name)
            attributes = {
                key: group.root_attribute(key) for key in ("sample_time", "start", "joints")
            }
            roles = [each for each in group.names() if each != _OTHERS]
            two = Field(("sample", "joint"), finite=False)
            signals = group.read(ArraySchema(dict.fromkeys(roles, two)), beside=(_OTHERS,))
            inner = group.group(_OTHERS)
            one = Field(("sample",), finite=False)
            yield Movement(
                joints=tuple(map(str, _json(attributes["joints"], f"{group.where}: joints"))),
                sample_time=_number(attributes["sample_time"], f"{group.where}: sample_time"),
                signals=signals,
                others=inner.read(ArraySchema(dict.fromkeys(inner.names(), one))),
                start=_number(attributes["start"], f"{group.where}: start"),
                provenance=provenance,
            )


def _number(value: Any, where: str) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        raise InvalidInput(f"{where}: {str(value)[:40]!r}; a number is needed") from None


def _json(text: Any, where: str) -> Any:
    try:
        return json.loads(text)
    except (TypeError, ValueError):
        raise InvalidInput(f"{where}: {str(text)[:40]!r}; JSON is needed") from None
