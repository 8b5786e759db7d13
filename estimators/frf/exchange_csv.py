"""Records and FRFs as text: one table a file, below comments that say what it holds.

Comments are ``# key: JSON``. Numbers have 17 digits, so every bit survives. Positions, blocks,
outputs and so on are counted from 0.

FRFs: comments ``schema`` "frf/1", ``positions`` (Q, n) [rad], ``repetitions`` (Q,). Columns
position, omega [rad/s], frequency_hz, output, input, re, im, and ``variance`` or, for full
covariances, the row of the covariance matrix that belongs to the element, ``covariance_re_0``,
``covariance_im_0``, ``covariance_re_1``, ... in the order of vec(G), columns stacked.

Records: comments ``schema`` "records/1", ``sample_time`` [s], ``positions``, ``lines``,
``detection`` and ``axes``, how many positions, blocks, experiments, periods and samples there are
and, last, 1 if the reference was given for one period only, else the number of periods. Columns
position, block, experiment, period, sample, reference_0 ..., torque_0 ..., angle_0 ...,
saturated_0 ...; the last index varies fastest. A missing experiment's torques and angles are nan.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.frf.estimate import FrfEstimate, unvec, vec
from robotmodels.arrays import Array
from robotmodels.errors import InvalidInput
from robotmodels.records import Records

_FRF_COLUMNS = ("position", "omega", "frequency_hz", "output", "input", "re", "im")
_RECORD_INDEX = ("position", "block", "experiment", "period", "sample")
_SIGNALS = ("reference", "torque", "angle", "saturated")


def write_frf(path: Path, estimate: FrfEstimate) -> None:
    """Write FRFs; rows run over positions, frequencies, inputs and outputs, outputs fastest."""
    Q, F, m, n = estimate.response.shape
    q, f, column, row = (a.ravel() for a in np.indices((Q, F, n, m)))
    G = vec(estimate.response).ravel()
    omega = estimate.omega[f]
    table = [q, omega, omega / (2 * np.pi), row, column, G.real, G.imag]
    names = [*_FRF_COLUMNS]
    if estimate.has_full_covariance:
        covariance = estimate.covariance.reshape(len(q), -1)
        for k, entry in enumerate(covariance.T):
            table += [entry.real, entry.imag]
            names += [f"covariance_re_{k}", f"covariance_im_{k}"]
    else:
        table.append(vec(estimate.covariance).ravel())
        names.append("variance")
    comments = {
        "schema": "frf/1",
        "positions": estimate.positions.tolist(),
        "repetitions": estimate.repetitions.tolist(),
    }
    _write(path, comments, names, np.stack(table, axis=1))


def read_frf(path: Path) -> FrfEstimate:
    """Read what `write_frf` wrote."""
    comments, names, table = _load(path, "frf/1", ("positions", "repetitions"))
    full = any(name.startswith("covariance_") for name in names)
    _check_columns(names, _FRF_COLUMNS if full else (*_FRF_COLUMNS, "variance"))
    position, omega, _, row, column, re, im = table[:, :7].T
    Q, m, n = len(comments["positions"]), int(row.max()) + 1, int(column.max()) + 1
    F = len(table) // (Q * m * n)
    shape = (Q, F, n, m)
    _check_grid(np.stack([position, column, row], axis=1), shape, (0, 2, 3))
    response = unvec((re + 1j * im).reshape(Q, F, n * m), m)
    if full:
        covariance = table[:, 7::2] + 1j * table[:, 8::2]
        if covariance.shape[1] != m * n:
            raise InvalidInput(
                f"{covariance.shape[1]} covariance columns; {m * n} are needed for {m} outputs and "
                f"{n} inputs"
            )
        errors: NDArray[Any] = covariance.reshape(Q, F, m * n, m * n)
    else:
        errors = unvec(table[:, 7].reshape(Q, F, n * m), m)
    lines = omega.reshape(Q, F, n * m)
    if (lines != lines[:1, :, :1]).any():
        raise InvalidInput("omega: rows of one frequency, or positions, differ in it")
    return FrfEstimate(
        np.array(comments["positions"], dtype=float),
        lines[0, :, 0],
        response,
        errors,
        np.array(comments["repetitions"]),
    )


def write_records(path: Path, records: Records) -> None:
    """Write records, one row a sample."""
    axes = records.torque.shape[:5]
    signals = [
        np.broadcast_to(signal, (*axes, signal.shape[-1])).reshape(int(np.prod(axes)), -1)
        for signal in (
            records.reference,
            records.torque,
            records.angle,
            records.saturated[:, :, :, :, None],
        )
    ]
    index = np.indices(axes).reshape(5, -1).T
    names = [*_RECORD_INDEX]
    for name, signal in zip(_SIGNALS, signals, strict=True):
        names += [f"{name}_{i}" for i in range(signal.shape[1])]
    comments = {
        "schema": "records/1",
        "sample_time": records.sample_time,
        "positions": records.positions.tolist(),
        "lines": records.lines.tolist(),
        "detection": records.detection.tolist(),
        "axes": [*axes, records.reference.shape[3]],
    }
    _write(path, comments, names, np.hstack([index, *signals]))


def read_records(path: Path) -> Records:
    """Read what `write_records` wrote."""
    needed = ("sample_time", "positions", "lines", "detection", "axes")
    comments, names, table = _load(path, "records/1", needed)
    _check_columns(names, _RECORD_INDEX)
    *axes, reference_periods = (int(a) for a in comments["axes"])
    _check_grid(table[:, :5], axes, range(5))
    signals = {}
    for name in _SIGNALS:
        columns = [i for i, column in enumerate(names) if column.startswith(f"{name}_")]
        if not columns:
            raise InvalidInput(f"column '{name}_0' is missing (found: {', '.join(names)})")
        signals[name] = table[:, columns].reshape(*axes, len(columns))
    return Records(
        positions=np.array(comments["positions"], dtype=float),
        sample_time=float(comments["sample_time"]),
        reference=signals["reference"][:, :, :, :reference_periods],
        torque=signals["torque"],
        angle=signals["angle"],
        lines=np.array(comments["lines"], dtype=np.int64),
        detection=np.array(comments["detection"], dtype=np.int64),
        saturated=signals["saturated"].max(axis=4),
    )


def _write(path: Path, comments: dict[str, Any], names: Sequence[str], table: Array) -> None:
    with path.open("w", encoding="utf-8", newline="\n") as file:
        for key, value in comments.items():
            file.write(f"# {key}: {json.dumps(value)}\n")
        file.write(",".join(names) + "\n")
        np.savetxt(file, table, fmt="%.17g", delimiter=",")


def _load(
    path: Path, schema: str, needed: Sequence[str]
) -> tuple[dict[str, Any], list[str], Array]:
    """Return the comments, the names of the columns and the table."""
    comments: dict[str, Any] = {}
    names: list[str] = []
    try:
        with path.open(encoding="utf-8") as file:
            for line in file:
                if not line.startswith("#"):
                    names = [name.strip() for name in line.split(",")]
                    break
                key, _, value = line[1:].partition(":")
                comments[key.strip()] = json.loads(value)
            rows = [row for row in file if row.strip()]
        table = (
            np.loadtxt(rows, delimiter=",", ndmin=2, comments=None) if rows else np.empty((0, 0))
        )
    except ValueError as error:  # JSON's, numpy's and the decoder's errors are of this kind
        raise InvalidInput(f"no table of numbers below comments '# key: JSON': {error}") from None
    if not table.size:
        raise InvalidInput("no table of numbers below comments '# key: JSON'")
    if comments.get("schema") != schema:
        raise InvalidInput(f"'schema' is {comments.get('schema')!r}; {schema!r} is needed")
    for key in needed:
        if key not in comments:
            raise InvalidInput(f"comment '# {key}: ...' is missing (found: {', '.join(comments)})")
    if table.shape[1] != len(names):
        raise InvalidInput(f"{len(names)} names for {table.shape[1]} columns")
    return comments, names, table


def _check_columns(names: Sequence[str], needed: Sequence[str]) -> None:
    if tuple(names[: len(needed)]) != tuple(needed):
        raise InvalidInput(f"columns {', '.join(names)}; {', '.join(needed)} must come first")


def _check_grid(index: Array, axes: Sequence[int], which: Sequence[int]) -> None:
    """Check that rows (R, k) count through the axes `which` of a grid, last axis fastest."""
    rows = int(np.prod(axes))
    if len(index) != rows:
        raise InvalidInput(f"{len(index)} rows; {' x '.join(map(str, axes))} = {rows} are needed")
    expected = np.indices(tuple(axes)).reshape(len(axes), -1).T[:, list(which)]
    wrong = (index != expected).any(axis=1)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise InvalidInput(
            f"row {row} of the table (counted from 0): indices {index[row].astype(int).tolist()}, "
            f"{expected[row].tolist()} are needed there; a row is missing or out of order"
        )
