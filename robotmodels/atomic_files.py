"""Files that appear under their names only when they are complete."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


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
        part.write_text(text, encoding="utf-8")
