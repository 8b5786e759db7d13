"""Lists of positions in files: CSV, YAML or NumPy's."""

import csv
import re
from collections.abc import Sequence
from pathlib import Path
from tokenize import TokenError
from typing import Any, Protocol

import numpy as np

from robotmodels.common.arrays import Array, real_numbers
from robotmodels.common.errors import InvalidInput, nearest
from robotmodels.common.file_paths import check_file
from robotmodels.common.yaml_files import MOST_CHARACTERS, Strict, parse, read_text, yaml_document
from robotmodels.common.yaml_reader import Node
from robotmodels.data_files.file_guard import library_errors
from robotmodels.description.ranges import Coordinate

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?|[+-]?(nan|inf)", re.IGNORECASE | re.ASCII)


class Motorised(Protocol):
    """A robot with named motors and joints."""

    @property
    def motor_names(self) -> Sequence[str]:
        """Names of the n motors."""
        ...

    @property
    def motor_joints(self) -> Sequence[str]:
        """Names of their joints."""
        ...


class PositionList(Strict, extra="ignore"):
    """Positions in a YAML file [rad or m]."""

    positions: list[list[Coordinate]]


def read_positions(path: str | Path, robot: Motorised) -> Array:
    """Return the positions of a file, (Q, n) [rad or m].

    ``.csv``: a position per line, and if the first line is words, a column for each motor or joint
    that it names, in any order; ``.yaml``: a list of positions, or one under the key
    ``positions``; ``.npy``: an array (Q, n).

    Raises
    ------
    InvalidInput
        Naming the file, and the line or column that cannot be used.
    """
    path = Path(path)
    readers = {".csv": _read_csv, ".yaml": _read_yaml, ".yml": _read_yaml, ".npy": _read_npy}
    if path.suffix not in readers:
        raise InvalidInput(f"{path}: positions are read from {', '.join(readers)} files")
    check_file(path)
    positions = real_numbers(readers[path.suffix](path, robot), f"{path}: positions")
    n = len(robot.motor_names)
    if positions.ndim != 2 or positions.shape[1] != n or not len(positions):
        raise InvalidInput(
            f"{path}: positions of shape {positions.shape}; (Q, {n}) is needed, one column for "
            f"each of {', '.join(robot.motor_names)}"
        )
    wrong = ~np.isfinite(positions).all(axis=1)
    if wrong.any():
        raise InvalidInput(f"{path}: position {int(np.argmax(wrong)) + 1} is not finite")
    return positions


def _read_csv(path: Path, robot: Motorised) -> list[list[float]]:
    with (
        library_errors(path, "a table of numbers as text", csv.Error),
        path.open(newline="", encoding="utf-8-sig") as file,
    ):
        lines = [
            (number, [cell.strip() for cell in row])
            for number, row in enumerate(csv.reader(file), start=1)
            if row and not row[0].lstrip().startswith("#")
        ]
    order = list(range(len(robot.motor_names)))
    if lines and not _number(lines[0][1][0]):
        order = _columns(path, lines[0][1], robot)
        lines = lines[1:]
    rows = []
    for number, cells in lines:
        if len(cells) != len(order) or not all(map(_number, cells)):
            raise InvalidInput(
                f"{path}: line {number}: {', '.join(cells)[:60]!r}; {len(order)} numbers are needed"
            )
        rows.append([float(cells[j]) for j in order])
    return rows


def _columns(path: Path, header: list[str], robot: Motorised) -> list[int]:
    """Return which column each motor's positions are in."""
    names = list(robot.motor_names), list(robot.motor_joints)
    for name in header:
        if name not in names[0] and name not in names[1]:
            known = (*names[0], *names[1])
            raise InvalidInput(
                f"{path}: column {name[:60]!r} is neither a motor nor a driven joint"
                f"{nearest(name, known)}; there are {', '.join(known)}"
            )
    columns = []
    for motor, joint in zip(*names, strict=True):
        matching = [j for j, name in enumerate(header) if name in (motor, joint)]
        if len(matching) != 1:
            raise InvalidInput(
                f"{path}: motor {motor!r} (joint {joint!r}) has {len(matching)} columns; one needed"
            )
        columns.append(matching[0])
    return columns


def _read_yaml(path: Path, _: Motorised) -> Any:
    wanted = "a list of positions"
    document = yaml_document(read_text(path, MOST_CHARACTERS, wanted), str(path), wanted)
    if isinstance(document.content, list):
        document = Node(1, {"positions": document.content}, {"positions": document})
    return parse(document, PositionList, str(path)).positions


def _read_npy(path: Path, _: Motorised) -> Any:
    with library_errors(path, "a NumPy array file", TokenError):
        # Mapped, so that a shape beyond the end of the file is noticed before memory is taken.
        return np.lib.format.open_memmap(path, mode="r")


def _number(cell: str) -> bool:
    """Whether text is a number to any program: Python also takes 0_1 and digits of any script."""
    return _NUMBER.fullmatch(cell) is not None
