"""Excitations of a visit: which motor has how much torque on which line, and in how many runs.

An excitation is its spectral matrix Phi, the sum of U U^H over its runs: diagonal where motors are
told apart, of rank one at each line in a single run. All families shake every motor they move with
the same root mean square torque in each run.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from robotmodels.common.arrays import (
    Array,
    ComplexArray,
    check_above_zero,
    check_count,
    complex_numbers,
    read_only,
)
from robotmodels.common.errors import InvalidInput, check_word


@runtime_checkable
class Excitation(Protocol):
    """Protocol of an excitation of the motors in a visit, such as `Orthogonal`."""

    @property
    def name(self) -> str:
        """What reports call it."""

    def runs(self, motors: int) -> int:
        """Return the number of runs of a visit."""

    def spectrum(self, torque: Array, lines: int) -> ComplexArray:
        """Return Phi of all runs, (F, n, n) [N^2 m^2], for root mean square torques (n,)."""


@dataclass(frozen=True)
class Orthogonal:
    """As many runs as motors, flat multisines of all motors whose phases turn from run to run."""

    name: str = "orthogonal"

    def runs(self, motors: int) -> int:
        """Return the number of motors."""
        return motors

    def spectrum(self, torque: Array, lines: int) -> ComplexArray:
        """Return Phi, see `Excitation`: n times the flat level, phases cancel."""
        level = len(torque) * np.diag(torque**2) / lines
        return np.broadcast_to(level.astype(complex), (lines, *level.shape)).copy()


@dataclass(frozen=True)
class Zippered:
    """One run in which each motor has every n-th line; lines without excitation stay free.

    Attributes
    ----------
    first : int
        Motor that has the first line.
    """

    first: int = 0
    name: str = "zippered"

    def runs(self, motors: int) -> int:
        """Return one."""
        return 1

    def owners(self, motors: int, lines: int) -> Array:
        """Return whether a motor has a line, (F, n).

        Raises
        ------
        InvalidInput
            If there are fewer lines than motors.
        """
        if lines < motors:
            raise InvalidInput(
                f"excitation {self.name}: {lines} lines for {motors} motors; one line of each "
                "motor at least is needed"
            )
        turn = (np.arange(lines) + self.first) % motors
        return np.asarray(turn[:, None] == np.arange(motors))

    def spectrum(self, torque: Array, lines: int) -> ComplexArray:
        """Return Phi, see `Excitation`: a motor's power is shared by its own lines."""
        owners = self.owners(len(torque), lines)
        level = owners * torque**2 / owners.sum(axis=0)
        return np.asarray(level[:, :, None] * np.eye(len(torque)), dtype=complex)


@dataclass(frozen=True)
class RandomPhase:
    """One run of all motors on all lines, in independent random phases.

    Attributes
    ----------
    seed : int
        Draws the phases.
    """

    seed: int = 0
    name: str = "random_phase"

    def runs(self, motors: int) -> int:
        """Return one."""
        return 1

    def spectrum(self, torque: Array, lines: int) -> ComplexArray:
        """Return Phi, see `Excitation`: of rank one at every line."""
        phases = np.random.default_rng(self.seed).uniform(0, 2 * np.pi, (lines, len(torque)))
        u = torque / np.sqrt(lines) * np.exp(1j * phases)
        return np.asarray(u[:, :, None] * u[:, None, :].conj())


@dataclass(frozen=True)
class SingleMotor:
    """One run of one motor alone, on all lines.

    Attributes
    ----------
    motor : int
        Index of the motor.
    """

    motor: int

    @property
    def name(self) -> str:
        """The motor's number, from one."""
        return f"motor {self.motor + 1}"

    def runs(self, motors: int) -> int:
        """Return one."""
        return 1

    def spectrum(self, torque: Array, lines: int) -> ComplexArray:
        """Return Phi, see `Excitation`.

        Raises
        ------
        InvalidInput
            If there is no such motor.
        """
        n = len(torque)
        if not 0 <= self.motor < n:
            raise InvalidInput(f"excitation {self.name}: the robot has {n} motors")
        level = np.zeros((lines, n, n), dtype=complex)
        level[:, self.motor, self.motor] = torque[self.motor] ** 2 / lines
        return level


@dataclass(frozen=True, eq=False)
class UserSpectrum:
    """A spectral matrix of the user's own, such as a designed one.

    Attributes
    ----------
    matrices : ndarray of complex, (F, n, n), N^2 m^2
        Phi of all runs, Hermitian and positive semidefinite.
    run_count : int
        Runs, as many as the largest rank at least.
    name : str
        What reports call it.

    Raises
    ------
    InvalidInput
        Naming the line whose matrix is not Hermitian, not semidefinite, or of a larger rank.
    """

    matrices: ComplexArray
    run_count: int = 1
    name: str = "user"

    def __post_init__(self) -> None:
        Phi = complex_numbers(self.matrices, f"excitation {self.name}")
        check_count(self.run_count, f"excitation {self.name}: run_count")
        if Phi.ndim != 3 or Phi.shape[1] != Phi.shape[2] or not np.isfinite(Phi).all():
            raise InvalidInput(
                f"excitation {self.name}: shape {Phi.shape}; finite numbers (F, n, n) are needed"
            )
        size = max(float(np.abs(Phi).max(initial=0.0)), np.finfo(float).tiny)
        skew = np.abs(Phi - np.conj(np.swapaxes(Phi, 1, 2))).max(axis=(1, 2)) > 1e-9 * size
        values = np.linalg.eigvalsh(Phi)
        ranks = (values > 1e-6 * values[:, -1:]).sum(axis=1)
        for wrong, what in (
            (skew, "is not Hermitian"),
            (values[:, 0] < -1e-9 * size, "is not positive semidefinite"),
            (ranks > self.run_count, f"takes more runs than {self.run_count}"),
        ):
            if wrong.any():
                line = int(np.argmax(wrong))
                raise InvalidInput(f"excitation {self.name}: the matrix of line {line} {what}")
        object.__setattr__(self, "matrices", read_only(Phi))

    def runs(self, motors: int) -> int:
        """Return the number of runs."""
        return self.run_count

    def spectrum(self, torque: Array, lines: int) -> ComplexArray:
        """Return the matrices.

        Raises
        ------
        InvalidInput
            If they are for other lines or motors.
        """
        n = len(torque)
        if self.matrices.shape != (lines, n, n):
            raise InvalidInput(
                f"excitation {self.name}: shape {self.matrices.shape}; {(lines, n, n)} is needed"
            )
        return self.matrices


_FAMILIES: dict[str, Excitation] = {
    one.name: one for one in (Orthogonal(), Zippered(), RandomPhase())
}
_SINGLE = "single_motors"


def checked_excitations(
    excitations: Sequence[str | Excitation], motors: int
) -> tuple[Excitation, ...]:
    """Return excitations, by value or by name; "single_motors" stands for one of each motor.

    Raises
    ------
    InvalidInput
        If there is none, or no family of that name.
    """
    families: list[Excitation] = []
    for one in excitations:
        if one == _SINGLE:
            families.extend(SingleMotor(motor) for motor in range(motors))
        elif isinstance(one, str):
            check_word("excitations:", one, [*_FAMILIES, _SINGLE])
            families.append(_FAMILIES[one])
        elif isinstance(one, Excitation):
            families.append(one)
        else:
            raise InvalidInput(f"excitations: {one!r} is neither a name nor an `Excitation`")
    if not families:
        raise InvalidInput("excitations: none given; at least one is needed")
    return tuple(families)


@dataclass(frozen=True)
class VisitTiming:
    """Durations of a visit: a move, settling, and runs of a transient and whole periods.

    Attributes
    ----------
    period : float, s
        Length of a period.
    transient : float, s
        Excitation before the measurement, in each run.
    settle : float, s
        Rest after the move.
    move : float, s
        Move to the position, on average.
    """

    period: float = 10.0
    transient: float = 5.0
    settle: float = 5.0
    move: float = 5.0

    def __post_init__(self) -> None:
        for name in ("period", "transient", "settle", "move"):
            check_above_zero(getattr(self, name), f"timing: {name} [s]", zero=name != "period")

    @property
    def visit(self) -> float:
        """Time of a visit before any run [s]."""
        return self.move + self.settle

    def duration(self, runs: int, periods: int) -> float:
        """Return the duration of a visit of so many runs, each of so many periods [s]."""
        return self.visit + runs * (self.transient + periods * self.period)
