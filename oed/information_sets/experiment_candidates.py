"""Candidates that are experiments: a position, an excitation, and a number of periods."""

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from oed.information_sets.candidates import Candidates, InformationSamples
from oed.information_sets.compute import ChunkInformation, Prepared, counted, in_chunks
from oed.information_sets.excitations import Excitation, VisitTiming, checked_excitations
from oed.information_sets.information_set import InformationSet
from oed.information_sets.matrix_checks import candidate_rows
from robotmodels.common.arrays import (
    Array,
    ComplexArray,
    IntArray,
    check_above_zero,
    check_count,
    check_memory,
    one_or_each,
    read_only,
)
from robotmodels.common.errors import InvalidInput
from robotmodels.common.printing import ReprHtml
from robotmodels.common.progress import Progress
from robotmodels.linear.noise import ExcitationNoise, OutputErrors
from robotmodels.linear.response import Elastic, check_omega

_SHOWN = 4  # excitations whose names are printed


@dataclass(frozen=True, eq=False)
class RepeatedCandidates:
    """Candidates that are multiples of fewer ones, without matrices of their own.

    Attributes
    ----------
    base : Candidates
        Candidates with matrices.
    index : ndarray of int, (Q,)
        Candidate of the base behind each one.
    factor : ndarray, (Q,)
        Multiple of its information.
    """

    base: Candidates
    index: IntArray
    factor: Array

    def __len__(self) -> int:
        return len(self.index)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the p parameters."""
        return self.base.names

    @property
    def samples(self) -> int:
        """Number K of parameter values."""
        return self.base.samples

    def take(self, indices: IntArray) -> Array:
        """Return matrices, see `Candidates`."""
        matrices = self.base.take(self.index[indices])
        factors = self.factor[indices].reshape(-1, *(1,) * (matrices.ndim - 1))
        return np.asarray(factors * matrices)

    def directional_derivatives(self, weight: Array) -> Array:
        """Return tr(W H_i), see `Candidates`."""
        return np.asarray(self.factor * self.base.directional_derivatives(weight)[self.index])

    def combined(self, weights: Array) -> Array:
        """Return sum_i w_i H_i, see `Candidates`."""
        total = np.bincount(self.index, weights * self.factor, len(self.base)).astype(float)
        return self.base.combined(total)


@dataclass(frozen=True, eq=False)
class ExperimentCandidates(ReprHtml):
    """Visits that could be made: excitation by excitation, positions inside.

    With several numbers of periods, one such table after the other.

    Attributes
    ----------
    positions : ndarray, (Q, n), rad
        Positions.
    excitations : tuple of Excitation
        The E excitations.
    periods : tuple of int
        Numbers of measured periods of a run.
    timing : VisitTiming
        What takes how long.
    information : Candidates
        Information of each visit: an `InformationSet` for one number of periods in memory.
    duration : ndarray, (P E Q,), s
        Duration of each visit, its move included.
    """

    positions: Array
    excitations: tuple[Excitation, ...]
    periods: tuple[int, ...]
    timing: VisitTiming
    information: Candidates
    duration: Array

    def __len__(self) -> int:
        return len(self.duration)

    @classmethod
    def of_samples(cls, tables: Sequence["ExperimentCandidates"]) -> "ExperimentCandidates":
        """Return the same visits with the information of each sample of theta, a table each.

        Raises
        ------
        InvalidInput
            If there is no table, or they are not of the same visits.
        """
        if not tables:
            raise InvalidInput("samples: no table given; at least one is needed")
        if any(not np.array_equal(one.duration, tables[0].duration) for one in tables):
            raise InvalidInput(
                "samples: tables of other visits; the same positions, excitations, "
                "periods and timing are needed"
            )
        samples = InformationSamples(tuple(one.information for one in tables))
        return replace(tables[0], information=samples)

    def visit(self, index: int) -> tuple[int, Excitation, int]:
        """Return the position's index, the excitation and the periods of a candidate."""
        shape = len(self.periods), len(self.excitations), len(self.positions)
        p, e, q = (int(i) for i in np.unravel_index(index, shape))
        return q, self.excitations[e], self.periods[p]

    @property
    def run_times(self) -> tuple[IntArray, Array, Array]:
        """Runs of each excitation's visit, its time without periods and that of each, (E,) [s]."""
        motors = self.positions.shape[1]
        runs = np.array([one.runs(motors) for one in self.excitations])
        return runs, self.timing.visit + runs * self.timing.transient, runs * self.timing.period

    def __str__(self) -> str:
        names = ", ".join(one.name for one in self.excitations[:_SHOWN])
        if len(self.excitations) > _SHOWN:
            names += f" and {len(self.excitations) - _SHOWN} more"
        return (
            f"{len(self)} visits: {len(self.positions)} positions, {names}, "
            f"{', '.join(map(str, self.periods))} periods, "
            f"{self.duration.min():.0f} to {self.duration.max():.0f} s"
        )


def experiment_candidates(
    robot: Elastic,
    positions: Array,
    excitations: Sequence[str | Excitation],
    omega: Array,
    noise: OutputErrors,
    *,
    torque: ArrayLike = 1.0,
    periods: int | Sequence[int] = 2,
    timing: VisitTiming | None = None,
    chunk: int = 256,
    executor: Executor | None = None,
    progress: Progress | None = None,
    store: str | os.PathLike[str] | None = None,
) -> ExperimentCandidates:
    """Return the information and the duration of every excitation in every position.

    Parameters
    ----------
    robot : Elastic
        A model with `parameters` and `network(positions)`; its equilibria are fixed.
    positions : ndarray, (Q, n), rad
        Positions.
    excitations : sequence of str or Excitation
        "orthogonal", "zippered", "random_phase", "single_motors", or objects.
    omega : ndarray, (F,), rad/s
        Excited lines, all of them: of every sixth line zippered runs tell less than they do.
    noise : OutputErrors
        Noise of one period, such as `robotmodels.InputOutputNoise`.
    torque : float or array_like, (n,), N m
        Root mean square torque of each motor in a run, over all lines.
    periods : int or sequence of int
        Measured periods of a run, each number a candidate.
    timing : VisitTiming, optional
        Seconds of moves, settling, transients and periods.
    chunk : int
        The most positions per call of the kernel, which bounds the memory.
    executor : Executor, optional
        Computes chunks in parallel.
    progress : Progress, optional
        Called with the number of positions done and their total.
    store : str or os.PathLike[str], optional
        Path of a file for more matrices than memory holds.

    Raises
    ------
    InvalidInput
        If there is no position, excitation or number of periods, a torque is not positive, or the
        noise does not tell errors of outputs from those of torques.
    NoEquilibrium
        If the springs cannot carry the robot's weight in a position.
    """
    positions = candidate_rows(positions)
    if not hasattr(noise, "output_error"):
        raise InvalidInput(
            f"noise: {type(noise).__name__} does not separate errors of torques from those of "
            "outputs; an InputOutputNoise does"
        )
    omega, n = check_omega(omega), positions.shape[1]
    families = checked_excitations(excitations, n)
    levels = _levels(torque, n)
    spectra = np.array([one.spectrum(levels, len(omega)) for one in families])
    counts = tuple(
        check_count(count, "periods")
        for count in np.atleast_1d(np.asarray(periods, dtype=object)).tolist()
    )
    timing = timing or VisitTiming()
    work = _Excitations(robot, omega, noise, spectra)
    parts = counted(in_chunks(work, positions, chunk, executor), len(positions), progress)
    if len(counts) == 1:
        parts = (counts[0] * part for part in parts)
    information = _information(positions, parts, len(families), robot.parameters.names, store)
    durations = [timing.duration(one.runs(n), count) for count in counts for one in families]
    return ExperimentCandidates(
        read_only(positions.copy()),
        families,
        counts,
        timing,
        _repeated(information, len(positions), len(families), counts),
        read_only(np.repeat(durations, len(positions))),
    )


def _levels(torque: ArrayLike, motors: int) -> Array:
    """Return the torque of each motor, (n,)."""
    levels = one_or_each(torque, motors, "torque")
    for level in levels.tolist():
        check_above_zero(level, "torque [N m]")
    return levels


@dataclass(frozen=True, eq=False)
class _Excitations:
    """Positions (Q, n) to the information (Q, E, p, p) of one period of each excitation."""

    robot: Elastic
    omega: Array
    errors: OutputErrors
    spectra: ComplexArray

    def __call__(self, positions: Array) -> Array:
        """Return the information, (Q, E, p, p)."""
        return self.finish(self.prepare(positions))

    def prepare(self, positions: Array) -> Prepared:
        """Return the positions and the linearisation there."""
        return self._single(0).prepare(positions)

    def finish(self, prepared: Prepared) -> Array:
        """Return the information, by the kernel or one excitation after the other."""
        _, linearised = prepared
        single = self._single(0)
        if linearised is not None and linearised[1] is None and single.suits_kernel(linearised[0]):
            # Imported when used: user-defined matrices do not need it.
            import robotmodels.kernel as kernel

            return kernel.excitation_informations(
                linearised[0], self.omega, self.spectra, self.errors
            )
        parts = [self._single(e).finish(prepared) for e in range(len(self.spectra))]
        return np.stack(parts, axis=1)

    def _single(self, excitation: int) -> ChunkInformation:
        noise = ExcitationNoise(self.spectra[excitation], self.errors)
        return ChunkInformation(self.robot, self.omega, noise)


def _information(
    positions: Array,
    parts: Iterator[Array],
    excitations: int,
    names: tuple[str, ...],
    store: str | os.PathLike[str] | None,
) -> Candidates:
    """Return the information of all parts: in memory by excitations, in a store by positions."""
    if store is not None:
        from oed.information_sets.stored_information import write_store

        chunks = (part.reshape(-1, *part.shape[2:]) for part in parts)
        return write_store(store, np.repeat(positions, excitations, axis=0), names, chunks, True)
    q, p = len(positions), len(names)
    check_memory(
        8.0 * q * excitations * p**2, "positions: the information (a `store` keeps it in a file)"
    )
    matrices, done = np.empty((excitations, q, p, p)), 0
    for part in parts:
        matrices[:, done : done + len(part)] = part.swapaxes(0, 1)
        done += len(part)
    tiled = np.tile(positions, (excitations, 1))
    return InformationSet._of_sums(tiled, [matrices.reshape(-1, p, p)], names)


def _repeated(
    information: Candidates, positions: int, excitations: int, periods: tuple[int, ...]
) -> Candidates:
    """Return the information of each number of periods, excitation and position.

    A single number is in the matrices already.
    """
    if isinstance(information, InformationSet):
        if len(periods) == 1:
            return information
        index = np.arange(len(information))
    else:
        index = np.arange(len(information)).reshape(positions, excitations).T.ravel()
    multiples = np.array(periods if len(periods) > 1 else [1], dtype=float)
    factor = np.repeat(multiples, len(index))
    return RepeatedCandidates(information, np.tile(index, len(periods)), factor)
