"""A store whose matrices are written by the workers that compute them.

Only their sums travel. A worker that does not see the file, on a machine that does not share its
folder, sends the matrices instead.
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from oed.information_sets.stored_information import (
    StoredInformation,
    begun_store,
    packed_matrices,
    write_total,
)
from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput
from robotmodels.common.progress import Progress, tell


def store_by_workers(
    path: str | os.PathLike[str],
    positions: Array,
    names: Sequence[str],
    work: Callable[[Array], Array],
    chunk: int,
    executor: Executor,
    progress: Progress | None = None,
) -> StoredInformation:
    """Return a store of sums of squares, (p, p) for each position, with the bits of `write_store`.

    Parameters
    ----------
    path : str or os.PathLike[str]
        Path of the file, which appears under its name when it is complete.
    positions : ndarray, (Q, n), rad
        Positions.
    names : sequence of str
        p parameter names.
    work : callable
        Makes the matrices (n, p, p) of some positions.
    chunk : int
        Positions in a task.
    executor : Executor
        Gives the tasks to workers.
    progress : Progress, optional
        Called with the number of positions done and their total.

    Raises
    ------
    InvalidInput
        As `write_store`; if a worker that sees the file cannot write to it.
    """
    total = np.zeros(len(names) * (len(names) + 1) // 2)
    with begun_store(path, positions, names) as file:
        first, row = file.tell(), total.nbytes
        file.truncate(first + len(positions) * row)
        file.flush()
        starts = range(0, len(positions), chunk)
        task = _Writing(work, os.path.abspath(file.name), first, len(positions))
        parts = (positions[start : start + chunk] for start in starts)
        for start, answer in zip(starts, executor.map(task, starts, parts), strict=True):
            if answer.ndim == 2:
                file.seek(first + start * row)
                file.write(answer.tobytes())
                answer = answer.sum(axis=0)
            total += answer
            tell(progress, min(start + chunk, len(positions)), len(positions))
        write_total(file, total)
    return StoredInformation.open(path)


@dataclass(frozen=True, eq=False)
class _Writing:
    """What a worker does: compute matrices and write them where they belong.

    Attributes
    ----------
    work : callable
        Makes the matrices (n, p, p) of some positions.
    path : str
        Path of the unfinished file, the same on all machines.
    first : int
        Where its matrices begin.
    candidates : int
        How many there will be.
    """

    work: Callable[[Array], Array]
    path: str
    first: int
    candidates: int

    def __call__(self, start: int, positions: Array) -> Array:
        """Return the sum of packed matrices, (p (p + 1) / 2,), or all of them, (n, ...).

        The latter where the file is not there; tasks may be begun twice.
        """
        packed = packed_matrices(self.work(positions), start, of_sums=True)
        row = packed.shape[1] * packed.itemsize
        try:
            if os.path.getsize(self.path) != self.first + self.candidates * row:
                return packed
            with open(self.path, "r+b") as file:
                file.seek(self.first + start * row)
                file.write(packed.tobytes())
        except FileNotFoundError:
            return packed
        except OSError as error:
            raise InvalidInput(f"{self.path}: cannot be written: {error.strerror}") from error
        return np.asarray(packed.sum(axis=0))
