"""All ways to name candidate positions in one call, screened: what a study file asks for."""

import csv
import re
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from tokenize import TokenError
from typing import Any, Protocol

import numpy as np

from oed.candidates.grids import candidate_positions, sobol_positions
from oed.candidates.screening import ScreenedCandidates, screened_candidates
from oed.candidates.task_space import TaskBox, task_space_positions
from robotmodels.collision.obstacles import Obstacle
from robotmodels.collision.surroundings import Surroundings, surroundings
from robotmodels.common.arrays import Array, real_numbers
from robotmodels.common.errors import InvalidInput, nearest
from robotmodels.common.file_paths import check_file
from robotmodels.common.progress import Progress
from robotmodels.common.yaml_files import (
    MOST_CHARACTERS,
    FileSection,
    parse,
    read_text,
    yaml_document,
)
from robotmodels.common.yaml_reader import Node
from robotmodels.data_files.file_guard import library_errors
from robotmodels.description.ranges import Coordinate
from robotmodels.elastic.robot import ElasticRobot

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?|[+-]?(nan|inf)", re.IGNORECASE | re.ASCII)


class HasMotors(Protocol):
    """A robot with named motors and joints."""

    @property
    def motor_names(self) -> Sequence[str]:
        """Names of the n motors."""

    @property
    def motor_joints(self) -> Sequence[str]:
        """Names of their joints."""


class PositionList(FileSection, extra="ignore"):
    """Positions in a YAML file [rad or m]."""

    positions: list[list[Coordinate]]


def read_positions(path: str | Path, robot: HasMotors) -> Array:
    """Return the positions of a file, (Q, n) [rad or m].

    ``.csv``: a position per line, and if the first line is words, a column for each motor or joint
    that it names, in any order, also after a ``#``; ``.yaml``: a list of positions, or one under
    the key ``positions``; ``.npy``: an array (Q, n).

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


def _read_csv(path: Path, robot: HasMotors) -> list[list[float]]:
    with (
        library_errors(path, "a table of numbers as text", csv.Error),
        path.open(newline="", encoding="utf-8-sig") as file,
    ):
        lines = [
            (number, [cell.strip() for cell in row])
            for number, row in enumerate(csv.reader(file), start=1)
            if row and not _comment(row, robot)
        ]
    order = list(range(len(robot.motor_names)))
    lines = [(number, [cells[0].lstrip("# "), *cells[1:]]) for number, cells in lines]
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


def _comment(row: list[str], robot: HasMotors) -> bool:
    """Whether a row is a comment; one that names columns, as numpy.savetxt has it, is none."""
    first = row[0].strip()
    names = {*robot.motor_names, *robot.motor_joints}
    return first.startswith("#") and not {first.lstrip("# "), *map(str.strip, row[1:])} <= names


def _columns(path: Path, header: list[str], robot: HasMotors) -> list[int]:
    """Return which column each motor's positions are in."""
    names = list(robot.motor_names), list(robot.motor_joints)
    for name in header:
        if name not in names[0] and name not in names[1]:
            possible = (*names[0], *names[1])
            raise InvalidInput(
                f"{path}: column {name[:60]!r} is neither a motor nor a driven joint"
                f"{nearest(name, possible)}; there are {', '.join(possible)}"
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


def _read_yaml(path: Path, _: HasMotors) -> Any:
    content = "a list of positions"
    document = yaml_document(read_text(path, MOST_CHARACTERS, content), str(path), content)
    if isinstance(document.content, list):
        document = Node(1, {"positions": document.content}, {"positions": document})
    return parse(document, PositionList, str(path)).positions


def _read_npy(path: Path, _: HasMotors) -> Any:
    with library_errors(path, "a NumPy array file", TokenError):
        # Mapped, so that a shape beyond the end of the file is noticed before memory is taken.
        return np.lib.format.open_memmap(path, mode="r")


def _number(cell: str) -> bool:
    """Whether text is a number to any program: Python also takes 0_1 and digits of any script."""
    return _NUMBER.fullmatch(cell) is not None


@dataclass(frozen=True, eq=False)
class Workcell:
    """Obstacles and limits of a robot's cell, in plain values.

    Attributes
    ----------
    floor : float or None, m
        Its height above the root link's origin, against gravity; None for none.
    obstacles : sequence of Obstacle
        Planes, boxes and spheres in the root link's frame.
    self_collision : bool
        Whether links are compared with each other.
    link_radius : float or None, m
        Takes links for capsules, where the URDF has no collision shapes.
    margin : float, m
        Distance to keep.
    ignored : sequence of tuple of (str, str)
        Pairs of links that may touch.
    torque_limits : float or sequence of float or None, N m
        Torque limits that hold the arm and its payload, on the motor shafts, (n,) or one.
    """

    floor: float | None = None
    obstacles: Sequence[Obstacle] = ()
    self_collision: bool = True
    link_radius: float | None = None
    margin: float = 0.0
    ignored: Sequence[tuple[str, str]] = ()
    torque_limits: float | Sequence[float] | None = None

    def surroundings(self, robot: ElasticRobot) -> Surroundings | None:
        """Return what `robot` is compared with; None where nothing can be in its way.

        Raises
        ------
        InvalidInput
            As `robotmodels.surroundings`.
        """
        if self.floor is None and not self.obstacles and not self.self_collision:
            return None
        return surroundings(
            robot,
            floor=self.floor,
            obstacles=self.obstacles,
            self_collision=self.self_collision,
            link_radius=self.link_radius,
            margin=self.margin,
            ignored=self.ignored,
        )


def gathered_candidates(
    robot: ElasticRobot,
    *,
    per_joint: int | Sequence[int] | Mapping[str, int] | None = None,
    limits: Sequence[Sequence[float]] | Mapping[str, Sequence[float]] | Array | None = None,
    sobol: int = 0,
    boxes: Iterable[TaskBox] = (),
    files: Iterable[str | Path] = (),
    listed: Sequence[Sequence[float]] | Array = (),
    workcell: Workcell | None = None,
    rng: np.random.Generator | None = None,
    progress: Progress | None = None,
    executor: Executor | None = None,
) -> ScreenedCandidates:
    """Return the candidates of all sources that the robot can take in its cell.

    Without any source it is the usual joint grid.

    Parameters
    ----------
    robot : ElasticRobot
        The robot.
    per_joint : int, sequence of int or mapping of str to int, optional
        Points per joint of a joint grid, as in `candidate_positions`.
    limits : sequence of sequence of float, mapping of str to sequence of float or ndarray, optional
        Ranges of the grid and of the Sobol points.
    sobol : int
        Number of Sobol points; 0 for none.
    boxes : iterable of TaskBox
        Boxes in task space.
    files : iterable of str or Path
        Lists of positions, as in `read_positions`.
    listed : sequence of sequence of float or ndarray, (k, n)
        Positions by hand.
    workcell : Workcell, optional
        What may be in the way; None checks joint limits and duplicates only.
    rng : Generator, optional
        Scrambles the Sobol points and draws the starts of the inverse kinematics; None takes the
        plain Sobol points, and a fixed seed for the starts.
    progress : Progress, optional
        Called in the comparison with the surroundings: positions done and their total.
    executor : Executor, optional
        As in `screened_candidates`.

    Raises
    ------
    InvalidInput
        As the functions named above; with counts by reason, if none remains.
    """
    cell = Workcell(self_collision=False) if workcell is None else workcell
    boxes, files = tuple(boxes), tuple(files)
    parts, notes = [], []
    if per_joint is not None or not (sobol or boxes or files or len(listed)):
        parts.append(candidate_positions(robot, per_joint, limits))
    if sobol:
        parts.append(sobol_positions(robot, sobol, limits, rng))
    starts = np.random.default_rng(0) if rng is None else rng
    for box in boxes:
        reached = task_space_positions(robot, box, starts)
        parts.append(reached.positions)
        if len(reached.unreached):
            notes.append(
                f"{len(reached.unreached)} of {len(reached.targets)} points of the task box on "
                f"{box.link!r} are out of reach"
            )
    parts += [read_positions(path, robot) for path in files]
    parts += [_by_hand(listed, robot)] if len(listed) else []
    screened = screened_candidates(
        robot,
        parts.pop() if len(parts) == 1 else np.concatenate(parts),
        cell.surroundings(robot),
        torque_limits=cell.torque_limits,
        progress=progress,
        executor=executor,
    )
    return replace(screened, notes=(*notes, *screened.notes))


def _by_hand(listed: Sequence[Sequence[float]] | Array, robot: ElasticRobot) -> Array:
    n = len(robot.motor_names)
    for i, row in enumerate(listed):
        if len(row) != n:
            raise InvalidInput(
                f"positions[{i}]: {len(row)} angles; {n} are needed, one per motor "
                f"({', '.join(robot.motor_names)})"
            )
    return real_numbers(listed, "positions")
