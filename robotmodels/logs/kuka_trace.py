"""KUKA traces: a text header as DIAdem writes it, beside files of little-endian doubles."""

from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput
from robotmodels.common.file_paths import check_file
from robotmodels.data_files.file_guard import library_errors
from robotmodels.logs.log import Channel, Log, Table, unique_names

KUKA_HEADER = b"#BEGINCHANNELHEADER"


def is_kuka_trace(path: Path) -> bool:
    """Return whether a .dat file is the header of a KUKA trace, as DIAdem writes it."""
    with path.open("rb") as file:
        return KUKA_HEADER in file.read(1 << 16)


def read_kuka_trace(path: Path, stack: ExitStack) -> Log:
    """Read a KUKA trace: channels in a text header, samples side by side in .r64 files.

    A channel without a file is the time: start 240, step 241. Others are at column 221 of the file
    211, little-endian doubles, times 241 plus 240.

    Raises
    ------
    InvalidInput
        If a header has no samples, or a file is shorter than the header says.
    """
    with library_errors(path, "the header of a KUKA trace"):
        headers = _headers(path.read_text(encoding="cp1252"))
        implicit = [h for h in headers if h.get(210, "").upper().startswith("IMPLI")]
        explicit = [h for h in headers if h not in implicit]
        step = float(implicit[0][241]) if implicit else None
        rows = min((int(header.get(220, 0)) for header in explicit), default=0)
        names = unique_names([header[200] for header in explicit])
        channels = {
            name: _channel(path, number, explicit, rows) for number, name in enumerate(names)
        }
    if not rows:
        raise InvalidInput(f"{path}: the header of a KUKA trace without samples")
    return Log((path,), (Table("", rows, channels, step),))


def _channel(path: Path, number: int, headers: list[dict[int, str]], rows: int) -> Channel:
    """Return a channel; those with one file stand side by side in it."""
    header = headers[number]
    width = sum(each[211] == header[211] for each in headers)
    column = int(header.get(221, number + 1)) - 1
    if not 0 <= column < width:
        raise InvalidInput(f"{path}: {header[200]} is at column {column + 1} of {width}")
    samples = _samples(path, header[211], rows, width)
    # Other writers of such headers leave the factor zero.
    factor, offset = float(header.get(241, 1.0)) or 1.0, float(header.get(240, 0.0))

    def read(start: int, stop: int) -> Array:
        return np.array(samples[start:stop, column]) * factor + offset

    return Channel(read, header.get(202, "").strip("[]"))


def _headers(text: str) -> list[dict[int, str]]:
    headers: list[dict[int, str]] = []
    for line in text.splitlines():
        if line.startswith("#BEGINCHANNELHEADER"):
            headers.append({})
        key, comma, value = line.partition(",")
        if headers and comma and key.strip().isdigit():
            headers[-1][int(key)] = value.strip()
    return headers


def _samples(path: Path, name: str, rows: int, width: int) -> Any:
    # The controller writes names in other letters than Windows shows.
    beside = {each.name.lower(): each for each in path.parent.iterdir()}
    source = beside.get(name.lower(), path.parent / Path(name).name)
    check_file(source)
    samples = np.memmap(source, dtype="<f8", mode="r")
    if len(samples) < rows * width:
        raise InvalidInput(
            f"{source}: {len(samples)} values, the header says {rows} samples of {width} channels"
        )
    return samples[: rows * width].reshape(rows, width)
