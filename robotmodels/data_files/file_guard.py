"""What libraries raise over files that are damaged, and names that are safe to print."""

import os
import struct
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import numpy as np

from robotmodels.common.errors import InvalidInput
from robotmodels.common.file_paths import reason

PathLike = str | os.PathLike[str]
_MOST_NAMES, _MOST_LETTERS = 12, 40  # that an error lists, of each

# All that h5py, scipy.io, zlib, pyuff and numpy were seen to raise over mutated files. The list is
# broad on purpose and belongs around calls of these libraries only, never around code of our own.
LIBRARY_ERRORS = (
    OSError,
    RuntimeError,  # h5py, for most of HDF5's errors; NotImplementedError, RecursionError
    LookupError,
    ValueError,  # UnicodeError among them
    TypeError,
    AttributeError,
    ArithmeticError,  # OverflowError among them
    AssertionError,
    MemoryError,
    EOFError,
    BufferError,
    SystemError,
    SyntaxError,  # numpy parses the headers of its files
    struct.error,
    zlib.error,
)


@contextmanager
def library_errors(where: object, container: str, *more: type[Exception]) -> Iterator[None]:
    """Turn what a library raises over a file into an InvalidInput.

    Parameters
    ----------
    where : object
        File, and the group or key in it.
    container : str
        What the library takes the file for, in words.
    more : type
        Exceptions that only one library raises.
    """
    try:
        with np.errstate(all="ignore"):
            yield
    except InvalidInput:
        raise
    except LIBRARY_ERRORS + more as error:
        why = "not enough memory" if isinstance(error, MemoryError) else reason(error)
        cause = why[:200] or type(error).__name__
        raise InvalidInput(f"{where}: not {container} ({cause})") from None


def listed(names: Iterable[object]) -> str:
    """Return names from a file as a short list that is safe to print."""
    quoted = [
        ascii(str(name)) if not str(name).isprintable() else repr(str(name)) for name in names
    ]
    cut = [n if len(n) <= _MOST_LETTERS else f"{n[: _MOST_LETTERS - 4]}...'" for n in quoted]
    more = f" and {len(cut) - _MOST_NAMES} more" if len(cut) > _MOST_NAMES else ""
    return ", ".join(cut[:_MOST_NAMES]) + more if cut else "nothing"
