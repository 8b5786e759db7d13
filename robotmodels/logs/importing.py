"""Logs imported in one call."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from robotmodels.common.file_paths import absolute
from robotmodels.data_files.file_guard import PathLike
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.library import builtin_robots, load_robot
from robotmodels.logs.importer import Import
from robotmodels.logs.mapping_file import Mapping, read_mapping
from robotmodels.logs.open_log import open_log
from robotmodels.records.movement import Movement


def import_movements(
    paths: PathLike | Sequence[PathLike],
    mapping: PathLike | Mapping,
    robot: ElasticRobot | None = None,
) -> tuple[Movement, ...]:
    """Return the movements of a log, each a run without gaps, in SI units on the joint side.

    Parameters
    ----------
    paths : path or sequence of paths
        Files of one recording.
    mapping : path or Mapping
        What their channels mean, or a file that says it (``schema: import/1``).
    robot : ElasticRobot, optional
        Names the joints and states gear ratios; by default the robot that the mapping names.

    Returns
    -------
    tuple of Movement
        With provenance: digests of the files, mapping, changes.

    Raises
    ------
    InvalidInput
        Naming the file, the channel or the entry of the mapping at fault.
    """
    with opened_import(paths, mapping, robot) as source:
        return tuple(run.read() for run in source.runs)


@contextmanager
def opened_import(
    paths: PathLike | Sequence[PathLike],
    mapping: PathLike | Mapping,
    robot: ElasticRobot | None = None,
) -> Iterator[Import]:
    """Open a log with its mapping; arguments as in `import_movements`."""
    choice = mapping if isinstance(mapping, Mapping) else read_mapping(mapping)
    beside = None if isinstance(mapping, Mapping) else Path(mapping).parent
    with open_log(paths) as log:
        yield Import(log, choice, robot or mapped_robot(choice, beside))


def mapped_robot(mapping: Mapping, beside: Path | None = None) -> ElasticRobot | None:
    """Return the robot that a mapping names, None where it names none.

    Parameters
    ----------
    beside : Path, optional
        Folder that the path of a robot file starts at.
    """
    if not mapping.robot:
        return None
    if mapping.robot in builtin_robots() or beside is None:
        return load_robot(mapping.robot)
    return load_robot(absolute(beside, mapping.robot))
