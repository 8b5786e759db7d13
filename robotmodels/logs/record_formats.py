"""Logs of optional libraries: Parquet and TDMS."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput
from robotmodels.common.progress import Progress, tell
from robotmodels.data_files.file_guard import library_errors
from robotmodels.logs.column_store import ColumnStore
from robotmodels.logs.log import Channel, Log, Table, unique_names
from robotmodels.logs.merged_rows import part_merged_rows
from robotmodels.logs.optional_library import optional_library

_BATCH = 1 << 15  # rows
_BUFFER = 1 << 20  # bytes


def read_parquet_log(path: Path, stack: ExitStack, progress: Progress | None = None) -> Log:
    """Read the columns of a Parquet file; lists of one length become a channel per element."""
    parquet = optional_library("pyarrow.parquet", f"{path}: Parquet")
    with library_errors(path, "a Parquet file", Exception):
        # Buffered: else pyarrow holds whole row groups, and all of them at once.
        file = stack.enter_context(parquet.ParquetFile(path, buffer_size=_BUFFER))
        store, names, done = None, [], 0
        total = file.metadata.num_rows
        for batch in _batches(file):
            columns = dict(_arrow_columns(batch))
            if store is None:
                names, store = list(columns), ColumnStore(len(columns), stack)
            if list(columns) != names:
                raise InvalidInput(f"{path}: lists in it change their lengths at row {done}")
            store.append(np.stack(list(columns.values()), axis=1))
            done += batch.num_rows
            tell(progress, done, total)
    if store is None or not names:
        raise InvalidInput(f"{path}: no column of numbers in it")
    channels = {name: store.channel(i) for i, name in enumerate(names)}
    return Log((path,), part_merged_rows(Table("", store.rows, channels)))


def _batches(file: Any) -> Iterator[Any]:
    for group in range(file.num_row_groups):
        yield from file.iter_batches(batch_size=_BATCH, row_groups=[group], use_threads=False)


def _arrow_columns(batch: Any) -> Iterator[tuple[str, Array]]:
    for field, column in zip(batch.schema, batch.columns, strict=True):
        yield from _arrow_column(field, column)


def _arrow_column(field: Any, column: Any) -> Iterator[tuple[str, Array]]:
    """Yield the numbers of a column by name; of structs and lists one by one."""
    arrow = optional_library("pyarrow", "Parquet")
    kind = field.type
    if arrow.types.is_struct(kind):
        for inner, part in zip(kind, column.flatten(), strict=True):
            yield from _arrow_column(inner.with_name(f"{field.name}.{inner.name}"), part)
    elif arrow.types.is_timestamp(kind):
        yield (
            field.name,
            column.cast(arrow.timestamp("ns")).cast("int64").to_numpy(False) * 1e-9,
        )
    elif arrow.types.is_integer(kind) or arrow.types.is_floating(kind):
        yield field.name, np.asarray(column.to_numpy(zero_copy_only=False), dtype=float)
    elif arrow.types.is_boolean(kind):
        yield field.name, np.asarray(column.cast("int8").to_numpy(False), dtype=float)
    elif arrow.types.is_list(kind) or arrow.types.is_fixed_size_list(kind):
        inner = kind.value_type
        if not (arrow.types.is_floating(inner) or arrow.types.is_integer(inner)):
            return
        flat = np.asarray(column.flatten().to_numpy(zero_copy_only=False), dtype=float)
        if len(column.value_lengths().unique()) == 1 and len(flat):
            table = flat.reshape(len(column), -1)
            for i, values in enumerate(table.T):
                yield f"{field.name}[{i}]", values


def read_tdms_log(path: Path, stack: ExitStack) -> Log:
    """Read the channels of a TDMS file; those of a group with one length make a table."""
    tdms = optional_library("nptdms", f"{path}: TDMS")
    tables: dict[tuple[str, int], list[Any]] = {}
    with library_errors(path, "a TDMS file", Exception):
        # Of a damaged file nptdms would leave its own handle open.
        file = stack.enter_context(tdms.TdmsFile.open(stack.enter_context(path.open("rb"))))
        for group in file.groups():
            for channel in group.channels():
                if channel.dtype.kind in "fiubM" and len(channel):
                    tables.setdefault((group.name, len(channel)), []).append(channel)
        names = unique_names([group if len(tables) > 1 else "" for group, _ in tables])
        parts = [_tdms_table(n, each, path) for n, each in zip(names, tables.values(), strict=True)]
    if not parts:
        raise InvalidInput(f"{path}: no channel of numbers in it")
    return Log((path,), tuple(parts))


def _tdms_table(name: str, members: list[Any], path: Path) -> Table:
    """Return channels of one length as a table; one of dates is its time."""
    steps = [float(channel.properties.get("wf_increment", 0.0)) for channel in members]
    stamps = [channel.name for channel in members if channel.dtype.kind == "M"]
    channels = {
        channel.name: Channel(
            _tdms_reader(channel, path),
            "s" if channel.name in stamps else str(channel.properties.get("unit_string", "")),
        )
        for channel in members
    }
    step = next((each for each in steps if each > 0), None)
    return Table(name, len(members[0]), channels, step, (stamps or [""])[0])


def _tdms_reader(channel: Any, path: Path) -> Callable[[int, int], Array]:
    def read(start: int, stop: int) -> Array:
        with library_errors(f"{path}: {channel.name}", "a TDMS file", Exception):
            values = channel[start:stop]
            if values.dtype.kind == "M":
                values = values.astype("datetime64[ns]").astype(np.int64) * 1e-9
            return np.asarray(values, dtype=float)

    return read
