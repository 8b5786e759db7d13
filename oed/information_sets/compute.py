"""The information of candidate positions, chunk by chunk: by the kernel, or the general way."""

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TypeVar, overload

import numpy as np

from oed.information_sets.information_set import InformationSet
from oed.information_sets.matrix_checks import candidate_rows
from robotmodels.common.arrays import Array, check_memory
from robotmodels.common.deprecation import renamed_keywords
from robotmodels.common.errors import InvalidInput
from robotmodels.common.progress import Progress, tell
from robotmodels.linear.equilibrium_sensitivity import Tangents
from robotmodels.linear.noise import LoopNoise, NoiseLaw, RelativeNoise, SeparableNoise
from robotmodels.linear.response import Elastic, check_omega, linearization, sensitivity_about
from robotmodels.linear.spring_network import SpringNetwork

if TYPE_CHECKING:
    from oed.information_sets.stored_information import StoredInformation


_WORTHWHILE = 128
"""Fewest positions in a chunk that overlaps with the next."""
_GENERAL = 64
"""Positions whose sensitivities are in memory at once if the kernel does not apply."""
_FEW = 4
"""Positions that are tried to see whether it does."""

Prepared = tuple[Array, tuple[SpringNetwork, Tangents | None] | None]


@dataclass(frozen=True, eq=False)
class ChunkInformation:
    """Positions (Q, n) to information (Q, p, p), in two stages that may overlap.

    Attributes
    ----------
    robot : Elastic
        As of `oed.information`.
    noise : NoiseLaw or LoopNoise
        As of `oed.information`.
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    equilibrium_shift : bool
        Whether equilibria shift with ln theta, as in `robotmodels.sensitivity`.
    """

    robot: Elastic
    omega: Array
    noise: NoiseLaw | LoopNoise
    equilibrium_shift: bool = False

    def __call__(self, positions: Array) -> Array:
        """Return the information, (Q, p, p)."""
        return self.finish(self.prepare(positions))

    def prepare(self, positions: Array) -> Prepared:
        """Return the positions and the linearisation there; None where `finish` makes it."""
        if len(positions) <= _GENERAL:
            return positions, linearization(
                self.robot, positions, equilibrium_shift=self.equilibrium_shift
            )
        # For the general way these are too many; what bars the kernel does so everywhere.
        if self.equilibrium_shift or not self.suits_kernel(self.robot.network(positions[:_FEW])):
            return positions, None
        return positions, (self.robot.network(positions), None)

    def finish(self, prepared: Prepared) -> Array:
        """Return the information, (Q, p, p), of what `prepare` returned."""
        positions, linearised = prepared
        if linearised is None:
            parts = [positions[i : i + _GENERAL] for i in range(0, len(positions), _GENERAL)]
            return np.concatenate([self(part) for part in parts])
        network, tangents = linearised
        noise, simple = self.noise, tangents is None and self.suits_kernel(network)
        if simple and isinstance(noise, RelativeNoise | SeparableNoise):
            # Imported when used: user-defined matrices do not need it.
            import robotmodels.kernel as kernel

            return np.asarray(kernel.information(network, self.omega, noise))
        return self._general(network, tangents)

    def suits_kernel(self, network: SpringNetwork) -> bool:
        """Return whether the kernel may serve.

        It knows springs, dampers, motors' inertias and motion, `RelativeNoise` and separable noise.
        """
        simple = isinstance(self.noise, RelativeNoise | SeparableNoise)
        return simple and network.only_springs and network.only_motors

    def _general(self, network: SpringNetwork, tangents: Tangents | None) -> Array:
        """Return the information the general way, which needs much memory."""
        from estimators.fitting.sandwich import information

        response, jacobian = sensitivity_about(network, tangents, self.omega)
        if isinstance(self.noise, NoiseLaw):
            return information(jacobian, 1.0 / self.noise.variance(response))
        return information(jacobian, self.noise.weights(network, self.omega))


@overload
def information(
    robot: Elastic,
    positions: Array,
    omega: Array,
    noise: NoiseLaw | LoopNoise,
    chunk: int = ...,
    executor: Executor | None = ...,
    progress: Progress | None = ...,
    store: None = ...,
    *,
    equilibrium_shift: bool = ...,
) -> InformationSet: ...


@overload
def information(
    robot: Elastic,
    positions: Array,
    omega: Array,
    noise: NoiseLaw | LoopNoise,
    chunk: int = ...,
    executor: Executor | None = ...,
    progress: Progress | None = ...,
    *,
    store: str | os.PathLike[str],
    equilibrium_shift: bool = ...,
) -> "StoredInformation": ...


@renamed_keywords(since="0.2", sag="equilibrium_shift")
def information(
    robot: Elastic,
    positions: Array,
    omega: Array,
    noise: NoiseLaw | LoopNoise,
    chunk: int = 1024,
    executor: Executor | None = None,
    progress: Progress | None = None,
    store: str | os.PathLike[str] | None = None,
    *,
    equilibrium_shift: bool = False,
) -> "InformationSet | StoredInformation":
    """Return the information of one experiment in each position, at fixed equilibria.

    $H_i = 2 Re sum_k conj(Psi_k) Lambda_k^-1 Psi_k^T$ over the lines k, with the derivatives
    $Psi_k$ of vec G by ln theta and the covariance $Lambda_k$ of its errors; for all experiments
    together $M = sum_i n_i H_i$, and the covariance of the estimates is $M^-1$.

    For the built-in robots the latter changes no standard deviation by more than 0.3 % (15 random
    positions, 2 to 80 Hz); for soft robots under heavy loads it may, and `equilibrium_shift` is
    exact.

    Parameters
    ----------
    robot : Elastic
        A model with `parameters` and `network(positions)`.
    positions : ndarray, (Q, n), rad
        Positions.
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    noise : NoiseLaw or LoopNoise
        The noise law of the FRF estimates; a `ClosedLoopNoise` knows the experiment.
    chunk : int
        The most positions per call of the kernel, which bounds the memory.
    executor : Executor, optional
        Computes chunks in parallel; None computes here.
    progress : Progress, optional
        Called with the number of positions done and their total.
    store : str or os.PathLike[str], optional
        Path of a file for more matrices than memory holds; they are written as they come and read
        in chunks, see `store`.
    equilibrium_shift : bool
        Whether equilibria shift with ln theta, as in `robotmodels.sensitivity`: exact, and a
        hundred times slower.

    Raises
    ------
    InvalidInput
        If there is no position, or `chunk` is not positive.
    NoEquilibrium
        If the springs cannot carry the robot's weight in a position.
    """
    positions = candidate_rows(positions)
    names = robot.parameters.names
    if store is None:
        needed = 8.0 * len(positions) * len(names) ** 2
        check_memory(needed, "positions: the information (a `store` keeps it in a file)")
    work = ChunkInformation(robot, check_omega(omega), noise, equilibrium_shift)
    if store is not None and executor is not None:
        from oed.information_sets.store_by_workers import store_by_workers

        size = _size(len(positions), chunk)
        return store_by_workers(store, positions, names, work, size, executor, progress)
    parts = in_chunks(work, positions, chunk, executor)
    if store is None:
        return InformationSet._of_sums(positions, counted(parts, len(positions), progress), names)
    from oed.information_sets.stored_information import write_store

    return write_store(store, positions, names, counted(parts, len(positions), progress), True)


class ChunkWork(Protocol):
    """What makes arrays of positions in two stages, such as `ChunkInformation`."""

    def __call__(self, positions: Array) -> Array:
        """Return the array of some positions."""

    def prepare(self, positions: Array) -> Prepared:
        """Return what `finish` takes."""

    def finish(self, prepared: Prepared) -> Array:
        """Return the array of the positions prepared."""


def in_chunks(
    work: ChunkWork, positions: Array, chunk: int, executor: Executor | None
) -> Iterable[Array]:
    """Return the arrays of chunks of positions, in order.

    Raises
    ------
    InvalidInput
        If `chunk` is not positive.
    """
    size = _size(len(positions), chunk)
    chunks = [positions[start : start + size] for start in range(0, len(positions), size)]
    if executor is not None:
        return executor.map(work, chunks)
    if len(chunks) == 1:
        return map(work, chunks)
    # What Pinocchio does for a chunk overlaps with the kernel's last.
    return pipelined_map(work.prepare, work.finish, chunks)


def _size(count: int, most: int) -> int:
    """Return how many of `count` positions are in a chunk.

    Several chunks, where there are enough positions, for there to be something that overlaps.
    """
    if most < 1:
        raise InvalidInput(f"chunk: {most} positions per call; at least 1 is needed")
    return min(most, max(-(-count // 4), _WORTHWHILE))


def counted(parts: Iterable[Array], total: int, progress: Progress | None) -> Iterator[Array]:
    """Yield parts, and tell the progress how many of their items are done."""
    done = 0
    for part in parts:
        yield part
        done += len(part)
        tell(progress, done, total)


Item = TypeVar("Item")
Half = TypeVar("Half")
Whole = TypeVar("Whole")


def pipelined_map(
    first: Callable[[Item], Half], second: Callable[[Half], Whole], items: Iterable[Item]
) -> Iterator[Whole]:
    """Yield ``second(first(item))`` of each item, in order, one item ahead.

    `first` (as a rule `network`, by Pinocchio) is called here, `second` (the compiled kernel) in
    a thread, at the same time as `first` of the next item. What either raises, this raises.
    """
    with ThreadPoolExecutor(1) as thread:
        running: Future[Whole] | None = None
        for item in items:
            half = first(item)
            done, running = running, thread.submit(second, half)
            if done is not None:
                yield done.result()
        if running is not None:
            yield running.result()
