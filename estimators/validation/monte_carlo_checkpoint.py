"""Runs of repeated experiments, kept in a file so that an interrupted series can go on."""

from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.common.checkpoint_file import CheckpointFile

Run = dict[str, Array] | str


class RunStore:
    """Results of runs in order, in an HDF5 file that is whole at any time.

    Parameters
    ----------
    path : Path
        Path of the file.
    fingerprint : str
        Fingerprint of the series, so that another one is not continued.
    """

    def __init__(self, path: Path, fingerprint: str) -> None:
        self.file = CheckpointFile(path, fingerprint, "runs", "another series of experiments")

    def load(self) -> list[Run]:
        """Return the runs that are kept: arrays, or the reason why there are none.

        Raises
        ------
        InvalidInput
            If the file holds something else.
        """
        if not self.file.path.exists():
            return []
        with self.file.reading() as file:
            reasons = file["reasons"].asstr()[:]
            arrays = {name: file[name][:] for name in file if name != "reasons"}
        return [
            reason or {name: array[i] for name, array in arrays.items()}
            for i, reason in enumerate(reasons)
        ]

    def save(self, runs: Sequence[Run]) -> None:
        """Write all runs so far.

        Raises
        ------
        InvalidInput
            If the file cannot be written.
        """
        shapes = next((run for run in runs if not isinstance(run, str)), {})
        reasons = [run if isinstance(run, str) else "" for run in runs]
        with self.file.writing() as file:
            file.create_dataset("reasons", data=reasons, dtype=h5py.string_dtype())
            for name, like in shapes.items():
                nothing = np.full(np.shape(like), np.nan)
                rows = [nothing if isinstance(run, str) else run[name] for run in runs]
                file.create_dataset(name, data=np.stack(rows))
