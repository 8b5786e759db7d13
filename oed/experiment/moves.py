"""Moves between positions: straight lines in joint space, at rest at both ends, within limits."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from robotmodels.common.arrays import Array, check_above_zero, check_ranges, one_or_each, read_only
from robotmodels.common.errors import InvalidInput

# Largest slope and curvature of the quintic 10 t^3 - 15 t^4 + 6 t^5 on [0, 1].
_PEAK_SPEED = 15 / 8
_PEAK_ACCELERATION = 10 / np.sqrt(3)
# A limit typed with fewer digits than the robot file's is not met wrongly.
_SLACK = 1e-9


@dataclass(frozen=True, eq=False)
class MoveLimits:
    """Limits of moves, on the arm side [rad, rad/s, rad/s^2] or [m, ...].

    Attributes
    ----------
    motors : tuple of str
        Names of the n motors.
    positions : ndarray, (n, 2)
        Lowest and highest position.
    speed, acceleration : ndarray, (n,)
        Largest magnitudes; a number serves all motors.

    Raises
    ------
    InvalidInput
        Naming the motor whose limit is not finite, not positive, or upside down.
    """

    motors: tuple[str, ...]
    positions: Array
    speed: Array
    acceleration: Array

    def __post_init__(self) -> None:
        motors = tuple(self.motors)
        n = len(motors)
        object.__setattr__(self, "motors", motors)
        positions = np.array(self.positions, dtype=float)
        if positions.shape != (n, 2):
            raise InvalidInput(
                f"positions of the moves' limits: shape {positions.shape}; ({n}, 2) is needed"
            )
        for name, (low, high) in zip(motors, positions, strict=True):
            if not (np.isfinite([low, high]).all() and low <= high):
                raise InvalidInput(
                    f"motor {name!r}: position limits [{low:g}, {high:g}] are no finite range"
                )
        object.__setattr__(self, "positions", read_only(positions))
        for key in ("speed", "acceleration"):
            values = one_or_each(getattr(self, key), n, f"{key} of moves")
            for name, value in zip(motors, values, strict=True):
                check_above_zero(value, f"motor {name!r}: {key} of moves")
            object.__setattr__(self, key, read_only(values))

    def check(self, positions: Array, what: str = "position") -> Array:
        """Return `positions` (Q, n) if they lie within the limits.

        Raises
        ------
        InvalidInput
            Naming the first position and motor outside; or for a wrong shape.
        """
        positions = np.array(positions, dtype=float)
        n = len(self.motors)
        if positions.ndim != 2 or positions.shape[1] != n or not len(positions):
            raise InvalidInput(
                f"{what}s: shape {positions.shape} given; (Q, {n}) is needed, one column per motor"
            )
        names = [f"motor {motor!r}" for motor in self.motors]
        check_ranges(positions, self.positions, what, names, _SLACK)
        return positions


@dataclass(frozen=True, eq=False)
class Move:
    """A sampled move; sample k is at k sample_time, the next one after the last is the goal.

    Attributes
    ----------
    positions : ndarray, (K, n), rad
        Positions.
    speeds : ndarray, (K, n), rad/s
        Speeds.
    sample_time : float, s
        Sample time.
    """

    positions: Array
    speeds: Array
    sample_time: float

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def duration(self) -> float:
        """Time from leaving to arriving [s]."""
        return len(self) * self.sample_time


def move(
    start: Sequence[float] | Array,
    goal: Sequence[float] | Array,
    limits: MoveLimits,
    sample_time: float,
) -> Move:
    """Return the fastest quintic from `start` to `goal`, (n,) each; all motors arrive together.

    The path is a straight line between positions within the limits and so within them too.
    Obstacles are not considered: check the path before a robot takes it.

    Raises
    ------
    InvalidInput
        If an end lies outside the limits, or the sample time is not positive.
    """
    check_above_zero(sample_time, "sample_time [s]")
    ends = [
        limits.check(np.atleast_2d(e), what)[0] for e, what in ((start, "start"), (goal, "goal"))
    ]
    step = ends[1] - ends[0]
    count = _samples(step, limits, sample_time)
    t = (np.arange(count) / max(count, 1))[:, None]
    path = t**3 * (10 + t * (6 * t - 15))
    slope = 30 * t**2 * (1 - t) ** 2 / (max(count, 1) * sample_time)
    return Move(read_only(ends[0] + path * step), read_only(slope * step), sample_time)


def move_times(start: Array, goal: Array, limits: MoveLimits) -> Array:
    """Return how long each move takes at least, (a, b) [s], from `start` (a, n) to `goal` (b, n).

    It is the time of `move` before rounding up to whole samples.
    """
    distance = np.abs(goal[None] - start[:, None])
    return np.asarray(
        np.maximum(
            _PEAK_SPEED * distance / limits.speed,
            np.sqrt(_PEAK_ACCELERATION * distance / limits.acceleration),
        ).max(axis=-1)
    )


def _samples(step: ArrayLike, limits: MoveLimits, sample_time: float) -> int:
    """Return the least number of samples in which no limit is exceeded."""
    away = np.atleast_2d(np.asarray(step, dtype=float))
    return int(np.ceil(move_times(np.zeros_like(away), away, limits)[0, 0] / sample_time))
