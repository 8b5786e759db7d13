"""Periodic experiments, measured or simulated: what a controller was told, did and saw."""

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robotmodels.arrays import Array, IntArray, read_only
from robotmodels.errors import InvalidInput
from robotmodels.replacing import replacing

SCHEMA = "records/1"
_SIGNALS = ("reference", "torque", "angle", "saturated")


@dataclass(frozen=True, eq=False)
class Records:
    """Sampled periodic experiments.

    Leading axes of the signals are (Q, B, E, P, N): positions, blocks, experiments per block,
    measured periods (transients dropped), samples per period. Motors are numbered as in the robot
    file, values are on the motor shafts. An experiment that is missing has NaN in all of its
    torques and angles.

    Attributes
    ----------
    positions : (Q, n) motor angles divided by gear ratios [rad].
    sample_time : [s].
    reference : (Q, B, E, P, N, n), or with 1 for P, speed reference [rad/s].
    torque : (Q, B, E, P, N, n) as commanded, held over a sample [N m].
    angle : (Q, B, E, P, N, m) as measured; a constant part has no meaning [rad].
    lines : (F,) excited DFT lines, increasing; line k is at k / (N sample_time) Hz.
    detection : lines left out on purpose, among the odd ones; even lines are always left out.
    saturated : (Q, B, E, P, n) whether the torque met its limit.

    Raises
    ------
    InvalidInput : if shapes do not fit each other, lines are not lines, or values are not finite
        in part of an experiment.
    """

    positions: Array
    sample_time: float
    reference: Array
    torque: Array
    angle: Array
    lines: IntArray
    detection: IntArray
    saturated: Array

    def __post_init__(self) -> None:
        kinds: dict[str, Any] = {"lines": np.int64, "detection": np.int64, "saturated": np.bool_}
        for name in ("positions", *_SIGNALS, "lines", "detection"):
            array = np.asarray(getattr(self, name), dtype=kinds.get(name, np.float64))
            object.__setattr__(self, name, read_only(array))
        _check_shapes(self)
        _check_lines(self)
        _check_values(self)

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def samples(self) -> int:
        """Number N of samples per period."""
        return int(self.torque.shape[4])

    @property
    def omega(self) -> Array:
        """Excited angular frequencies, (F,) [rad/s]."""
        return np.asarray(2 * np.pi * self.lines / (self.samples * self.sample_time))

    @property
    def missing(self) -> Array:
        """Which experiments are missing, (Q, B, E)."""
        return np.asarray(np.isnan(self.torque[..., 0, 0, 0]))

    def at(self, index: int) -> "Records":
        """Return the records of one position, with Q = 1."""
        part = slice(index, index + 1) if index != -1 else slice(-1, None)
        signals: dict[str, Any] = {k: getattr(self, k)[part] for k in ("positions", *_SIGNALS)}
        return replace(self, **signals)

    @staticmethod
    def join(parts: Sequence["Records"]) -> "Records":
        """Return the records of all positions of `parts`.

        Raises
        ------
        InvalidInput : if there is no part, or parts differ in sampling, lines or shape.
        """
        if not parts:
            raise InvalidInput("records: nothing to join; at least one position is needed")
        first = parts[0]
        for i, part in enumerate(parts):
            _check_alike(first, part, f"records {i}")
        signals: dict[str, Any] = {
            name: np.concatenate([getattr(part, name) for part in parts])
            for name in ("positions", *_SIGNALS)
        }
        return replace(first, **signals)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write an HDF5 file; see `save_records`."""
        save_records(path, [self])

    @staticmethod
    def load(path: str | os.PathLike[str]) -> "Records":
        """Read what `save` or `save_records` wrote, all positions.

        Raises
        ------
        InvalidInput : naming the file and what is wrong in it.
        """
        return Records.join(list(iterate_records(path)))


def check_periods(periods: int, transient: int) -> None:
    """Refuse numbers of periods measured, and dropped before, that are none.

    Raises
    ------
    InvalidInput : if nothing is measured, or less than nothing dropped.
    """
    if periods < 1 or transient < 0:
        raise InvalidInput(f"periods: {periods} measured, {transient} dropped; at least 1 and 0")


def save_records(path: str | os.PathLike[str], parts: Iterable[Records]) -> int:
    """Write records to HDF5 position by position, as they come; return how many there were.

    Layout: attributes ``schema`` ("records/1") and ``sample_time`` [s]; datasets ``lines`` and
    ``detection``; for position i a group ``position_00000`` (i in five digits) with the datasets
    ``position`` (n,) and ``reference``, ``torque``, ``angle``, ``saturated`` as in `Records`
    without their first axis. The file appears under its name when it is complete.

    Raises
    ------
    InvalidInput : if there are no records, or they differ in sampling, lines or shape.
    """
    import h5py

    count, first = 0, None
    with replacing(path) as unfinished, h5py.File(unfinished, "w") as file:
        for records in parts:
            if first is None:
                first = records
                file.attrs["schema"] = SCHEMA
                file.attrs["sample_time"] = records.sample_time
                file["lines"], file["detection"] = records.lines, records.detection
            _check_alike(first, records, f"{path}: position {count}")
            for i in range(len(records)):
                group = file.create_group(_group(count))
                group["position"] = records.positions[i]
                for name in _SIGNALS:
                    group[name] = getattr(records, name)[i]
                count += 1
        if first is None:
            raise InvalidInput(f"{path}: no records to write; at least one position is needed")
    return count


def iterate_records(path: str | os.PathLike[str]) -> Iterator[Records]:
    """Read an HDF5 file position by position; each item has Q = 1.

    Raises
    ------
    InvalidInput : naming the file and what is wrong in it.
    """
    import h5py

    if not Path(path).is_file():
        raise InvalidInput(f"{path}: no such file; records are needed")
    if not h5py.is_hdf5(path):
        raise InvalidInput(f"{path}: not an HDF5 file; records are needed")
    with h5py.File(path, "r") as file:
        if file.attrs.get("schema") != SCHEMA:
            found = file.attrs.get("schema")
            raise InvalidInput(f"{path}: attribute 'schema' is {found!r}; {SCHEMA!r} is needed")
        common = {name: _dataset(file, name, path) for name in ("lines", "detection")}
        if "sample_time" not in file.attrs:
            raise InvalidInput(f"{path}: attribute 'sample_time' [s] is missing")
        sample_time = float(file.attrs["sample_time"])
        count = sum(name.startswith("position_") for name in file)
        for i in range(count):
            if _group(i) not in file:
                raise InvalidInput(f"{path}: group {_group(i)!r} is missing")
            group = file[_group(i)]
            signals = {name: _dataset(group, name, path)[None] for name in _SIGNALS}
            position = _dataset(group, "position", path)[None]
            try:
                yield Records(positions=position, sample_time=sample_time, **common, **signals)
            except InvalidInput as error:
                raise InvalidInput(f"{path}: {_group(i)}: {error}") from error


def _group(index: int) -> str:
    return f"position_{index:05d}"


def _dataset(group: Any, name: str, path: str | os.PathLike[str]) -> Any:
    if name not in group:
        found = ", ".join(group) or "nothing"
        raise InvalidInput(f"{path}: dataset {name!r} of {group.name} is missing (found: {found})")
    return group[name][()]


def _check_shapes(r: Records) -> None:
    if not (np.isfinite(r.sample_time) and r.sample_time > 0):
        raise InvalidInput(f"sample_time: {r.sample_time!r} s is not a positive time")
    if r.torque.ndim != 6 or 0 in r.torque.shape:
        raise InvalidInput(
            f"torque: shape {r.torque.shape} given; (positions, blocks, experiments, periods, "
            "samples, motors) is needed"
        )
    *lead, n = r.torque.shape
    axes = tuple(lead)
    needed = {
        "positions": [(axes[0], n)],
        "reference": [(*axes, n), (*axes[:3], 1, axes[4], n)],
        "angle": [(*axes, r.angle.shape[-1] if r.angle.ndim else 0)],
        "saturated": [(*axes[:4], n)],
    }
    for name, shapes in needed.items():
        found = getattr(r, name).shape
        if found not in shapes:
            raise InvalidInput(
                f"{name}: shape {found} does not fit torque {r.torque.shape}; "
                f"{' or '.join(map(str, shapes))} is needed"
            )


def _check_lines(r: Records) -> None:
    half = r.samples / 2
    for name in ("lines", "detection"):
        k = getattr(r, name)
        if k.ndim != 1 or (np.diff(k) <= 0).any() or ((k < 1) | (k >= half)).any():
            raise InvalidInput(
                f"{name}: {k.tolist()[:8]} ... must increase and lie between 1 and "
                f"{int(np.ceil(half)) - 1} for {r.samples} samples a period"
            )
    if not len(r.lines):
        raise InvalidInput("lines: none given; at least one excited line is needed")
    both = np.intersect1d(r.lines, r.detection)
    if len(both):
        raise InvalidInput(f"detection: line {both[0]} is also among the excited lines")


def _check_values(r: Records) -> None:
    _refuse(~np.isfinite(r.positions), "positions", ("position", "motor"))
    axes = ("position", "block", "experiment", "period", "sample", "motor")
    _refuse(~np.isfinite(r.reference), "reference", axes)
    torque, angle = (np.isnan(s).all(axis=(3, 4, 5)) for s in (r.torque, r.angle))
    whole = np.asarray(torque & angle)
    for name in ("torque", "angle"):
        _refuse(~np.isfinite(getattr(r, name)) & ~whole[..., None, None, None], name, axes)


def _refuse(wrong: NDArray[np.bool_], name: str, axes: tuple[str, ...]) -> None:
    if wrong.any():
        index = np.argwhere(wrong)[0]
        place = ", ".join(f"{axis} {i}" for axis, i in zip(axes, index, strict=True))
        raise InvalidInput(
            f"{name}: not a finite number at {place} (counted from 0), {int(wrong.sum())} in all; "
            "an experiment that is missing is NaN throughout, torque and angle alike"
        )


def _check_alike(first: Records, other: Records, who: str) -> None:
    if other.sample_time != first.sample_time:
        raise InvalidInput(
            f"{who}: sample time {other.sample_time:g} s, the first has {first.sample_time:g} s"
        )
    for name in ("lines", "detection"):
        if not np.array_equal(getattr(first, name), getattr(other, name)):
            raise InvalidInput(f"{who}: its {name} differ from those of the first")
    for name in ("reference", "torque", "angle"):
        shapes = getattr(first, name).shape[1:], getattr(other, name).shape[1:]
        if shapes[0] != shapes[1]:
            raise InvalidInput(f"{who}: {name} of shape {shapes[1]}, the first has {shapes[0]}")
