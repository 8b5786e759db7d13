"""Records and FRFs as text: one table a file, below comments that say what it holds.

Comments are ``# key: JSON``. Numbers have 17 digits, so every bit survives. Positions, blocks,
outputs and so on are counted from 0.

FRFs: comments ``schema`` "frf/1", ``positions`` (Q, n) [rad], ``repetitions`` (Q,), and, where they
are known, ``degrees_of_freedom`` (Q,) of the covariance, 1e15 for a declared one, and
``line_correlation`` (L,). Draws of the errors (`FrfEstimate.deviations`) are left out. Columns
position, omega [rad/s], frequency_hz, output, input, re, im, and ``variance`` or, for full
covariances, the row of the covariance matrix that belongs to the element, ``covariance_re_0``,
``covariance_im_0``, ``covariance_re_1``, ... in the order of vec(G), columns stacked.

Records: comments ``schema`` "records/1", ``sample_time`` [s], ``positions``, ``lines``,
``detection`` and ``axes``, how many positions, blocks, runs, periods and samples there are
and, last, 1 if the reference was given for one period only, else the number of periods. Columns
position, block, run, period, sample, reference_0 ..., torque_0 ..., angle_0 ...,
saturated_0 ...; the last index varies fastest. A missing run's torques and angles are nan.
"""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from estimators.frf.file_schemas import FRF, FRF_SCHEMA, check_hertz, read_freedom, stored_freedom
from estimators.frf.frf_estimate import FrfEstimate, unvec, vec
from robotmodels.common.arrays import Array, whole_numbers
from robotmodels.common.deprecation import current_key
from robotmodels.common.errors import InvalidInput
from robotmodels.data_files.array_schema import ArraySchema, Field, stored_array
from robotmodels.data_files.csv_table import CsvTable, read_table
from robotmodels.records.record_schema import RECORDS, RECORDS_SCHEMA
from robotmodels.records.records import SIGNALS, Records

_FRF_COLUMNS = ("position", "omega", "frequency_hz", "output", "input", "re", "im")
_RECORD_INDEX = ("position", "block", "run", "period", "sample")
_AXES = Field(("axis",), "whole", least=1)


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
        "schema": FRF_SCHEMA,
        "positions": estimate.positions.tolist(),
        "repetitions": estimate.repetitions.tolist(),
    }
    freedom = stored_freedom(estimate.degrees_of_freedom)
    if freedom is not None:
        comments["degrees_of_freedom"] = freedom.tolist()
    if estimate.line_correlation.size:
        comments["line_correlation"] = estimate.line_correlation.tolist()
    _write(path, comments, names, np.stack(table, axis=1))


def read_frf(path: Path) -> FrfEstimate:
    """Read what `write_frf` wrote."""
    table = read_table(path, FRF_SCHEMA)
    keys = ("positions", "repetitions", "degrees_of_freedom", "line_correlation")
    schema = ArraySchema({key: FRF.fields[key] for key in keys})
    comments = schema.read(table.comments, table.where)
    Q, (m, n) = len(comments["positions"]), (_count(table, key) for key in ("output", "input"))
    full = any(name.startswith("covariance_") for name in table.columns)
    entries = [f"covariance_{part}_{k}" for k in range(m * n) for part in ("re", "im")]
    errors = entries if full else ["variance"]
    table.check_columns([*_FRF_COLUMNS, *errors])
    F = max(1, len(table.values) // max(Q * m * n, 1))
    shape = (Q, F, n, m)
    table.check_grid(("position", None, "input", "output"), shape)
    omega, hertz = table.column(("omega", "frequency_hz")).T.reshape(2, Q, F, n * m)
    if (omega != omega[:1, :, :1]).any():
        raise InvalidInput(f"{path}: omega: rows of one frequency, or positions, differ in it")
    check_hertz(hertz.ravel(), omega.ravel(), path)
    table.check_finite()
    re, im = table.column(("re", "im")).T
    values = table.column(errors)
    covariance = (
        values[:, ::2] + 1j * values[:, 1::2] if full else unvec(values.reshape(Q, F, -1), m)
    )
    return FrfEstimate(
        comments["positions"],
        omega[0, :, 0],
        unvec((re + 1j * im).reshape(Q, F, n * m), m),
        covariance.reshape(Q, F, m * n, m * n) if full else covariance,
        comments["repetitions"],
        read_freedom(comments.get("degrees_of_freedom"), Q),
        line_correlation=comments.get("line_correlation", np.empty(0)),
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
            *([] if records.command is None else [records.command]),
        )
    ]
    index = np.indices(axes).reshape(5, -1).T
    names = [*_RECORD_INDEX]
    for name, signal in zip(records.signals, signals, strict=True):
        names += [f"{name}_{i}" for i in range(signal.shape[1])]
    comments = {
        "schema": RECORDS_SCHEMA,
        "sample_time": records.sample_time,
        "positions": records.positions.tolist(),
        "lines": records.lines.tolist(),
        "detection": records.detection.tolist(),
        "derivatives": records.derivatives.tolist(),
        "axes": [*axes, records.reference.shape[3]],
    }
    _write(path, comments, names, np.hstack([index, *signals]))


def read_records(path: Path) -> Records:
    """Read what `write_records` wrote."""
    table = read_table(path, RECORDS_SCHEMA)
    if "run" not in table.columns:
        columns = (current_key(c, table.where, "0.2", experiment="run") for c in table.columns)
        table = replace(table, columns=tuple(columns))
    commanded = ("command",) if "command_0" in table.columns else ()
    names = {name: table.numbered(name) for name in (*SIGNALS, *commanded)}
    table.check_columns([*_RECORD_INDEX, *(column for group in names.values() for column in group)])
    comments = dict(table.comments)
    grid = ArraySchema({"axes": _AXES}).read(
        {key: comments.pop(key) for key in ("axes",) if key in comments}, table.where
    )
    if len(grid["axes"]) != len(_RECORD_INDEX) + 1:
        raise InvalidInput(
            f"{table.where}: axes: {len(grid['axes'])} numbers; {len(_RECORD_INDEX) + 1} are "
            f"needed, of each of {', '.join(_RECORD_INDEX)}, and of periods of the reference"
        )
    *axes, reference_periods = (int(length) for length in grid["axes"])
    table.check_grid(_RECORD_INDEX, axes)
    signals = {
        name: table.column(columns).reshape(*axes, len(columns)) for name, columns in names.items()
    }
    signals["reference"] = _periods(signals["reference"], reference_periods, table.where)
    signals["saturated"] = signals["saturated"].max(axis=4)
    stored = {name: stored_array(signal) for name, signal in signals.items()}
    return Records(**RECORDS.read({**comments, **stored}, table.where))


def _periods(reference: Array, periods: int, where: str) -> Array:
    """Return the reference of as many periods as it was given for, one or all."""
    if periods not in (1, reference.shape[3]):
        raise InvalidInput(
            f"{where}: axes: {periods} periods of the reference; 1 or {reference.shape[3]} needed"
        )
    if periods == 1 and not np.array_equal(
        reference, np.broadcast_to(reference[:, :, :, :1], reference.shape)
    ):
        raise InvalidInput(
            f"{where}: axes: one period of the reference, but in the table its periods differ"
        )
    return reference[:, :, :, :periods]


def _count(table: CsvTable, column: str) -> int:
    """Return how many outputs or inputs there are: one more than the largest number."""
    numbers = whole_numbers(table.column((column,)), f"{table.where}: {column}")
    largest = int(numbers.max())
    if not 0 <= largest < len(numbers):
        raise InvalidInput(
            f"{table.where}: {column}: {largest} in a table of {len(numbers)} rows; numbers from "
            "0 on are needed"
        )
    return largest + 1


def _write(path: Path, comments: dict[str, Any], names: Sequence[str], table: Array) -> None:
    with path.open("w", encoding="utf-8", newline="\n") as file:
        for key, value in comments.items():
            file.write(f"# {key}: {json.dumps(value)}\n")
        file.write(",".join(names) + "\n")
        np.savetxt(file, table, fmt="%.17g", delimiter=",")
