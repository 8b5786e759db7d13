"""Records and FRFs as files: HDF5, MATLAB .mat and CSV, FRFs also as UFF type 58.

The ending of the path chooses the format: .h5 or .hdf5, .mat, .csv, .uff or .unv. All but UFF keep
every bit (see `exchange_uff` for what UFF keeps). Files appear under their names when complete.

HDF5 and .mat hold the fields of `FrfEstimate`, or of `Distortion`, as datasets (variables) of the
same names, axes and units, and ``schema``, "frf/1" or "distortion/1", as an attribute (variable).
HDF5 records are laid out as `robotmodels.records.save_records` says; .mat records hold the fields
of `Records` and ``schema``, "records/1". For CSV see `exchange_csv`.
"""

import os
from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from estimators.frf.distortion import Distortion
from estimators.frf.estimate import FrfEstimate
from robotmodels.arrays import Array
from robotmodels.errors import InvalidInput
from robotmodels.files import reason
from robotmodels.noise import RelativeNoise
from robotmodels.records import Records
from robotmodels.replacing import replacing

_T = TypeVar("_T")
PathLike = str | os.PathLike[str]
FRF_SCHEMA, RECORDS_SCHEMA, DISTORTION_SCHEMA = "frf/1", "records/1", "distortion/1"
# MATLAB drops trailing axes of length one, and has no vectors.
_FRF_AXES = {"positions": 2, "omega": 1, "response": 4, "covariance": 4, "repetitions": 1}
_RECORD_AXES = {
    "positions": 2,
    "reference": 6,
    "torque": 6,
    "angle": 6,
    "lines": 1,
    "detection": 1,
    "saturated": 5,
}


def write_frf(path: PathLike, estimate: FrfEstimate) -> None:
    """Write FRFs in the format that the ending of `path` names.

    Raises
    ------
    InvalidInput : if the ending is unknown, or the format cannot hold the estimate.
    """
    from estimators.frf import exchange_csv, exchange_uff

    writers: dict[str, Callable[[Path, FrfEstimate], None]] = {
        ".h5": lambda p, e: _write_hdf5(p, _contents(e), FRF_SCHEMA),
        ".mat": lambda p, e: _write_mat(p, _contents(e), FRF_SCHEMA),
        ".csv": exchange_csv.write_frf,
        ".uff": exchange_uff.write_frf,
    }
    write = writers[_kind(path, writers)]
    with replacing(path) as unfinished:
        write(unfinished, estimate)


def read_frf(
    path: PathLike, *, positions: Array | None = None, noise: RelativeNoise | None = None
) -> FrfEstimate:
    """Read FRFs that `write_frf` wrote, or another program's UFF file.

    Parameters
    ----------
    positions : (Q, n) for UFF files that do not say them [rad].
    noise : law of the errors for UFF files that do not hold variances.

    Raises
    ------
    InvalidInput : naming the file and what is wrong in it.
    """
    from estimators.frf import exchange_csv, exchange_uff

    readers: dict[str, Callable[[Path], FrfEstimate]] = {
        ".h5": lambda p: FrfEstimate(**_read_hdf5(p, _FRF_AXES, FRF_SCHEMA)),
        ".mat": lambda p: FrfEstimate(**_read_mat(p, _FRF_AXES, FRF_SCHEMA)),
        ".csv": exchange_csv.read_frf,
        ".uff": lambda p: exchange_uff.read_frf(p, positions, noise),
    }
    return _read(path, readers)


def write_records(path: PathLike, records: Records) -> None:
    """Write records in the format that the ending of `path` names.

    Raises
    ------
    InvalidInput : if the ending is unknown.
    """
    from estimators.frf import exchange_csv

    writers: dict[str, Callable[[Path, Records], None]] = {
        ".h5": lambda p, r: r.save(p),
        ".mat": lambda p, r: _write_mat(p, _contents(r), RECORDS_SCHEMA),
        ".csv": exchange_csv.write_records,
    }
    write = writers[_kind(path, writers)]
    with replacing(path) as unfinished:
        write(unfinished, records)


def read_records(path: PathLike) -> Records:
    """Read records that `write_records`, or `Records.save`, wrote.

    Raises
    ------
    InvalidInput : naming the file and what is wrong in it.
    """
    from estimators.frf import exchange_csv

    readers: dict[str, Callable[[Path], Records]] = {
        ".h5": Records.load,
        ".mat": _mat_records,
        ".csv": exchange_csv.read_records,
    }
    return _read(path, readers)


def write_distortion(path: PathLike, found: Distortion) -> None:
    """Write distortion levels to HDF5 or .mat."""
    writers = {".h5": _write_hdf5, ".mat": _write_mat}
    write = writers[_kind(path, writers)]
    with replacing(path) as unfinished:
        write(unfinished, _contents(found), DISTORTION_SCHEMA)


def read_distortion(path: PathLike) -> Distortion:
    """Read what `write_distortion` wrote.

    Raises
    ------
    InvalidInput : naming the file and what is wrong in it.
    """
    axes = dict.fromkeys(("noise", "total"), 4)
    axes |= dict.fromkeys(("output", "odd", "even"), 3)
    axes |= dict.fromkeys(("odd_noise", "even_noise", "odd_raw", "even_raw"), 3)
    axes |= {"positions": 2, "omega": 1, "odd_omega": 1, "even_omega": 1, "blocks": 1}
    readers: dict[str, Callable[[Path], Distortion]] = {
        ".h5": lambda p: Distortion(**_read_hdf5(p, axes, DISTORTION_SCHEMA)),
        ".mat": lambda p: Distortion(**_read_mat(p, axes, DISTORTION_SCHEMA)),
    }
    return _read(path, readers)


def _kind(path: PathLike, known: Mapping[str, Any]) -> str:
    suffix = Path(path).suffix.lower()
    suffix = {".hdf5": ".h5", ".unv": ".uff"}.get(suffix, suffix)
    if suffix not in known:
        raise InvalidInput(f"{path}: ending {suffix!r} is none of {', '.join(known)}")
    return suffix


def _read(path: PathLike, readers: Mapping[str, Callable[[Path], _T]]) -> _T:
    read = readers[_kind(path, readers)]
    if not Path(path).is_file():
        raise InvalidInput(f"{path}: no such file")
    try:
        return read(Path(path))
    except InvalidInput as error:
        if str(error).startswith(str(path)):
            raise
        raise InvalidInput(f"{path}: {error}") from error


def _contents(value: Any) -> dict[str, Any]:
    return {field.name: getattr(value, field.name) for field in fields(value)}


def _write_hdf5(path: Path, contents: Mapping[str, Any], schema: str) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        file.attrs["schema"] = schema
        for name, value in contents.items():
            file[name] = value


def _read_hdf5(path: Path, axes: Mapping[str, int], schema: str) -> dict[str, Any]:
    import h5py

    if not h5py.is_hdf5(path):
        raise InvalidInput("not an HDF5 file")
    with h5py.File(path, "r") as file:
        _check_schema(file.attrs.get("schema"), schema)
        _check_names(file, axes)
        return {name: file[name][()] for name in axes}


def _write_mat(path: Path, contents: Mapping[str, Any], schema: str) -> None:
    from scipy.io import savemat

    variables = dict(contents) | {"schema": schema}
    if "omega" in contents:
        variables["frequency_hz"] = np.asarray(contents["omega"]) / (2 * np.pi)
    try:
        savemat(path, variables, appendmat=False, do_compression=True)
    except ValueError as error:
        raise InvalidInput(f"{path}: too large for .mat ({error}); write .h5 instead") from None


def _read_mat(path: Path, axes: Mapping[str, int], schema: str) -> dict[str, Any]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        found = loadmat(path, appendmat=False)
    except NotImplementedError:
        raise InvalidInput("a MATLAB 7.3 file; save it with -v7, or as HDF5") from None
    except (ValueError, OSError, MatReadError) as error:
        raise InvalidInput(f"not a MATLAB file ({reason(error)})") from None
    if "schema" in found:
        _check_schema("".join(np.ravel(found["schema"])[:1]), schema)
    _check_names(found, {"schema": 0, **axes})
    return {name: _with_axes(found[name], count) for name, count in axes.items()}


def _mat_records(path: Path) -> Records:
    axes = _RECORD_AXES | {"sample_time": 0}
    contents = _read_mat(path, axes, RECORDS_SCHEMA)
    contents["sample_time"] = float(contents["sample_time"])
    return Records(**contents)


def _with_axes(array: Any, count: int) -> Any:
    """Give an array the axes it had before MATLAB's conventions."""
    if count < 2:
        flat = np.ravel(array)
        return flat[0] if count == 0 and flat.size == 1 else flat
    return np.reshape(array, array.shape + (1,) * (count - array.ndim))


def _check_schema(found: object, needed: str) -> None:
    if found != needed:
        raise InvalidInput(f"'schema' is {found!r}; {needed!r} is needed")


def _check_names(found: Any, names: Mapping[str, int]) -> None:
    missing = [repr(name) for name in names if name not in found]
    if missing:
        there = ", ".join(k for k in found if not k.startswith("__")) or "nothing"
        are = "is" if len(missing) == 1 else "are"
        raise InvalidInput(f"{', '.join(missing)} {are} missing (found: {there})")
