"""The experiment plan: where the robot goes, and what it is told there."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from oed.experiment.carrier import Carrier
from oed.experiment.moves import Move, MoveLimits, move
from oed.experiment.multisine import Multisine
from oed.experiment.plan_document import plan_arguments, plan_document
from oed.experiment.plan_files import read_plan, write_plan
from oed.experiment.visiting_order import VisitingOrder
from robotmodels.common.arrays import (
    Array,
    ComplexArray,
    IntArray,
    check_above_zero,
    check_count,
    read_only,
)
from robotmodels.common.errors import InvalidInput

FALL = 0.25
"""Part of a period in which a ramp rises, and a run falls at its end."""


@dataclass(frozen=True, eq=False)
class ExperimentPlan:
    """Visits to positions, in order; in each, blocks of runs.

    A position with r repetitions is visited r times in a row. A visit has B blocks of n
    runs each, or fewer; a run repeats one period of the reference, first until transients
    have died out, then as often as is measured. Every visit and every block has different phases.

    Attributes
    ----------
    robot : str
        Its name.
    positions : ndarray, (Q, n), rad
        Positions.
    repetitions : ndarray of int, (Q,)
        Visits to each.
    multisine : Multisine
        Lines and amplitudes of the speed reference [rad/s, motor shaft].
    phases : ndarray, (V, B, F, n), rad
        V the sum of the repetitions.
    periods : int
        Measured per run.
    transient_periods : int
        Transient periods before them.
    ramp : bool
        Whether the first transient period rises from zero, see `envelope`, and every run falls to
        zero at its end, see `fall`.
    moves : MoveLimits
        Limits of the moves between positions, and the motors' names.
    scale : ndarray, (V,)
        Factors of the amplitudes.
    start : ndarray or None, (n,), rad
        Where the robot is before the first move; the first position by default.
    order : VisitingOrder or None
        How the positions were put in order and what that saves; None if they are not reordered.
    runs : int
        Of each block; 0 stands for n, as many as FRFs need. Fewer are the first of n orthogonal
        ones, for `estimators.fit` of records.
    settle : float, s
        Rest after a move, before the first run.
    carrier : Carrier or None
        Slow sines under the excitation; `scale` leaves them as they are.

    Raises
    ------
    InvalidInput
        If a position lies outside the limits, a number of periods or repetitions is too small, or
        shapes do not fit each other.
    """

    robot: str
    positions: Array
    repetitions: IntArray
    multisine: Multisine
    phases: Array
    periods: int
    transient_periods: int
    moves: MoveLimits
    scale: Array
    start: Array | None = None
    order: VisitingOrder | None = None
    ramp: bool = False
    runs: int = 0
    settle: float = 0.0
    carrier: Carrier | None = None

    def __post_init__(self) -> None:
        positions = self.moves.check(self.positions)
        repetitions = checked_repetitions(self.repetitions, len(positions))
        for name, least in (("periods", 1), ("transient_periods", 0)):
            object.__setattr__(self, name, check_count(getattr(self, name), name, least))
        if self.ramp and not self.transient_periods:
            raise InvalidInput("ramp: it takes a transient period, and transient_periods is 0")
        check_above_zero(self.settle, "settle [s]", zero=True)
        n, visits = len(self.moves.motors), int(repetitions.sum())
        _check_carrier(self.carrier, self.multisine, positions.shape)
        if self.multisine.inputs != n:
            raise InvalidInput(
                f"multisine: {self.multisine.inputs} inputs; the robot has {n} motors"
            )
        object.__setattr__(self, "runs", _checked_runs(self.runs, n))
        phases = _checked_phases(self.phases, visits, (len(self.multisine.lines), n))
        scale = np.array(self.scale, dtype=float)
        if scale.shape != (visits,) or not (np.isfinite(scale) & (scale > 0)).all():
            raise InvalidInput(f"scale: {visits} positive numbers, one per visit, are needed")
        start = positions[0] if self.start is None else self.start
        start = self.moves.check(np.atleast_2d(start), "start")[0]
        for name, array in (
            ("positions", positions),
            ("repetitions", repetitions),
            ("phases", phases),
            ("scale", scale),
            ("start", start),
        ):
            object.__setattr__(self, name, read_only(array))

    @property
    def motors(self) -> tuple[str, ...]:
        """Names of the n motors."""
        return self.moves.motors

    @property
    def blocks(self) -> int:
        """Number B of blocks per visit."""
        return int(self.phases.shape[1])

    @property
    def visits(self) -> IntArray:
        """Index of the position of each visit, (V,)."""
        return np.repeat(np.arange(len(self.positions)), self.repetitions)

    @property
    def visited(self) -> Array:
        """The position of each visit, (V, n) [rad]."""
        return np.asarray(self.positions[self.visits])

    def reference(self, visit: int) -> Array:
        """Return one period of the signals of a visit, (B, E, N, n) [rad/s, motor shaft]."""
        signals = self.multisine.reference(self.phases[visit])[:, : self.runs]
        carrier, q = self.carrier, int(self.visits[visit])
        slow = 0.0 if carrier is None else carrier.reference(q, self.multisine)
        return np.asarray(self.scale[visit] * signals + slow)

    def amplitudes(self, visit: int) -> ComplexArray:
        """Return complex amplitudes of the first block's signals, (F, n, E) [rad/s, motor shaft].

        The carrier is not in them.
        """
        spectrum = self.multisine.spectrum(self.phases[visit][:1])[0, ..., : self.runs]
        return np.asarray(2 / self.multisine.samples * self.scale[visit] * spectrum)

    @property
    def envelope(self) -> Array:
        """Factors of the samples of a run's first period, (N,): rising over a quarter, or ones.

        Half a cosine; a longer rise leaves the transient less time and no larger amplitudes.
        """
        N = self.multisine.samples
        rise = np.minimum(np.arange(N) / max(int(FALL * N), 1), 1.0)
        return (1 - np.cos(np.pi * rise)) / 2 if self.ramp else np.ones(N)

    @property
    def fall(self) -> Array:
        """Factors of the samples that end a run, from one to zero: (N // 4,), or none without."""
        return np.asarray(
            1 - self.envelope[: int(FALL * self.multisine.samples) if self.ramp else 0]
        )

    def played(self, references: Array, periods: int) -> Array:
        """Return runs as they are played: ramp, so many periods with it, fall; (..., K, n).

        Parameters
        ----------
        references : ndarray, (..., N, n), rad/s
            One period of each.
        """
        rise = self.envelope[:, None] * references
        falling = self.fall[:, None] * references[..., : len(self.fall), :]
        steady = [references] * (periods - 1)
        return np.concatenate([rise, *steady, falling], axis=-2)

    @property
    def signals(self) -> Array:
        """The references of all visits, (V, B, E, N, n) [rad/s, motor shaft]; it may be large."""
        return np.array([self.reference(visit) for visit in range(len(self.phases))])

    def move_to(self, visit: int) -> Move:
        """Return the move that leads to a visit; without samples where the robot is there."""
        first = self.positions[0] if self.start is None else self.start
        before = first if visit == 0 else self.visited[visit - 1]
        return move(before, self.visited[visit], self.moves, self.multisine.sample_time)

    @property
    def excitation_duration(self) -> float:
        """Time under excitation, transients and falls included [s]."""
        periods = (self.periods + self.transient_periods) * self.multisine.period
        run = periods + len(self.fall) * self.multisine.sample_time
        return len(self.phases) * self.blocks * self.runs * run

    @property
    def duration(self) -> float:
        """Time of it all, moves and settling included [s]."""
        moves = sum(self.move_to(visit).duration for visit in range(len(self.phases)))
        return self.excitation_duration + moves + len(self.phases) * self.settle

    def rescaled(self, factors: Array) -> "ExperimentPlan":
        """Return the plan with the amplitudes of each visit times a factor, (V,) or a number."""
        return replace(self, scale=self.scale * np.asarray(factors, dtype=float))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a YAML file and, beside it, an HDF5 file; see `oed.experiment.plan_files`.

        Raises
        ------
        InvalidInput
            If the path does not end in .yaml or .yml, or cannot be written to.
        """
        arrays = {
            "phases": self.phases,
            "amplitudes": self.multisine.amplitudes,
            "scale": self.scale,
        }
        write_plan(path, plan_document(self), arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "ExperimentPlan":
        """Read what `save` wrote.

        Raises
        ------
        InvalidInput
            Naming the file and what is wrong in it.
        """
        path = Path(path)
        file, arrays = read_plan(path)
        try:
            plan = cls(**plan_arguments(file, arrays))
        except InvalidInput as error:
            raise InvalidInput(f"{path}: {error}") from None
        if plan.blocks != file.blocks:
            raise InvalidInput(
                f"{path}: blocks: {file.blocks}, but {file.signals} holds the phases of "
                f"{plan.blocks}"
            )
        return plan


def _checked_runs(runs: int, motors: int) -> int:
    """Return the runs of a block, as many as motors for 0."""
    runs = check_count(runs, "runs", 0)
    if runs > motors:
        raise InvalidInput(f"runs: {runs}; a block has 1 to {motors}, as many as motors")
    return runs or motors


def _checked_phases(values: Array, visits: int, shape: tuple[int, int]) -> Array:
    """Return phases (V, B, F, n) with lines and motors of a shape (F, n)."""
    phases = np.array(values, dtype=float)
    if phases.ndim != 4 or len(phases) != visits or phases.shape[2:] != shape:
        raise InvalidInput(
            f"phases: shape {phases.shape}; ({visits}, blocks, {shape[0]}, {shape[1]}) is "
            "needed: visits, blocks, lines, motors"
        )
    if phases.shape[1] < 1:
        raise InvalidInput("blocks: none given; at least 1 is needed")
    return phases


def checked_repetitions(repetitions: Sequence[int] | IntArray, n_positions: int) -> IntArray:
    """Return whole numbers of visits, (Q,), at least one each.

    Raises
    ------
    InvalidInput
        If there is another number of them, or one is not whole and positive.
    """
    array = np.asarray(repetitions)
    if array.shape != (n_positions,):
        raise InvalidInput(
            f"repetitions: shape {array.shape} given; ({n_positions},), one per position, is needed"
        )
    for i, value in enumerate(array):
        if value != round(float(value)) or value < 1:
            raise InvalidInput(
                f"repetitions of position {i}: {value}; a whole number >= 1 is needed, "
                "leave out a position that is not to be visited"
            )
    return array.astype(np.int64)


def _check_carrier(carrier: Carrier | None, multisine: Multisine, shape: tuple[int, ...]) -> None:
    """Refuse a carrier in an excited line, or that does not fit positions of a shape (Q, n)."""
    if carrier is None:
        return
    if carrier.amplitudes.shape != shape or carrier.phases.shape != shape:
        raise InvalidInput(
            f"carrier: shapes {carrier.amplitudes.shape} and {carrier.phases.shape}; {shape}, "
            "positions by motors, is needed"
        )
    if carrier.line in [*multisine.lines, *multisine.detection]:
        raise InvalidInput(f"carrier: line {carrier.line} is one of the multisine; take another")
