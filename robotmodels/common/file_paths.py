"""Paths that people write: made absolute, checked, and told of in words."""

import errno
import os
import re
import stat
from pathlib import Path

from robotmodels.common.errors import InvalidInput


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
    target = absolute(path.resolve().parent, file)
    if not os.path.isfile(target):
        raise InvalidInput(f"{path}: {key}: {target}: no such file")
    return target


def absolute(beside: Path, path: str | Path) -> Path:
    """Return the absolute path that `path` means in a file of the folder `beside`."""
    # Functions of `os.path`: those of `Path` raise where a user has no home or links form a circle.
    return Path(os.path.realpath(beside / os.path.expanduser(path)))


def check_file(path: Path, most: int | None = None) -> None:
    """Refuse what is no file, or one of more than `most` bytes.

    Raises
    ------
    InvalidInput
        If `path` is absent, a folder, a device or a pipe, or too large.
    """
    try:
        status = path.stat()
    except FileNotFoundError:
        raise InvalidInput(f"{path}: no such file") from None
    except (OSError, ValueError) as error:  # ValueError for a path with a null character
        raise InvalidInput(f"{path}: cannot be read: {reason(error)}") from None
    if stat.S_ISDIR(status.st_mode):
        raise InvalidInput(f"{path}: cannot be read: it is a folder, a file is needed")
    if not stat.S_ISREG(status.st_mode):
        raise InvalidInput(f"{path}: cannot be read: it is a device or a pipe, a file is needed")
    if most is not None and status.st_size > most:
        raise InvalidInput(
            f"{path}: {status.st_size / 1e6:.3g} MB; a file of this kind has at most {most / 1e6:g}"
        )


def reason(error: Exception) -> str:
    """Return in a few words why a file cannot be read or written."""
    if isinstance(error, IsADirectoryError):
        return "it is a folder, a file is needed"
    if isinstance(error, UnicodeDecodeError):
        return "it is not UTF-8 text"
    words = getattr(error, "strerror", None) or str(error)
    inside = re.search(r"error message = '([^']+)'", words)  # of HDF5, amid its own variables
    return " ".join((inside[1] if inside else words).split())


def disk_full(error: BaseException | None) -> bool:
    """Whether an error, or one that led to it, says that a disk or a quota is full."""
    while error is not None:
        full = getattr(error, "errno", None) in (errno.ENOSPC, errno.EDQUOT)
        if full or os.strerror(errno.ENOSPC) in str(error):  # HDF5 tells in words only
            return True
        error = error.__cause__ or error.__context__
    return False
