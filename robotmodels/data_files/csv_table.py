"""Tables of numbers as text, below comments ``# key: JSON`` that say what they hold."""

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput
from robotmodels.common.file_paths import check_file
from robotmodels.data_files.array_schema import StoredArray
from robotmodels.data_files.file_guard import PathLike, library_errors, listed
from robotmodels.data_files.json_text import json_array, parse_json

_CONTAINER = "a table of numbers below comments '# key: JSON'"


@dataclass(frozen=True, eq=False)
class CsvTable:
    """A table with its comments.

    Attributes
    ----------
    where : str
        The file, for errors.
    comments : dict of str to StoredArray
        Comments by key.
    columns : tuple of str
        Names of the columns, each of them once.
    values : ndarray, (rows, columns)
        Values.
    """

    where: str
    comments: dict[str, StoredArray]
    columns: tuple[str, ...]
    values: Array

    def column(self, names: Sequence[str]) -> Array:
        """Return columns by their names, (rows, names).

        Raises
        ------
        InvalidInput
            If one is missing.
        """
        for name in names:
            if name not in self.columns:
                raise InvalidInput(
                    f"{self.where}: column {name!r} is missing (found: {listed(self.columns)})"
                )
        return self.values[:, [self.columns.index(name) for name in names]]

    def numbered(self, prefix: str) -> list[str]:
        """Return the names prefix_0, prefix_1, ... as far as there are columns, one at least."""
        count = sum(name.startswith(f"{prefix}_") for name in self.columns)
        return [f"{prefix}_{i}" for i in range(max(count, 1))]

    def check_columns(self, names: Sequence[str]) -> None:
        """Refuse a table that has other columns than `names`."""
        self.column(names)
        unknown = [name for name in self.columns if name not in names]
        if unknown:
            raise InvalidInput(
                f"{self.where}: column {listed(unknown)} is unknown; needed are {', '.join(names)}"
            )

    def check_finite(self) -> None:
        """Refuse a table with NaN or infinities in it."""
        wrong = np.argwhere(~np.isfinite(self.values))
        if len(wrong):
            row, column = wrong[0]
            raise InvalidInput(
                f"{self.where}: row {row} of the table (counted from 0), column "
                f"{self.columns[column]!r}: {self.values[row, column]}; a finite number is needed"
            )

    def check_grid(self, index: Sequence[str | None], lengths: Sequence[int]) -> None:
        """Check that the columns `index` count through a grid, the last axis fastest.

        Parameters
        ----------
        index : sequence of str or None
            Names of columns; None where an axis has none.
        lengths : sequence of int
            Lengths of the axes.

        Raises
        ------
        InvalidInput
            Naming the first row that is missing or out of order.
        """
        rows = math.prod(lengths)
        if len(self.values) != rows:
            axes = " x ".join(map(str, lengths))
            raise InvalidInput(f"{self.where}: {len(self.values)} rows; {axes} = {rows} are needed")
        indices = self.column([name for name in index if name])
        counted = [i for i, name in enumerate(index) if name]
        expected = np.indices(tuple(lengths)).reshape(len(lengths), -1).T[:, counted]
        wrong = (indices != expected).any(axis=1)
        if wrong.any():
            row = int(np.argmax(wrong))
            raise InvalidInput(
                f"{self.where}: row {row} of the table (counted from 0): indices "
                f"{', '.join(f'{i:g}' for i in indices[row])}; {expected[row].tolist()} are needed "
                "there; a row is missing or out of order"
            )


def read_table(path: PathLike, name: str) -> CsvTable:
    """Return the table of a file.

    Parameters
    ----------
    name : str
        Name that the comment ``schema`` must be.

    Raises
    ------
    InvalidInput
        Naming the file and what is wrong in it.
    """
    source = Path(path)
    check_file(source)
    where, comments, line = str(source), {}, ""
    with (
        library_errors(where, _CONTAINER),
        source.open(encoding="utf-8") as file,
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("ignore", UserWarning)  # loadtxt: no data, which is told below
        for line in file:
            if not line.startswith("#"):
                break
            key, _, text = (part.strip() for part in line[1:].partition(":"))
            if key in comments:
                raise InvalidInput(f"{where}: comment '# {key}: ...' is given twice")
            comments[key] = parse_json(text, f"{where}: comment {key[:60]!r}")
        if "schema" in comments or not comments:
            _check_schema(comments.pop("schema", None), name, where)
        values = np.loadtxt(file, delimiter=",", ndmin=2, comments=None)
    if not values.size:
        raise InvalidInput(f"{where}: no table of numbers below comments '# key: JSON'")
    columns = tuple(part.strip() for part in line.split(","))
    twice = [name for name in columns if columns.count(name) > 1]
    if twice:
        raise InvalidInput(f"{where}: column {listed(twice[:1])} is there twice")
    if values.shape[1] != len(columns):
        raise InvalidInput(f"{where}: {len(columns)} names for {values.shape[1]} columns")
    stored = {k: json_array(v, f"{where}: {k}") for k, v in comments.items()}
    return CsvTable(where, stored, columns, values)


def _check_schema(schema: Any, name: str, where: str) -> None:
    if schema != name:
        raise InvalidInput(f"{where}: 'schema' is {str(schema)[:60]!r}; {name!r} is needed")
