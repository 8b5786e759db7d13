"""HDF5 files that keep finished work, so that what is interrupted can go on; whole at any time."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from robotmodels.errors import InvalidInput
from robotmodels.replacing import replacing

if TYPE_CHECKING:
    import h5py


@dataclass(frozen=True)
class KeptFile:
    """A file of one kind of finished work, of one problem.

    Attributes
    ----------
    path : of the file.
    fingerprint : of the problem and of the settings, so that other work is not continued.
    kind : what it holds, one word; the file's attribute "schema" is that and "/1".
    other : what it holds where the fingerprint is another one, in words.
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
        InvalidInput : if it holds something else.
        """
        import h5py

        try:
            with h5py.File(self.path, "r") as file:
                found = file.attrs.get("schema", self.schema)
                if found != self.schema:
                    raise InvalidInput(
                        f"{self.path}: 'schema' is {found!r}; {self.schema!r} is needed"
                    )
                if file.attrs.get("fingerprint") != self.fingerprint:
                    raise InvalidInput(
                        f"{self.path}: holds {self.other}; remove the file or name another"
                    )
                yield file
        except (OSError, KeyError) as error:
            raise InvalidInput(
                f"{self.path}: is not an HDF5 file of {self.kind} ({error})"
            ) from error

    @contextmanager
    def writing(self) -> "Iterator[h5py.File]":
        """Open a new file that takes the place of the old one once all is written.

        Raises
        ------
        InvalidInput : if it cannot be written.
        """
        import h5py

        try:
            with replacing(self.path) as part, h5py.File(part, "w") as file:
                file.attrs["schema"], file.attrs["fingerprint"] = self.schema, self.fingerprint
                yield file
                file.flush()
        except OSError as error:
            raise InvalidInput(f"{self.path}: cannot be written ({error})") from error
