"""Positions and visits from the design file that a study wrote, ``design.json``."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import ConfigDict, Field

from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.errors import InvalidInput
from robotmodels.common.yaml_files import FileSection, parse
from robotmodels.common.yaml_reader import Node
from robotmodels.data_files.json_text import read_json

_MOST_VISITS = 1_000_000  # to one position


class _Part(FileSection):
    """What an experiment needs of a design file, which holds more for other programs."""

    model_config = ConfigDict(extra="ignore")


class DesignedPosition(_Part):
    """A position of a design, and visits to it."""

    candidate: int = 0
    position: list[float]
    repetitions: Annotated[int, Field(ge=0, le=_MOST_VISITS)]


class DesignOrder(_Part):
    """The order of the visits."""

    candidates: list[int]


class DesignFile(_Part):
    """The positions of a design."""

    positions: Annotated[list[DesignedPosition], Field(min_length=1)]
    order: DesignOrder | None = None


def designed_positions(path: Path, robot: str) -> tuple[Array, IntArray]:
    """Return positions (Q, n) [rad] and visits to each (Q,), in the order of the visits.

    Parameters
    ----------
    robot : str
        Name of the robot, which the design must be for.

    Raises
    ------
    InvalidInput
        Naming the file and what is wrong in it.
    """
    try:
        document: Any = read_json(path)
    except InvalidInput as error:
        raise InvalidInput(f"design: {error}; `oed run` writes it") from None
    schema = document.get("schema") if isinstance(document, dict) else None
    if schema != "design/1":
        raise InvalidInput(f"design: {path}: schema is {str(schema)[:60]!r}; 'design/1' is needed")
    if document.get("robot") != robot:
        raise InvalidInput(
            f"design: {path} is for the robot {str(document.get('robot'))[:60]!r}, this "
            f"experiment's is {robot!r}"
        )
    design = parse(Node(0, document), DesignFile, f"design: {path}")
    rows = _as_visited(design, f"design: {path}")
    if len({len(row.position) for row in rows}) != 1:
        raise InvalidInput(f"design: {path}: positions: rows of equal length are needed, one a row")
    positions = np.array([row.position for row in rows], dtype=float)
    return positions, np.array([row.repetitions for row in rows], dtype=np.int64)


def _as_visited(design: DesignFile, where: str) -> list[DesignedPosition]:
    """Return a design's positions in the order of its visits, where it has one."""
    if design.order is None:
        return design.positions
    by_candidate = {row.candidate: row for row in design.positions}
    order = design.order.candidates
    if sorted(order) != sorted(row.candidate for row in design.positions):
        raise InvalidInput(f"{where}: order.candidates: {order[:8]} ... are not those of positions")
    return [by_candidate[candidate] for candidate in order]
