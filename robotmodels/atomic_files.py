"""Files and folders of files that appear under their names only when they are complete."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from robotmodels.errors import InvalidInput
from robotmodels.files import reason


@contextmanager
def atomic_write(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path that takes the place of `path` once all is written."""
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
