"""Folders that a computation has for itself."""

import fcntl
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from robotmodels.atomic_files import created_folder, unwritable
from robotmodels.errors import InvalidInput

_LOCK = ".lock"


@contextmanager
def exclusive_folder(folder: Path) -> Iterator[None]:
    """Make a folder that no other process can use meanwhile.

    Raises
    ------
    InvalidInput
        If it cannot be made or written to, or another process is using it.
    """
    with created_folder(folder):
        descriptor = _locked(folder)
        try:
            yield
        finally:
            # By its holder only: whoever opened the file before is told by its inode, see below.
            (folder / _LOCK).unlink(missing_ok=True)
            os.close(descriptor)


def _locked(folder: Path) -> int:
    """Return the descriptor of the folder's locked lock file.

    The file that was opened may be another's, who takes it away before this process locks it: a
    lock counts only if its file still has the name.
    """
    path = folder / _LOCK
    while True:
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
        except FileNotFoundError:  # another process has taken the folder away
            folder.mkdir(parents=True, exist_ok=True)
            continue
        except OSError as error:
            raise unwritable(folder, error) from None
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.path.samestat(os.fstat(descriptor), os.stat(path)):
                return descriptor
        except BlockingIOError:
            os.close(descriptor)
            raise InvalidInput(f"output: {folder} is in use by another run") from None
        except FileNotFoundError:
            pass
        os.close(descriptor)


def remove(path: Path) -> None:
    """Take away whatever has that name: a folder with all in it, a file, a link that dangles."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
