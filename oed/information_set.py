"""What an experiment in each candidate position would tell about the parameters."""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from robotmodels.arrays import Array, IntArray, read_only
from robotmodels.errors import InvalidInput
from robotmodels.noise import LoopNoise, RelativeNoise
from robotmodels.response import Elastic, sensitivity

# Rounding leaves a singular information matrix of unit diagonal with eigenvalues near 1e-15.
_RANK_TOLERANCE = 1e-12
_SYMMETRY_TOLERANCE = 1e-9


def unit_diagonal_scaling(matrices: Array) -> Array:
    """Return s, (..., p), such that s_i H_ij s_j has a diagonal of ones, or zero where H_ii is.

    A parameter's unit then has no say in ranks, inverses and determinants.
    """
    diagonal = np.abs(np.diagonal(matrices, axis1=-2, axis2=-1))
    # Sensitivities that are zero but for rounding, 1e-16 of the largest, stay zero.
    floor = (16 * np.finfo(float).eps) ** 2 * diagonal.max(axis=-1, keepdims=True)
    usable = (diagonal > floor) & (diagonal > 0)
    return np.where(usable, 1.0 / np.sqrt(np.where(usable, diagonal, 1.0)), 0.0)


def weak_directions(matrix: Array) -> Array:
    """Return an orthonormal basis, (p, k), of the null space of the scaled information (p, p)."""
    s = unit_diagonal_scaling(matrix)
    eigenvalues, vectors = np.linalg.eigh(s[:, None] * matrix * s)
    return np.asarray(vectors[:, eigenvalues <= _RANK_TOLERANCE * max(eigenvalues[-1], 1.0)])


def unidentifiable(matrix: Array, names: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the parameters on which `matrix` (p, p) leaves a direction open."""
    part = np.linalg.norm(weak_directions(matrix), axis=1)
    return tuple(name for name, share in zip(names, part, strict=True) if share > 0.01)


@dataclass(frozen=True, eq=False)
class InformationSet:
    """The information of one experiment in each of Q candidate positions.

    Attributes
    ----------
    positions : (Q, n) motor angles divided by gear ratios [rad].
    matrices : (Q, p, p) symmetric, positive semidefinite, for ln theta unless the user says
        otherwise.
    names : p parameter names.

    Raises
    ------
    InvalidInput : naming the candidate by its index, if a matrix is not finite, symmetric or
        positive semidefinite (to rounding); or if shapes do not fit.
    """

    positions: Array
    matrices: Array
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        positions = np.array(self.positions, dtype=float)
        matrices = np.array(self.matrices, dtype=float)
        names = tuple(self.names)
        _check_shapes(positions, matrices, names)
        _check_values(positions, matrices)
        matrices += np.swapaxes(matrices, -1, -2).copy()
        matrices *= 0.5
        object.__setattr__(self, "positions", read_only(positions))
        object.__setattr__(self, "matrices", read_only(matrices))
        object.__setattr__(self, "names", names)

    def __len__(self) -> int:
        return len(self.matrices)

    @property
    def total(self) -> Array:
        """The sum of all candidates' information, (p, p)."""
        return np.asarray(self.matrices.sum(axis=0))

    @property
    def samples(self) -> int:
        """The number of parameter values the information was computed for: one."""
        return 1

    def take(self, indices: IntArray) -> Array:
        """Return the matrices of some candidates, (n, p, p)."""
        return np.asarray(self.matrices[indices])

    def prices(self, weight: Array) -> Array:
        """Return tr(W H_i), (Q,), for W, (p, p)."""
        return np.asarray(self.matrices.reshape(len(self), -1) @ weight.ravel())

    def combined(self, weights: Array) -> Array:
        """Return sum_i w_i H_i, (p, p), for weights (Q,)."""
        used = np.flatnonzero(weights)
        return np.asarray(np.tensordot(weights[used], self.take(used), axes=1))

    def chunks(self, size: int = 4096) -> Iterator[tuple[int, Array]]:
        """Yield the index of the first candidate of each chunk, and its matrices (n, p, p)."""
        for start in range(0, len(self), size):
            yield start, self.matrices[start : start + size]

    @property
    def rank(self) -> int:
        """The number of parameter directions that all candidates together inform on."""
        return len(self.names) - int(weak_directions(self.total).shape[1])

    def unidentifiable(self, total: Array | None = None) -> tuple[str, ...]:
        """Return the parameters left open by `total` (p, p), by default by all candidates."""
        return unidentifiable(self.total if total is None else total, self.names)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write an HDF5 file with the datasets positions, matrices and names."""
        import h5py

        target = Path(path)
        # A run that is interrupted while writing leaves no half file under the final name.
        partial_file = target.with_name(target.name + ".part")
        with h5py.File(partial_file, "w") as file:
            file["positions"] = self.positions
            file["matrices"] = self.matrices
            file.create_dataset("names", data=list(self.names), dtype=h5py.string_dtype())
        partial_file.replace(target)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "InformationSet":
        """Read what `save` wrote.

        Raises
        ------
        InvalidInput : if there is no such file, it is not HDF5, or a dataset is missing.
        """
        import h5py

        if not Path(path).is_file():
            raise InvalidInput(f"{path}: no such file; an information set is needed")
        if not h5py.is_hdf5(path):
            raise InvalidInput(f"{path}: not an HDF5 file; an information set is needed")
        with h5py.File(path, "r") as file:
            for key in ("positions", "matrices", "names"):
                if key not in file:
                    raise InvalidInput(
                        f"{path}: dataset {key!r} is missing (found: {', '.join(file) or 'none'})"
                    )
            names = tuple(str(name) for name in file["names"].asstr()[:])
            try:
                return cls(file["positions"][:], file["matrices"][:], names)
            except InvalidInput as error:
                raise InvalidInput(f"{path}: {error}") from error


def information(
    robot: Elastic,
    positions: Array,
    omega: Array,
    noise: RelativeNoise | LoopNoise,
    chunk: int = 64,
    executor: Executor | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> InformationSet:
    """Return the information of one experiment in each position, equilibria held fixed.

    For the built-in robots the latter changes no standard deviation by more than 0.15 % (15 random
    positions, 2 to 80 Hz); see `robotmodels.sensitivity` for what it leaves out.

    Parameters
    ----------
    robot : a model with `parameters` and `network(positions)`.
    positions : (Q, n) [rad].
    omega : (F,) [rad/s].
    noise : the noise law of the FRF estimates; a `ClosedLoopNoise` knows the experiment.
    chunk : positions per call of the kernel, which bounds the memory.
    executor : computes chunks in parallel; None computes here.
    progress : called with the number of positions done and their total.

    Raises
    ------
    InvalidInput : if there is no position, or `chunk` is not positive.
    NoEquilibrium : if the springs cannot carry the robot's weight in a position.
    """
    positions = np.atleast_2d(np.asarray(positions, dtype=float))
    if positions.size == 0:
        raise InvalidInput("positions: none given; at least one candidate position is needed")
    if chunk < 1:
        raise InvalidInput(f"chunk: {chunk} positions per call; at least 1 is needed")
    chunks = [positions[start : start + chunk] for start in range(0, len(positions), chunk)]
    one_chunk = partial(_chunk_information, robot, np.asarray(omega, dtype=float), noise)
    matrices: list[Array] = []
    done = 0
    for part in map(one_chunk, chunks) if executor is None else executor.map(one_chunk, chunks):
        matrices.append(part)
        done += len(part)
        if progress is not None:
            progress(done, len(positions))
    return InformationSet(positions, np.concatenate(matrices), robot.parameters.names)


def _chunk_information(
    robot: Elastic, omega: Array, noise: RelativeNoise | LoopNoise, positions: Array
) -> Array:
    # Imported when used: a user's own matrices need neither.
    import robotmodels.kernel as kernel
    from estimators.information import information as fisher_information

    network = robot.network(positions)
    plain = network.only_springs and network.measurement is None
    if plain and isinstance(noise, RelativeNoise):
        return np.asarray(kernel.information(network, omega, noise))
    # The kernel knows springs, dampers, motor accelerations and independent elements; the rest
    # takes the general way.
    response, jacobian = sensitivity(robot, positions, omega, sag=False)
    if isinstance(noise, RelativeNoise):
        return fisher_information(jacobian, 1.0 / noise.variance(response))
    return fisher_information(jacobian, noise.weights(network, omega))


def _check_shapes(positions: Array, matrices: Array, names: tuple[str, ...]) -> None:
    p = len(names)
    if p == 0 or len(set(names)) != p:
        raise InvalidInput(f"names: {names!r} must be one distinct name per parameter")
    if matrices.ndim != 3 or matrices.shape[1:] != (p, p) or len(matrices) == 0:
        raise InvalidInput(
            f"matrices: shape {matrices.shape} does not fit {p} names; (Q, {p}, {p}) is needed"
        )
    if positions.ndim != 2 or len(positions) != len(matrices):
        raise InvalidInput(
            f"positions: shape {positions.shape} does not fit {len(matrices)} matrices; "
            f"({len(matrices)}, n) is needed"
        )


def _check_values(positions: Array, matrices: Array) -> None:
    _refuse(~np.isfinite(positions).all(axis=1), "a position that is not finite")
    _refuse(~np.isfinite(matrices).all(axis=(1, 2)), "a matrix that is not finite")
    s = unit_diagonal_scaling(matrices)
    # What is zero but for rounding is judged against the largest entry.
    least = np.where(s > 0, s, np.inf).min(axis=1, keepdims=True)
    s = np.where(s > 0, s, np.where(np.isfinite(least), least, 1.0))
    scaled = s[:, :, None] * matrices * s[:, None, :]
    skew = np.abs(scaled - np.swapaxes(scaled, 1, 2)).max(axis=(1, 2))
    _refuse(skew > _SYMMETRY_TOLERANCE, "a matrix that is not symmetric")
    try:  # one factorisation of all is much cheaper than their eigenvalues
        np.linalg.cholesky(scaled + _SYMMETRY_TOLERANCE * np.eye(matrices.shape[-1]))
    except np.linalg.LinAlgError:
        lowest = np.linalg.eigvalsh(scaled)[:, 0]
        _refuse(lowest < -0.5 * _SYMMETRY_TOLERANCE, "a matrix that is not positive semidefinite")


def _refuse(wrong: ArrayLike, what: str) -> None:
    wrong = np.asarray(wrong)
    if wrong.any():
        raise InvalidInput(
            f"candidate {int(np.argmax(wrong))} has {what} ({int(wrong.sum())} of {len(wrong)} do)"
        )
