"""Paths inside study and experiment files, which start at the file's own folder."""

from pathlib import Path

from robotmodels.errors import InvalidInput


def output_folder(path: Path, output: Path) -> Path:
    """Return the absolute folder that `output`, given in the file `path`, means.

    Raises
    ------
    InvalidInput : if there is a file of that name.
    """
    folder = path.resolve().parent / output.expanduser()
    if folder.exists() and not folder.is_dir():
        raise InvalidInput(f"{path}: output: {folder} is a file; a folder is needed")
    return folder.resolve()


def robot_reference(path: Path, robot: str) -> str:
    """Return `robot`, given in the file `path`: a built-in name as it is, a path absolute."""
    if robot.endswith((".yaml", ".yml")) or "/" in robot:
        return str((path.resolve().parent / Path(robot).expanduser()).resolve())
    return robot


def existing_file(path: Path, key: str, file: Path) -> Path:
    """Return the absolute path that `file`, the value of `key` in the file `path`, means.

    Raises
    ------
    InvalidInput : if there is no such file.
    """
    found = (path.resolve().parent / file.expanduser()).resolve()
    if not found.is_file():
        raise InvalidInput(f"{path}: {key}: {found}: no such file")
    return found
