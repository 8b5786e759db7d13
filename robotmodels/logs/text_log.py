"""Tables of text: CSV, TSV and whatever recorders write, also blocks side by side."""

import io
import re
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput
from robotmodels.common.progress import Progress, tell
from robotmodels.data_files.file_guard import library_errors
from robotmodels.logs.column_store import ColumnStore
from robotmodels.logs.log import Channel, Log, Table, unique_names
from robotmodels.logs.merged_rows import part_merged_rows
from robotmodels.logs.text_dialect import Dialect, find_dialect, parse_stamp, split_unit

_CHUNK = 1 << 23  # characters parsed at once
_MILLISECONDS = re.compile(r"\[?\s*ms\s*\]?$")


def read_text_log(path: Path, stack: ExitStack, progress: Progress | None = None) -> Log:
    """Read a table of numbers.

    Parameters
    ----------
    stack : ExitStack
        Closes the temporary file that the numbers go to.
    progress : callable, optional
        Called with the bytes read and the bytes of the file.

    Raises
    ------
    InvalidInput
        If there is no table in it.
    """
    dialect = find_dialect(path)
    columns = [c for c, kind in enumerate(dialect.kinds) if kind != "text"]
    store, dropped = ColumnStore(len(columns), stack), 0
    with library_errors(path, "a text file"), path.open(encoding=dialect.encoding) as file:
        for _ in range(dialect.skip):
            file.readline()
        size, characters = path.stat().st_size, 0
        while lines := file.readlines(_CHUNK):
            block = _parse(lines, dialect, columns)
            store.append(block)
            dropped += len(lines) - len(block)
            characters += sum(map(len, lines))
            tell(progress, min(characters, size), size)
    if not store.rows:
        raise InvalidInput(f"{path}: no rows of numbers below its header")
    notes = [f"{path.name}: {dropped} lines that are no rows of numbers were dropped"]
    blocks = _tables(_layout(dialect), dialect, columns, store)
    tables = tuple(table for block in blocks for table in part_merged_rows(block))
    return Log((path,), tables, notes=tuple(notes if dropped else ()))


def _parse(lines: Sequence[str], dialect: Dialect, columns: Sequence[int]) -> Array:
    numeric = all(dialect.kinds[c] == "number" for c in columns)
    if numeric:
        try:
            return _parse_fast(lines, dialect, columns)
        except ValueError:
            pass  # something in it is no number: cell by cell
    width = len(dialect.kinds)
    rows = []
    for line in lines:
        cells = dialect.cells(line)
        cells += [""] * (width - len(cells))
        row = [
            parse_stamp(cells[c]) if dialect.kinds[c] == "stamp" else dialect.number(cells[c])
            for c in columns
        ]
        if len(cells) == width and not all(map(np.isnan, row)):
            rows.append(row)
    return np.array(rows, dtype=float).reshape(-1, len(columns))


def _parse_fast(lines: Sequence[str], dialect: Dialect, columns: Sequence[int]) -> Array:
    text = "".join(lines)
    # Of any number of spaces NumPy knows alone, and of signs before positive numbers.
    if find_spec("pyarrow") is not None and dialect.delimiter != " ":
        try:
            return _checked(_parse_by_arrow(text, dialect, columns), len(lines))
        except ValueError:
            pass
    return _checked(_parse_by_numpy(text, dialect, columns), len(lines))


def _checked(block: Array, rows: int) -> Array:
    if len(block) != rows or np.isnan(block).all(axis=1).any():
        raise ValueError("rows without numbers")
    return block


def _parse_by_arrow(text: str, dialect: Dialect, columns: Sequence[int]) -> Array:
    """Parse numbers by pyarrow, six times as fast as by NumPy."""
    from pyarrow import csv, float64

    names = [str(c) for c in range(len(dialect.kinds))]
    inside = [names[c] for c in columns]
    table = csv.read_csv(
        io.BytesIO(text.encode()),
        csv.ReadOptions(column_names=names, use_threads=False),
        csv.ParseOptions(delimiter=dialect.delimiter),
        csv.ConvertOptions(
            column_types=dict.fromkeys(inside, float64()),
            include_columns=inside,
            null_values=["", "nan", "NaN", "NAN", "-", "null", "NA"],
            decimal_point=dialect.decimal,
        ),
    )
    return np.stack([table[name].to_numpy() for name in inside], axis=1)


def _parse_by_numpy(text: str, dialect: Dialect, columns: Sequence[int]) -> Array:
    if dialect.decimal == ",":
        if "." in text:
            raise ValueError(text[:20])
        text = text.replace(",", ".")
    mark = None if dialect.delimiter == " " else dialect.delimiter
    if mark is not None:
        for _ in range(2):
            text = text.replace(mark + mark, f"{mark}nan{mark}")
        text = text.replace(f"{mark}\n", f"{mark}nan\n").replace(f"\n{mark}", f"\nnan{mark}")
    with np.errstate(all="ignore"):
        block = np.loadtxt(
            text.splitlines(), delimiter=mark, usecols=columns, ndmin=2, comments=None
        )
    return np.asarray(block, dtype=float)


@dataclass(frozen=True)
class _Layout:
    """Names and units of columns; blocks as their first columns, where there are several."""

    names: list[str]
    units: list[str]
    starts: list[int]
    sample_times: list[float | None]
    timed: bool


def _layout(dialect: Dialect) -> _Layout:
    width = len(dialect.kinds)
    rows = [row for row in dialect.header if len(row) == width]
    names = _grouped_names(rows) or next((row for row in rows if _is_names(row)), None)
    if names is None:
        plain = [f"column_{c + 1}" for c in range(width)]
        return _Layout(plain, [""] * width, [0], [None], timed=False)
    split = [split_unit(name or f"column_{c + 1}") for c, name in enumerate(names)]
    later = rows[rows.index(names) + 1 :] if names in rows else rows[2:]
    keyed = {row[0]: row for row in later if row[0]}
    period = next((row for key, row in keyed.items() if key.lower().startswith("sampletime")), None)
    if period is not None:
        return _scope_layout([name for name, _ in split], period, [names, *later], keyed)
    units = [unit for _, unit in split]
    if later and not any(units):
        units = [split_unit(f"x {cell}")[1] or cell for cell in later[0]]
    return _Layout([n for n, _ in split], units, [0], [None], timed=False)


def _grouped_names(rows: Sequence[tuple[str, ...]]) -> tuple[str, ...] | None:
    """Return ``group.name`` of two rows, the first with a cell for several columns each."""
    if len(rows) < 2 or all(rows[0]) or not any(rows[0]):
        return None
    if any(not above and not below for above, below in zip(rows[0], rows[1], strict=True)):
        return None
    group, names = "", []
    for above, name in zip(rows[0], rows[1], strict=True):
        group = above or group
        names.append(f"{group}.{name}" if group and name else group or name)
    return tuple(names)


def _scope_layout(
    names: list[str],
    period: tuple[str, ...],
    rows: Sequence[tuple[str, ...]],
    keyed: dict[str, tuple[str, ...]],
) -> _Layout:
    """Return the layout of a scope: blocks whose first columns have keys above and stamps below."""
    starts = [c for c in range(len(names)) if all(row[c] == row[0] for row in rows)]
    scale = 1e-3 if _MILLISECONDS.search(period[0]) else 1.0
    times = [_sample_time(period[c + 1 : c + 2], scale) for c in starts]
    labels = keyed.get("Unit", ("",) * len(names))
    units = [unit if unit.strip("()").lower() != "none" else "" for unit in labels]
    for c in starts:
        names[c], units[c] = "time", "ms" if scale == 1e-3 else "s"
    return _Layout(names, units, starts, times, timed=True)


def _sample_time(cells: Sequence[str], scale: float) -> float | None:
    """Return what the header states, whose decimal mark may differ from that of the numbers."""
    try:
        return float(cells[0].replace(",", ".")) * scale
    except (ValueError, IndexError):
        return None


def _is_names(row: Sequence[str]) -> bool:
    filled = [cell for cell in row if cell]
    return len(filled) > len(row) / 2 and len(set(filled)) > len(filled) / 2


def _tables(
    layout: _Layout, dialect: Dialect, columns: Sequence[int], store: ColumnStore
) -> Iterator[Table]:
    ends = [*layout.starts[1:], len(dialect.kinds)]
    several = len(layout.starts) > 1
    for number, (start, end) in enumerate(zip(layout.starts, ends, strict=True)):
        inside = [c for c in columns if start <= c < end]
        names = unique_names([layout.names[c] for c in inside])
        rows = _filled(store, columns.index(start)) if several else store.rows
        channels: dict[str, Channel] = {
            name: store.channel(
                columns.index(c), "s" if dialect.kinds[c] == "stamp" else layout.units[c]
            )
            for name, c in zip(names, inside, strict=True)
        }
        stamps = [n for n, c in zip(names, inside, strict=True) if dialect.kinds[c] == "stamp"]
        time = names[0] if layout.timed else (stamps or [""])[0]
        name = f"block_{number + 1}" if several else ""
        yield Table(name, rows, channels, layout.sample_times[number], time)


def _filled(store: ColumnStore, column: int) -> int:
    """Return the rows before those at the end in which a column is empty."""
    filled = np.flatnonzero(~np.isnan(store.read(column, 0, store.rows)))
    return int(filled[-1]) + 1 if len(filled) else 0
