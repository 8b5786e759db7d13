"""Files and folders that appear under their names only when they are complete."""

import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from robotmodels.common.errors import InvalidInput
from robotmodels.common.file_paths import reason


@contextmanager
def atomic_write(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path that replaces `path` when the block ends without an error."""
    target = Path(path)
    unfinished = target.with_name(f"{target.stem}.part{target.suffix}")
    try:
        yield unfinished
        unfinished.replace(target)
    except BaseException:
        unfinished.unlink(missing_ok=True)
        raise


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a text file that appears under its name when it is complete."""
    with atomic_write(path) as part:
        try:
            part.write_text(text, encoding="utf-8")
        except OSError as error:  # of a write, it names no file
            error.filename = error.filename or os.fspath(path)
            raise


@contextmanager
def staged_folder(folder: Path) -> Iterator[Path]:
    """Give a folder to write in; its files move to `folder`, one by one whole, if all went well.

    Raises
    ------
    InvalidInput
        If `folder` cannot be written to.
    """
    with created_folder(folder):
        try:
            stage = Path(tempfile.mkdtemp(prefix=".unfinished-", dir=folder))
        except OSError as error:
            raise unwritable(folder, error) from None
        try:
            yield stage
            for file in sorted(stage.iterdir()):
                try:
                    os.replace(file, folder / file.name)
                except OSError as error:  # a folder of that name, say
                    raise unwritable(folder / file.name, error) from None
        finally:
            shutil.rmtree(stage)


@contextmanager
def created_folder(folder: Path) -> Iterator[None]:
    """Make a folder and its parents; those in which nothing came to be are taken away again.

    Raises
    ------
    InvalidInput
        If it cannot be made.
    """
    absent = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(folder, error) from None
    try:
        yield
    finally:
        with suppress(OSError):  # deepest first, up to one that holds something
            for path in absent:
                path.rmdir()


def unwritable(folder: Path, error: OSError) -> InvalidInput:
    """Return the error of an output folder that cannot be written to."""
    return InvalidInput(f"output: {folder} cannot be written to ({reason(error)})")


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
            raise InvalidInput(
                f"output: {folder} is in use by another run; try again when it has ended"
            ) from None
        except FileNotFoundError:
            pass
        os.close(descriptor)


def remove(path: Path) -> None:
    """Take away whatever has that name: a folder with all in it, a file, a link that dangles."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
