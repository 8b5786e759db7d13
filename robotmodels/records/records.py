"""Periodic runs, measured or simulated: what a controller was told, did and saw."""

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from robotmodels.common.arrays import (
    Array,
    IntArray,
    check_above_zero,
    read_only,
    real_numbers,
    truth_values,
    whole_numbers,
)
from robotmodels.common.atomic_files import atomic_write
from robotmodels.common.errors import InvalidInput
from robotmodels.data_files.array_schema import ArraySchema
from robotmodels.data_files.hdf5_file import open_hdf5
from robotmodels.records.record_schema import (
    _COMMON,
    _COORDINATES,
    _SIGNAL_FIELDS,
    NEEDED,
    RECORDS_SCHEMA,
)

if TYPE_CHECKING:
    import h5py


SIGNALS = ("reference", "torque", "angle", "saturated")


@dataclass(frozen=True, eq=False)
class Records:
    """Sampled periodic runs.

    Leading axes of the signals are (Q, B, E, P, N): positions, blocks, runs per block,
    measured periods (transients dropped), samples per period. Motors are numbered as in the robot
    file, values are on the motor shafts. A run that is missing has NaN in all of its
    torques and angles.

    Attributes
    ----------
    positions : ndarray, (Q, n), rad
        Motor angles divided by gear ratios.
    sample_time : float, s
        Sample time.
    reference : ndarray, rad/s
        (Q, B, E, P, N, n), or with 1 for P, speed reference.
    torque : ndarray, (Q, B, E, P, N, n), N m
        As commanded, held over a sample; as measured at the samples where there is `command` too.
    angle : ndarray, (Q, B, E, P, N, m), rad
        Outputs as measured, by default motor angles; a constant part has no meaning. See
        `robotmodels.description.outputs` for others and their units.
    lines : ndarray of int, (F,)
        Excited DFT lines, increasing; line k is at k / (N sample_time) Hz.
    detection : ndarray of int
        Lines left out on purpose, among the odd ones; even lines are always left out.
    saturated : ndarray, (Q, B, E, P, n)
        Whether the torque met its limit.
    derivatives : ndarray of int, (m,)
        Times by which FRFs differentiate the outputs, 0 to 2; by default twice, angles to
        accelerations.
    command : ndarray or None, (Q, B, E, P, N, n), N m
        Commanded torques, held over a sample, beside measured ones.

    Raises
    ------
    InvalidInput
        If shapes do not fit each other, lines are not lines, or values are not finite in part of a
        run.
    """

    positions: Array
    sample_time: float
    reference: Array
    torque: Array
    angle: Array
    lines: IntArray
    detection: IntArray
    saturated: Array
    derivatives: IntArray = None  # type: ignore[assignment]
    command: Array | None = None

    def __post_init__(self) -> None:
        for name in ("positions", *self.signals):
            if name == "saturated":
                continue
            signal = real_numbers(getattr(self, name), name, copy=False)
            object.__setattr__(self, name, read_only(signal))
        for name in ("lines", "detection"):
            object.__setattr__(self, name, read_only(whole_numbers(getattr(self, name), name)))
        orders = 2 if self.derivatives is None else self.derivatives
        derivatives = whole_numbers(orders, "derivatives")
        if (derivatives == 2).all() and self.angle.ndim:  # of however many outputs
            derivatives = np.full(self.angle.shape[-1], 2)
        object.__setattr__(self, "derivatives", read_only(derivatives))
        saturated = truth_values(self.saturated, "saturated")
        object.__setattr__(self, "saturated", read_only(saturated))
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
        """Which runs are missing, (Q, B, E)."""
        return np.asarray(np.isnan(self.torque[..., 0, 0, 0]))

    @property
    def signals(self) -> tuple[str, ...]:
        """Names of the arrays with an axis of positions and one of runs."""
        return SIGNALS if self.command is None else (*SIGNALS, "command")

    @property
    def commanded(self) -> bool:
        """Whether torques are as commanded, so that they are held over a sample."""
        return self.command is None

    def at(self, index: int) -> "Records":
        """Return the records of one position, with Q = 1."""
        part = slice(index, index + 1) if index != -1 else slice(-1, None)
        signals: dict[str, Any] = {k: getattr(self, k)[part] for k in ("positions", *self.signals)}
        return replace(self, **signals)

    @staticmethod
    def join(parts: Sequence["Records"]) -> "Records":
        """Return the records of all positions of `parts`.

        Raises
        ------
        InvalidInput
            If there is no part, or parts differ in sampling, lines or shape.
        """
        if not parts:
            raise InvalidInput("records: nothing to join; at least one position is needed")
        first = parts[0]
        for i, part in enumerate(parts):
            check_alike(first, part, f"records {i}")
        signals: dict[str, Any] = {
            name: np.concatenate([getattr(part, name) for part in parts])
            for name in ("positions", *first.signals)
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
        InvalidInput
            Naming the file and what is wrong in it.
        """
        return Records.join(list(iterate_records(path)))


def check_periods(periods: int, transient: int) -> None:
    """Refuse numbers of periods measured, and dropped before, that are none.

    Raises
    ------
    InvalidInput
        If nothing is measured, or less than nothing dropped.
    """
    if periods < 1 or transient < 0:
        raise InvalidInput(f"periods: {periods} measured, {transient} dropped; at least 1 and 0")


def _check_shapes(r: Records) -> None:
    check_above_zero(r.sample_time, "sample_time [s]")
    if r.torque.ndim != 6 or 0 in r.torque.shape:
        raise InvalidInput(
            f"torque: shape {r.torque.shape} given; (positions, blocks, runs, periods, "
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
    if r.command is not None:
        needed["command"] = [r.torque.shape]
    for name, shapes in needed.items():
        shape = getattr(r, name).shape
        if shape not in shapes:
            raise InvalidInput(
                f"{name}: shape {shape} does not fit torque {r.torque.shape}; "
                f"{' or '.join(map(str, shapes))} is needed"
            )

    derivatives = r.derivatives
    if derivatives.shape != r.angle.shape[-1:] or not np.isin(derivatives, (0, 1, 2)).all():
        raise InvalidInput(
            f"derivatives: {derivatives.tolist()}; 0, 1 or 2 for each of the "
            f"{r.angle.shape[-1]} outputs is needed"
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
    axes = ("position", "block", "run", "period", "sample", "motor")
    _refuse(~np.isfinite(r.reference), "reference", axes)
    torque, angle = (np.isnan(s).all(axis=(3, 4, 5)) for s in (r.torque, r.angle))
    whole = np.asarray(torque & angle)
    for name in r.signals[1:3] + r.signals[4:]:  # torque, angle and command
        _refuse(~np.isfinite(getattr(r, name)) & ~whole[..., None, None, None], name, axes)


def _refuse(wrong: NDArray[np.bool_], name: str, axes: tuple[str, ...]) -> None:
    if wrong.any():
        index = np.argwhere(wrong)[0]
        location = ", ".join(f"{axis} {i}" for axis, i in zip(axes, index, strict=True))
        raise InvalidInput(
            f"{name}: not a finite number at {location} (from 0), {int(wrong.sum())} in all; "
            "a run that is missing is NaN throughout, torque and angle alike"
        )


def check_alike(first: Records, other: Records, who: str) -> None:
    """Refuse records that differ from the first in sampling, lines or shape.

    Parameters
    ----------
    who : str
        Names them in errors.
    """
    if other.sample_time != first.sample_time:
        raise InvalidInput(
            f"{who}: sample time {other.sample_time:g} s, the first has {first.sample_time:g} s"
        )
    for name in ("lines", "detection", "derivatives"):
        if not np.array_equal(getattr(first, name), getattr(other, name)):
            raise InvalidInput(f"{who}: its {name} differ from those of the first")
    if first.commanded != other.commanded:
        raise InvalidInput(f"{who}: commands beside measured torques in one, not in the first")
    for name in ("reference", "torque", "angle"):
        shapes = getattr(first, name).shape[1:], getattr(other, name).shape[1:]
        if shapes[0] != shapes[1]:
            raise InvalidInput(f"{who}: {name} of shape {shapes[1]}, the first has {shapes[0]}")


_GROUP = "position_"
_POSITION = ArraySchema({"position": _COORDINATES, **_SIGNAL_FIELDS})


def save_records(path: str | os.PathLike[str], parts: Iterable[Records]) -> int:
    """Write records to HDF5 position by position, as they come; return how many there were.

    Layout: attributes ``schema`` ("records/1") and ``sample_time`` [s]; datasets ``lines``,
    ``detection`` and ``derivatives``; for position i a group ``position_00000`` (i in five digits)
    with the datasets ``position`` (n,) and ``reference``, ``torque``, ``angle``, ``saturated`` and
    perhaps ``command`` as in `Records` without their first axis. The file appears under its name
    when it is complete.

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
            for name in ("lines", "detection", "derivatives"):
                file[name] = getattr(records, name)
        check_alike(first, records, f"{where}: position {count}")
        for i in range(len(records)):
            group = file.create_group(f"{_GROUP}{count:05d}")
            group["position"] = records.positions[i]
            for name in records.signals:
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
