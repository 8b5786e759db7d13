"""Records and FRFs as files: HDF5, MATLAB .mat and CSV, FRFs also as UFF type 58.

The ending of the path chooses the format: .h5 or .hdf5, .mat, .csv, .uff or .unv. All but UFF keep
every bit (see `format_uff` for what UFF keeps). Files appear under their names when complete.

HDF5 and .mat hold the fields of `FrfEstimate`, or of `Distortion`, as datasets (variables) of the
same names, axes and units, and ``schema``, "frf/1" or "distortion/1", as an attribute (variable).
``degrees_of_freedom`` is infinite for a declared covariance, and unknown in files without it;
``deviations`` and ``line_correlation`` may be missing. HDF5 records are laid out as
`robotmodels.records.records.save_records` says; .mat records hold the fields of `Records` and
``schema``, "records/1". For CSV see `format_csv`.
"""

import os
from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from estimators.frf.distortion import Distortion
from estimators.frf.file_schemas import (
    DISTORTION,
    DISTORTION_SCHEMA,
    FRF,
    FRF_SCHEMA,
    check_hertz,
    read_freedom,
)
from estimators.frf.frf_estimate import FrfEstimate
from robotmodels.common.arrays import Array
from robotmodels.common.atomic_files import atomic_write
from robotmodels.common.deprecation import renamed_keywords
from robotmodels.common.errors import InvalidInput, check_word
from robotmodels.data_files.array_schema import ArraySchema, Field
from robotmodels.data_files.hdf5_file import read_hdf5
from robotmodels.data_files.matlab_file import read_mat
from robotmodels.linear.noise import NoiseLaw
from robotmodels.records.record_schema import RECORDS, RECORDS_SCHEMA
from robotmodels.records.records import Records

_T = TypeVar("_T")
_LEVELS = "levels of distortion are"
PathLike = str | os.PathLike[str]


def write_frf(path: PathLike, estimate: FrfEstimate) -> None:
    """Write FRFs in the format that the ending of `path` names.

    Raises
    ------
    InvalidInput
        If the ending is unknown, or the format cannot hold the estimate.
    """
    from estimators.frf import format_csv, format_uff

    writers: dict[str, Callable[[Path, FrfEstimate], None]] = {
        ".h5": lambda p, e: _write_hdf5(p, _frf_contents(e), FRF_SCHEMA),
        ".mat": lambda p, e: _write_mat(p, _frf_contents(e), FRF_SCHEMA),
        ".csv": format_csv.write_frf,
        ".uff": format_uff.write_frf,
    }
    _write(path, estimate, writers)


def read_frf(
    path: PathLike, *, positions: Array | None = None, noise: NoiseLaw | None = None
) -> FrfEstimate:
    """Read FRFs that `write_frf` wrote, or another program's UFF file.

    Parameters
    ----------
    positions : ndarray, (Q, n), rad, optional
        Positions for UFF files that do not say them.
    noise : NoiseLaw, optional
        Law of the errors for UFF files that do not hold variances.

    Raises
    ------
    InvalidInput
        Naming the file and what is wrong in it.
    """
    from estimators.frf import format_csv, format_uff

    readers: dict[str, Callable[[Path], FrfEstimate]] = {
        ".h5": lambda p: _estimate(read_hdf5(p, FRF, FRF_SCHEMA, "FRFs are")),
        ".mat": lambda p: _estimate(_mat_frf(p, FRF, FRF_SCHEMA)),
        ".csv": format_csv.read_frf,
        ".uff": lambda p: format_uff.read_frf(p, positions, noise),
    }
    return _read(path, readers)


def write_records(path: PathLike, records: Records) -> None:
    """Write records in the format that the ending of `path` names.

    Raises
    ------
    InvalidInput
        If the ending is unknown.
    """
    from estimators.frf import format_csv

    writers: dict[str, Callable[[Path, Records], None]] = {
        ".h5": lambda p, r: r.save(p),
        ".mat": lambda p, r: _write_mat(p, _contents(r), RECORDS_SCHEMA),
        ".csv": format_csv.write_records,
    }
    _write(path, records, writers)


def read_records(path: PathLike) -> Records:
    """Read records that `write_records`, or `Records.save`, wrote.

    Raises
    ------
    InvalidInput
        Naming the file and what is wrong in it.
    """
    from estimators.frf import format_csv

    readers: dict[str, Callable[[Path], Records]] = {
        ".h5": Records.load,
        ".mat": lambda p: Records(**read_mat(p, RECORDS, RECORDS_SCHEMA)),
        ".csv": format_csv.read_records,
    }
    return _read(path, readers)


@renamed_keywords("0.2", found="distortion")
def write_distortion(path: PathLike, distortion: Distortion) -> None:
    """Write distortion levels to HDF5 or .mat."""
    schema = DISTORTION_SCHEMA
    writers: dict[str, Callable[[Path, Distortion], None]] = {
        ".h5": lambda p, d: _write_hdf5(p, _contents(d), schema),
        ".mat": lambda p, d: _write_mat(p, _contents(d), schema),
    }
    _write(path, distortion, writers)


def read_distortion(path: PathLike) -> Distortion:
    """Read what `write_distortion` wrote.

    Raises
    ------
    InvalidInput
        Naming the file and what is wrong in it.
    """
    readers: dict[str, Callable[[Path], Distortion]] = {
        ".h5": lambda p: Distortion(**read_hdf5(p, DISTORTION, DISTORTION_SCHEMA, _LEVELS)),
        ".mat": lambda p: Distortion(**_mat_frf(p, DISTORTION, DISTORTION_SCHEMA)),
    }
    return _read(path, readers)


def _kind(path: PathLike, endings: Mapping[str, Any]) -> str:
    suffix = Path(path).suffix.lower()
    suffix = {".hdf5": ".h5", ".unv": ".uff"}.get(suffix, suffix)
    check_word(f"{path}: ending", suffix, endings)
    return suffix


def _write(path: PathLike, value: _T, writers: Mapping[str, Callable[[Path, _T], None]]) -> None:
    write = writers[_kind(path, writers)]
    with atomic_write(path) as unfinished:
        write(unfinished, value)


def _read(path: PathLike, readers: Mapping[str, Callable[[Path], _T]]) -> _T:
    read = readers[_kind(path, readers)]
    try:
        return read(Path(path))
    except InvalidInput as error:
        if str(error).startswith(str(path)):
            raise
        raise InvalidInput(f"{path}: {error}") from error


def _contents(value: Any) -> dict[str, Any]:
    contents = {field.name: getattr(value, field.name) for field in fields(value)}
    return {name: one for name, one in contents.items() if one is not None}


def _frf_contents(estimate: FrfEstimate) -> dict[str, Any]:
    """Return the fields of an estimate that hold something."""
    contents = _contents(estimate)
    empty = [k for k in ("deviations", "line_correlation") if not np.size(contents.get(k, ()))]
    return {name: value for name, value in contents.items() if name not in empty}


def _estimate(contents: dict[str, Any]) -> FrfEstimate:
    """Return an estimate; files that say nothing of degrees of freedom leave them unknown."""
    freedom = contents.pop("degrees_of_freedom", None)
    count = len(contents["positions"])
    return FrfEstimate(**contents, degrees_of_freedom=read_freedom(freedom, count))


def _write_hdf5(path: Path, contents: Mapping[str, Any], schema: str) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        file.attrs["schema"] = schema
        for name, value in contents.items():
            file[name] = value


def _write_mat(path: Path, contents: Mapping[str, Any], schema: str) -> None:
    from scipy.io import savemat

    variables = dict(contents) | {"schema": schema}
    if "omega" in contents:
        variables["frequency_hz"] = np.asarray(contents["omega"]) / (2 * np.pi)
    try:
        savemat(path, variables, appendmat=False, do_compression=True)
    except ValueError as error:
        raise InvalidInput(f"{path}: too large for .mat ({error}); write .h5 instead") from None


def _mat_frf(path: Path, schema: ArraySchema, name: str) -> dict[str, Any]:
    """Read arrays over frequencies, which are told in Hz as well."""
    hertz = {"frequency_hz": Field(("frequency",), optional=True)}
    contents = read_mat(path, ArraySchema({**schema.fields, **hertz}), name)
    if "frequency_hz" in contents:
        check_hertz(contents.pop("frequency_hz"), contents["omega"], path)
    return contents
