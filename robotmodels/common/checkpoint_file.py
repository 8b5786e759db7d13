"""HDF5 files that keep finished work, so that an interrupted computation goes on from there.

The first `_HEADER` bytes, which HDF5 leaves to others, hold one line of JSON: ``schema``,
``fingerprint`` and ``digest``, a hash of both and of all bytes that follow. Nothing is read before
it fits, so neither HDF5 nor a caller ever meets numbers that are not those that were written.
"""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from robotmodels.common.atomic_files import atomic_write
from robotmodels.common.errors import InvalidInput
from robotmodels.common.fingerprints import file_digest

if TYPE_CHECKING:
    import h5py

_HEADER = 512


class UnusableCheckpoint(InvalidInput):
    """A file of finished work that is damaged, or belongs to something else."""


@dataclass(frozen=True)
class CheckpointFile:
    """A file of one kind of finished work, of one problem.

    Attributes
    ----------
    path : Path
        Path of the file, which is replaced as a whole whenever it is written.
    fingerprint : str
        Fingerprint of the problem and of the settings, so that other work is not continued.
    kind : str
        One word for its content; the schema is that and "/1".
    other : str
        Its content where the fingerprint is another one, in words.
    """

    path: Path
    fingerprint: str
    kind: str
    other: str

    @property
    def schema(self) -> str:
        """Kind and version."""
        return f"{self.kind}/1"

    @contextmanager
    def reading(self) -> "Iterator[h5py.File]":
        """Open the file.

        Raises
        ------
        UnusableCheckpoint
            If it is damaged or holds something else.
        InvalidInput
            If it cannot be read.
        """
        import h5py

        try:
            self._check()
            with h5py.File(self.path, "r") as file:
                yield file
        except OSError as error:
            raise InvalidInput(f"{self.path}: cannot be read ({error})") from error

    @contextmanager
    def writing(self) -> "Iterator[h5py.File]":
        """Open a new file that replaces the old one when the block ends without an error.

        Raises
        ------
        InvalidInput
            If it cannot be written.
        """
        import h5py

        try:
            with atomic_write(self.path) as part:
                with h5py.File(part, "w", userblock_size=_HEADER) as file:
                    yield file
                self._seal(part)
        except OSError as error:
            raise InvalidInput(f"{self.path}: cannot be written ({error})") from error

    def _line(self) -> bytes:
        if not self.path.is_file():
            return b""  # a pipe would not let go
        with self.path.open("rb") as file:
            return file.read(_HEADER)

    def _seal(self, part: Path) -> None:
        header = {
            "schema": self.schema,
            "fingerprint": self.fingerprint,
            "digest": _digest(part, self.schema, self.fingerprint),
        }
        with part.open("r+b") as file:
            file.write(json.dumps(header).encode().ljust(_HEADER - 1) + b"\n")

    def _check(self) -> None:
        """Refuse a file that is not as it was written, or not of this work."""
        try:
            header = json.loads(self._line())
            schema, fingerprint = header["schema"], header["fingerprint"]
            whole = header["digest"] == _digest(self.path, schema, fingerprint)
        except (ValueError, RecursionError, KeyError, TypeError):
            whole = False
        if not whole:
            raise UnusableCheckpoint(
                f"{self.path}: is not an HDF5 file of {self.kind} as it was written; if it was "
                "one, remove it and run the same again, otherwise name another file"
            )
        if (schema, fingerprint) != (self.schema, self.fingerprint):
            if schema != self.schema:
                wrong = f"'schema' is {schema!r}; {self.schema!r} is needed"
            else:
                wrong = f"holds {self.other}; remove the file or name another"
            raise UnusableCheckpoint(f"{self.path}: {wrong}")


def _digest(path: Path, *header: str) -> str:
    """Return the SHA-256 of a file's header and of all that follows it."""
    return file_digest(path, _HEADER, json.dumps(header).encode())
