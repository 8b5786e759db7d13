"""Paths inside study and experiment files, which start at the file's own folder."""

import os
from pathlib import Path

from robotmodels.errors import InvalidInput
from robotmodels.files import absolute


def output_folder(path: Path, output: Path) -> Path:
    """Return the absolute folder that `output`, given in the file `path`, means.

    Raises
    ------
    InvalidInput
        If there is a file of that name.
    """
    folder = absolute(path.resolve().parent, output)
    if os.path.exists(folder) and not os.path.isdir(folder):
        raise InvalidInput(f"{path}: output: {folder} is a file; a folder is needed")
    return folder


def robot_reference(path: Path, robot: str) -> str:
    """Return `robot`, given in the file `path`: a built-in name as it is, a path absolute."""
    if robot.endswith((".yaml", ".yml")) or "/" in robot:
        return str(absolute(path.resolve().parent, robot))
    return robot


def existing_file(path: Path, key: str, file: Path) -> Path:
    """Return the absolute path that `file`, the value of `key` in the file `path`, means.

    Raises
    ------
    InvalidInput
        If there is no such file.
    """
    found = absolute(path.resolve().parent, file)
    if not os.path.isfile(found):
        raise InvalidInput(f"{path}: {key}: {found}: no such file")
    return found
