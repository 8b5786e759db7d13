"""Completed searches, stored in a file so that an interrupted multistart can go on."""

from pathlib import Path

import numpy as np

from estimators.fitting.fit_problem import FitProblem
from estimators.fitting.trust_region import SearchResult
from robotmodels.common.arrays import Array
from robotmodels.common.checkpoint_file import CheckpointFile
from robotmodels.common.fingerprints import fingerprint
from robotmodels.linear.response import network_of


def problem_fingerprint(
    problem: FitProblem, max_evaluations: int, tolerance: float, minimiser: str
) -> str:
    """Return a number that changes with anything that changes the outcome of a search."""
    inputs = (
        (problem.prior, max_evaluations, tolerance, minimiser),
        (problem.model.parameters, problem.bounds),
        problem.identity,
    )
    return fingerprint(inputs, network_of(problem.model, problem.positions))


class SearchStore:
    """Outcomes by stage and start, in an HDF5 file that is whole at any time.

    Raises
    ------
    InvalidInput
        If the file is another one, holds the searches of another problem, or cannot be written.
    """

    def __init__(self, path: Path, fingerprint: str) -> None:
        other = "searches of another model, estimate or setting"
        self.file = CheckpointFile(path, fingerprint, "searches", other)
        self._outcomes: dict[tuple[str, bytes], tuple[Array, SearchResult]] = {}
        if path.exists():
            self._read()

    def load(self, stage: str, start: Array) -> SearchResult | None:
        """Return the outcome of `start` (p,), or None."""
        entry = self._outcomes.get((stage, start.tobytes()))
        return None if entry is None else entry[1]

    def append(self, stage: str, start: Array, outcome: SearchResult) -> None:
        """Add an outcome; the file is replaced by a new one."""
        import h5py

        self._outcomes[stage, start.tobytes()] = start, outcome
        rows = [(stage, *row) for (stage, _), row in self._outcomes.items()]
        text = h5py.string_dtype()
        with self.file.writing() as file:
            file.create_dataset("stage", data=[s for s, _, _ in rows], dtype=text)
            file["starts"] = np.array([start for _, start, _ in rows])
            file["values"] = np.array([o.values for _, _, o in rows])
            file["cost"] = np.array([o.cost for _, _, o in rows])
            file["status"] = np.array([o.status for _, _, o in rows])
            file["evaluations"] = np.array([o.evaluations for _, _, o in rows])
            file.create_dataset("message", data=[o.message for _, _, o in rows], dtype=text)

    def _read(self) -> None:
        with self.file.reading() as file:
            columns = [file[name][()] for name in ("values", "cost", "status", "evaluations")]
            texts = [file[name].asstr()[()] for name in ("stage", "message")]
            for start, stage, message, values, cost, status, evaluations in zip(
                file["starts"][()], *texts, *columns, strict=True
            ):
                outcome = SearchResult(values, float(cost), int(status), message, int(evaluations))
                self._outcomes[stage, start.tobytes()] = start, outcome
