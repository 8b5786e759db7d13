"""How a table of text is written: characters, delimiter, decimal mark, header rows, columns."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path

from robotmodels.common.errors import InvalidInput
from robotmodels.data_files.file_guard import library_errors

_SAMPLE = 1 << 18  # bytes that tell
_ROWS = 120  # of the sample that are looked at, evenly spread
_COMMENTS = ("#", "%", "//")
_EMPTY = {"", "na", "n/a", "null", "none", "-", "?"}
_TRUTH = {"true": 1.0, "false": 0.0, "on": 1.0, "off": 0.0}
_SPACES = re.compile(r"\s+")
_UNIT = re.compile(r"^(.*\S)\s*[\[(]\s*([^\[\]()]*[^\W\d][^\[\]()]*|%|°|°/s)\s*[\])]$")
_STAMP = re.compile(
    r"(?:(?P<year>\d{4})[-/.](?P<month>\d\d?)[-/.](?P<day>\d\d?)[T ]\s*"
    r"|(?P<first>\d\d?)[-/.](?P<second>\d\d?)[-/.](?P<last_year>\d{4})[T ]\s*)?"
    r"(?P<h>\d\d?):(?P<m>\d\d)(?::(?P<s>\d\d)(?:[.,:](?P<fraction>\d+))?)?"
    r"\s*(?P<zone>Z|[+-]\d\d:?\d\d)?"
)
_EPOCH = date(1970, 1, 1).toordinal()


@dataclass(frozen=True)
class Dialect:
    """How a table is written.

    Attributes
    ----------
    encoding : str
        Of the characters.
    delimiter : str
        Between cells; a space stands for any white space.
    decimal : str
        Decimal mark.
    header : tuple of tuple of str
        Cells of the rows above the first row of numbers, comment signs dropped.
    skip : int
        Lines before the first row of numbers.
    kinds : tuple of {"number", "stamp", "text"}
        What each column holds.
    """

    encoding: str
    delimiter: str
    decimal: str
    header: tuple[tuple[str, ...], ...]
    skip: int
    kinds: tuple[str, ...]

    def cells(self, line: str) -> list[str]:
        """Return the cells of a line."""
        return split_cells(line, self.delimiter)

    def number(self, cell: str) -> float:
        """Return the number in a cell, NaN where it holds none."""
        return _number(cell, self.decimal, math.nan)


def find_dialect(path: Path) -> Dialect:
    """Return how a file's table is written, from its first lines.

    Raises
    ------
    InvalidInput
        If there is no table of numbers in it.
    """
    encoding, lines = _first_lines(path)
    body = [line for line in lines if line.strip() and not line.lstrip().startswith(_COMMENTS)]
    sample = body[:: max(1, len(body) // _ROWS)]
    best = max(
        ((d, m) for d in "\t;,| " for m in ".," if (d, m) != (",", ",")),
        key=lambda pair: _score(sample, *pair),
    )
    if _score(sample, *best)[0] <= 0:
        raise InvalidInput(
            f"{path}: no table of numbers in it; rows of numbers between tabs, semicolons, commas, "
            "bars or spaces are needed"
        )
    delimiter, decimal = best
    rows = _numeric_rows(sample, delimiter, decimal)
    width = _width(rows)
    kinds = tuple(_kind([row[c] for row in rows if len(row) > c], decimal) for c in range(width))
    header, skip = _header(lines, delimiter, decimal, kinds)
    return Dialect(encoding, delimiter, decimal, header, skip, kinds)


def split_cells(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line without quotation marks."""
    line = line.rstrip("\r\n")
    if delimiter == " ":
        return [cell.strip('"') for cell in _SPACES.split(line.strip())]
    if '"' not in line:
        return [cell.strip() for cell in line.split(delimiter)]
    return [part for cell in _quoted_cells(line, delimiter) for part in _elements(cell) or [cell]]


def _quoted_cells(line: str, delimiter: str) -> list[str]:
    import csv

    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]


def _elements(cell: str) -> list[str]:
    """Return the elements of a cell that is a list, such as ``[0.1, 0.2]``."""
    listed = cell[:1] in ("[", "(") and cell[-1:] in ("]", ")")
    return re.findall(r"[^\s,;\[\]()]+", cell) if listed else []


def element_names(names: Sequence[str], line: str, delimiter: str) -> list[str]:
    """Return the names of columns, with a number for each element where a row has lists."""
    lengths = [len(_elements(cell)) for cell in _quoted_cells(line, delimiter)]
    if not any(lengths) or len(lengths) != len(names):
        return list(names)
    pairs = zip(names, lengths, strict=True)
    return [each for n, k in pairs for each in ([f"{n}[{i}]" for i in range(k)] if k else [n])]


def split_unit(name: str) -> tuple[str, str]:
    """Return name and unit of ``name [unit]`` or ``name (unit)``."""
    match = _UNIT.match(name)
    return (match[1], match[2].strip()) if match else (name, "")


def parse_stamp(cell: str) -> float:
    """Return a date and time, or a time of day, as seconds, NaN where it is neither.

    Dates count from 1970, years first or last; zones are taken off.
    """
    match = _STAMP.fullmatch(cell.strip())
    if match is None:
        return math.nan
    parts = match.groupdict()
    days = 0
    if year := parts["year"] or parts["last_year"]:
        month, day = parts["month"] or parts["second"], parts["day"] or parts["first"]
        try:
            days = date(int(year), int(month), int(day)).toordinal() - _EPOCH
        except ValueError:
            return math.nan
    seconds = 3600 * int(parts["h"]) + 60 * int(parts["m"]) + int(parts["s"] or 0)
    fraction = float(f"0.{parts['fraction']}") if parts["fraction"] else 0.0
    zone = parts["zone"] or "Z"
    shift = 0
    if zone != "Z":
        digits = zone[1:].replace(":", "")
        shift = (3600 * int(digits[:2]) + 60 * int(digits[2:])) * (-1 if zone[0] == "-" else 1)
    return 86400.0 * days + seconds - shift + fraction


def _first_lines(path: Path) -> tuple[str, list[str]]:
    with library_errors(path, "a text file"), path.open("rb") as file:
        sample = file.read(_SAMPLE)
    encoding = next(e for e in _encodings(sample) if _decodes(sample, e))
    text = sample.decode(encoding, errors="ignore")
    if "\0" in text:
        raise InvalidInput(f"{path}: not a text file; a table of numbers as text is needed")
    lines = text.splitlines()
    return encoding, lines[:-1] if len(sample) == _SAMPLE else lines


def _encodings(sample: bytes) -> list[str]:
    if sample.startswith((b"\xff\xfe", b"\xfe\xff")):
        return ["utf-16"]
    return ["utf-8-sig", "cp1252", "latin-1"]


def _decodes(sample: bytes, encoding: str) -> bool:
    try:
        # The last character may be cut.
        sample[: len(sample) // 4 * 4 if encoding == "utf-16" else -4 or None].decode(encoding)
    except UnicodeDecodeError:
        return False
    return True


def _score(lines: Sequence[str], delimiter: str, decimal: str) -> tuple[float, int]:
    """Return the share of cells that are numbers, coarsely, and the number of columns."""
    rows = [split_cells(line, delimiter) for line in lines]
    cells = [cell for row in rows for cell in row if cell.lower() not in _EMPTY]
    share = sum(_is_value(cell, decimal) for cell in cells) / max(len(cells), 1)
    # Cells of text beside numbers are usual; a wrong delimiter leaves almost none.
    width = _width(_numeric_rows(lines, delimiter, decimal))
    return (round(share, 1) if share > 0.2 and width else 0.0), width


def _numeric_rows(lines: Sequence[str], delimiter: str, decimal: str) -> list[list[str]]:
    """Return the cells of lines that hold numbers, at least every fifth cell."""
    rows = [split_cells(line, delimiter) for line in lines]
    return [row for row in rows if 5 * sum(_is_value(c, decimal) for c in row) >= len(row)]


def _width(rows: Sequence[Sequence[str]]) -> int:
    """Return the largest number of cells that is no exception; short rows end early."""
    counts = [len(row) for row in rows]
    usual = [count for count in set(counts) if counts.count(count) > 1] or counts
    return max(usual, default=0)


def _kind(cells: Sequence[str], decimal: str) -> str:
    filled = [cell for cell in cells if cell.lower() not in _EMPTY]
    if all(_is_value(cell, decimal) for cell in filled):
        stamps = [cell for cell in filled if _STAMP.fullmatch(cell)]
        return "stamp" if stamps and len(stamps) == len(filled) else "number"
    return "text"


def _is_value(cell: str, decimal: str) -> bool:
    return (
        cell.lower() in ("nan", "inf", "-inf")
        or math.isfinite(_number(cell, decimal, math.nan))
        or bool(_STAMP.fullmatch(cell))
    )


def _number(cell: str, decimal: str, otherwise: float) -> float:
    if cell.lower() in _TRUTH:
        return _TRUTH[cell.lower()]
    if decimal == ",":
        if "." in cell:
            return otherwise
        cell = cell.replace(",", ".")
    try:
        return float(cell.strip("[]()")) if "_" not in cell else otherwise  # of lists in a row
    except ValueError:
        return otherwise


def _header(
    lines: Sequence[str], delimiter: str, decimal: str, kinds: Sequence[str]
) -> tuple[tuple[tuple[str, ...], ...], int]:
    rows: list[tuple[str, ...]] = []
    comments: list[tuple[str, ...]] = []  # the last may hold names where nothing else does
    for index, line in enumerate(lines):
        text = line.strip()
        comment = next((sign for sign in _COMMENTS if text.startswith(sign)), "")
        if not comment and text and _is_data(split_cells(line, delimiter), decimal, kinds):
            header = rows or comments[-1:]
            return tuple(tuple(element_names(row, line, delimiter)) for row in header), index
        content = text.lstrip("#%/ ") if comment else line.rstrip("\r\n")
        cells = split_cells(content, delimiter)
        if len(cells) != len(kinds) and comment:  # comments may be delimited in their own way
            cells = next(
                (c for d in "\t;, " if len(c := split_cells(content, d)) == len(kinds)), cells
            )
        if content.strip():
            (comments if comment else rows).append(tuple(cells))
    return tuple(rows), len(lines)


def _is_data(cells: Sequence[str], decimal: str, kinds: Sequence[str]) -> bool:
    if not len(kinds) / 2 < len(cells) <= len(kinds):
        return False
    values = [c for c, kind in zip(cells, kinds, strict=False) if kind != "text"]
    filled = [cell for cell in values if cell.lower() not in _EMPTY]
    return bool(filled) and all(_is_value(cell, decimal) for cell in filled)
