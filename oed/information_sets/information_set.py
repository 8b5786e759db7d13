"""What an experiment in each candidate position would tell about the parameters."""

import os
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from oed.information_sets.candidates import OneValue
from oed.information_sets.matrix_checks import check_matrices, check_positions
from robotmodels.common.arrays import Array, IntArray, read_only
from robotmodels.common.atomic_files import atomic_write
from robotmodels.common.deprecation import renamed_attributes
from robotmodels.common.errors import InvalidInput
from robotmodels.common.printing import ReprHtml
from robotmodels.data_files.array_schema import ArraySchema, Field
from robotmodels.data_files.hdf5_file import open_hdf5

if TYPE_CHECKING:
    from oed.information_sets.stored_information import StoredInformation

_FILE = ArraySchema(
    {
        "positions": Field(("candidate", "axis")),
        "matrices": Field(("candidate", "parameter", "parameter"), finite=False),
        "names": Field(("parameter",), "text"),
    }
)


@renamed_attributes("0.2", prices="directional_derivatives")
@dataclass(frozen=True, eq=False)
class InformationSet(OneValue, ReprHtml):
    """The information of one experiment in each of Q candidate positions.

    Attributes
    ----------
    positions : ndarray, (Q, n), rad
        Motor angles divided by gear ratios.
    matrices : ndarray, (Q, p, p)
        Symmetric, positive semidefinite, for ln theta unless the user says otherwise.
    names : tuple of str
        p parameter names.

    Raises
    ------
    InvalidInput
        Naming the candidate by its index, if a matrix is not finite, symmetric or positive
        semidefinite (to rounding); or if shapes do not fit.
    """

    positions: Array
    matrices: Array
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        positions = np.array(self.positions, dtype=float)
        matrices = np.array(self.matrices, dtype=float)
        names = tuple(self.names)
        _check_shapes(positions, matrices, names)
        check_positions(positions)
        check_matrices(matrices)
        matrices += np.swapaxes(matrices, -1, -2).copy()
        matrices *= 0.5
        self._set(positions, matrices, names)

    def _set(self, positions: Array, matrices: Array, names: tuple[str, ...]) -> None:
        object.__setattr__(self, "positions", read_only(positions))
        object.__setattr__(self, "matrices", read_only(matrices))
        object.__setattr__(self, "names", names)

    @classmethod
    def _of_sums(
        cls, positions: Array, matrices: Iterable[Array], names: tuple[str, ...]
    ) -> "InformationSet":
        """Return a set of matrices, in chunks, that are sums of squares wherever finite."""
        total, done = np.empty((len(positions), len(names), len(names))), 0
        for part in matrices:
            check_matrices(part, done, of_sums=True)
            np.add(part, np.swapaxes(part, 1, 2), out=total[done : done + len(part)])
            total[done : done + len(part)] *= 0.5
            done += len(part)
        info = cls.__new__(cls)
        info._set(positions.copy(), total, names)
        return info

    def __len__(self) -> int:
        return len(self.matrices)

    def __str__(self) -> str:
        return (
            f"information of {len(self)} candidates on {len(self.names)} parameters, "
            f"{self.rank} directions of which they inform on together"
        )

    @property
    def total(self) -> Array:
        """The sum of all candidates' information, (p, p)."""
        return np.asarray(self.matrices.sum(axis=0))

    def take(self, indices: IntArray) -> Array:
        """Return the matrices of some candidates, (n, p, p)."""
        return np.asarray(self.matrices[indices])

    def directional_derivatives(self, weight: Array) -> Array:
        """Return tr(W H_i), (Q,), for W, (p, p)."""
        return np.asarray(self.matrices.reshape(len(self), -1) @ weight.ravel())

    def combined(self, weights: Array) -> Array:
        """Return sum_i w_i H_i, (p, p), for weights (Q,)."""
        p, used = len(self.names), np.flatnonzero(weights)
        if len(used) > len(self) // 8:
            return np.asarray((weights @ self.matrices.reshape(len(self), -1)).reshape(p, p))
        return np.asarray((weights[used] @ self.take(used).reshape(len(used), p * p)).reshape(p, p))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write an HDF5 file with the datasets positions, matrices and names."""
        import h5py

        # A run that is interrupted while writing leaves no half file under the final name.
        with atomic_write(path) as unfinished, h5py.File(unfinished, "w") as file:
            file["positions"] = self.positions
            file["matrices"] = self.matrices
            file.create_dataset("names", data=list(self.names), dtype=h5py.string_dtype())

    @staticmethod
    def open(path: str | os.PathLike[str]) -> "StoredInformation":
        """Return the candidates of a store that `information` wrote, see `store`.

        Raises
        ------
        InvalidInput
            If there is no such file, it is no store, or it is cut off.
        """
        from oed.information_sets.stored_information import StoredInformation

        return StoredInformation.open(path)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "InformationSet":
        """Read what `save` wrote.

        Raises
        ------
        InvalidInput
            If there is no such file, it is not HDF5, or a dataset is missing.
        """
        with open_hdf5(path, "an information set is") as file:
            contents = file.read(_FILE)
        try:
            return cls(**contents)
        except InvalidInput as error:
            raise InvalidInput(f"{path}: {error}") from error


def _check_shapes(positions: Array, matrices: Array, names: tuple[str, ...]) -> None:
    p = len(names)
    if p == 0 or len(set(names)) != p:
        raise InvalidInput(f"names: {names!r} must be one distinct name per parameter")
    if matrices.ndim == 3 and len(matrices) == 0:
        raise InvalidInput("matrices: none given; at least one candidate is needed")
    if matrices.ndim != 3 or matrices.shape[1:] != (p, p):
        raise InvalidInput(
            f"matrices: shape {matrices.shape} does not fit {p} names; (Q, {p}, {p}) is needed"
        )
    if positions.ndim != 2 or len(positions) != len(matrices):
        raise InvalidInput(
            f"positions: shape {positions.shape} does not fit {len(matrices)} matrices; "
            f"({len(matrices)}, n) is needed"
        )
