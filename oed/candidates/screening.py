"""Which candidate positions a robot can take: what is removed, and why."""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field

import numpy as np

from oed.candidates.grids import repeated_positions
from robotmodels.collision.surroundings import Surroundings
from robotmodels.common.arrays import (
    Array,
    BoolArray,
    IntArray,
    one_or_each,
    read_only,
    real_numbers,
)
from robotmodels.common.deprecation import renamed_attributes
from robotmodels.common.errors import InvalidInput
from robotmodels.common.printing import ReprHtml
from robotmodels.common.progress import Progress
from robotmodels.description.ranges import MOST_LENGTH
from robotmodels.elastic.rigid_pose import holding_torques, unloaded
from robotmodels.elastic.robot import ElasticRobot

# A limit typed with fewer digits than the robot file's is not met wrongly.
_SLACK = 1e-9


@dataclass(frozen=True)
class Removal:
    """A reason for which positions were removed.

    Attributes
    ----------
    reason : str
        "joint limits", "duplicate", "holding torque", "obstacle" or "self-collision".
    what : str
        The joint, the motor, the link and the obstacle, or the two links.
    count : int
        Positions of which it is true; one position can be counted under several.
    """

    reason: str
    what: str
    count: int


@renamed_attributes("0.2", kept="indices", given="proposed")
@dataclass(frozen=True, eq=False)
class ScreenedCandidates(ReprHtml):
    """Positions that a robot can take, and what was removed.

    Attributes
    ----------
    positions : ndarray, (Q, n)
        Positions that the robot can take.
    indices : ndarray of int, (Q,)
        Their indices among the proposed positions.
    proposed : int
        Number of proposed positions.
    removed : dict of str to int
        Number of positions by reason, each under the first that applies, in this order.
    removals : tuple of Removal
        What was in the way, the most frequent first.
    notes : tuple of str
        What was not checked.
    """

    positions: Array
    indices: IntArray
    proposed: int
    removed: dict[str, int]
    removals: tuple[Removal, ...]
    notes: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.positions)

    def __str__(self) -> str:
        return _summary(len(self), self.proposed, self.removed)


def screened_candidates(
    robot: ElasticRobot,
    positions: Array,
    surroundings: Surroundings | None = None,
    *,
    torque_limits: float | Sequence[float] | Array | None = None,
    progress: Progress | None = None,
    executor: Executor | None = None,
) -> ScreenedCandidates:
    """Return the `positions` that the robot can take, and why the others are removed.

    Checks are made in the order of `Removal.reason`, all at the rigid pose: elastic deflections
    are neglected.

    Parameters
    ----------
    robot : ElasticRobot
        The robot.
    positions : ndarray, (Q, n), rad or m
        Positions.
    surroundings : Surroundings, optional
        What the robot may collide with, by `robotmodels.surroundings`; None checks no collisions.
    torque_limits : float, sequence of float or ndarray, N m, optional
        Torque limits on the motor shafts, (n,) or one number; what holds the arm and its payload
        against gravity must not be more.
    progress : Progress, optional
        Called with the number of positions compared with the surroundings and their total.
    executor : Executor, optional
        Compares tens of thousands of positions in parallel; None compares here.

    Raises
    ------
    InvalidInput
        If there is no position, none remains (counted by reason), or shapes or signs do not fit.
    """
    checked = _checked(positions, list(robot.motor_names))
    screen = _screened(robot, checked, surroundings, torque_limits, progress, executor)
    notes: tuple[str, ...] = ("collisions are not checked",)
    if surroundings is not None:
        notes = (*surroundings.shapes.notes, "paths between positions are not checked")
    if not len(screen.remaining):
        summary = _summary(0, len(checked), screen.removed)
        worst = max(screen.removals, key=lambda removal: removal.count)
        units = "; positions are in rad, or m" if worst.reason == "joint limits" else ""
        raise InvalidInput(
            f"{summary}; most often {worst.reason}, {worst.what} ({worst.count}){units}"
        )
    remaining = screen.of(checked)
    return ScreenedCandidates(
        positions=read_only(remaining.copy() if remaining is positions else remaining),
        indices=read_only(screen.remaining),
        proposed=len(checked),
        removed=screen.removed,
        removals=tuple(sorted(screen.removals, key=lambda removal: -removal.count)),
        notes=notes,
    )


def usable(
    robot: ElasticRobot,
    positions: Array,
    surroundings: Surroundings | None = None,
    *,
    torque_limits: float | Sequence[float] | Array | None = None,
) -> BoolArray:
    """Return which positions `screened_candidates` keeps, (Q,); it may be none.

    Raises
    ------
    InvalidInput
        If there is no position, or shapes or signs do not fit.
    """
    positions = _checked(positions, list(robot.motor_names))
    mask = np.zeros(len(positions), dtype=bool)
    mask[_screened(robot, positions, surroundings, torque_limits).remaining] = True
    return mask


def reasons(
    robot: ElasticRobot,
    position: Array,
    surroundings: Surroundings | None = None,
    *,
    torque_limits: float | Sequence[float] | Array | None = None,
) -> tuple[str, ...]:
    """Return why `screened_candidates` removes a position (n,), in words; nothing if it does not.

    Raises
    ------
    InvalidInput
        If shapes or signs do not fit.
    """
    positions = _checked(np.asarray(position)[None], list(robot.motor_names))
    screen = _screened(robot, positions, surroundings, torque_limits)
    return tuple(f"{removal.reason}, {removal.what}" for removal in screen.removals)


@dataclass(eq=False)
class _Screen:
    """Positions that remain so far, by index, and the reasons of the others' removal."""

    remaining: IntArray
    removed: dict[str, int] = field(default_factory=dict)
    removals: list[Removal] = field(default_factory=list)

    def of(self, positions: Array) -> Array:
        """Return the positions (Q, n) that remain."""
        whole = len(self.remaining) == len(positions)
        return positions if whole else positions[self.remaining]

    def remove(self, reason: str, whats: Sequence[str], wrong: BoolArray) -> None:
        """Remove the remaining positions with any True in their row of (remaining, whats)."""
        removed = wrong.any(axis=1)
        self.removed[reason] = int(removed.sum())
        self.remaining = self.remaining[~removed]
        counts = wrong.sum(axis=0)
        self.removals += [
            Removal(reason, what, int(count))
            for what, count in zip(whats, counts, strict=True)
            if count
        ]

    def remove_pairs(self, surroundings: Surroundings, touching: BoolArray) -> None:
        """Remove positions in which links touch obstacles, then those in which links touch."""
        pairs = surroundings.pairs
        whats = [f"{pair.first!r} and {pair.second!r}" for pair in pairs]
        for reason in ("obstacle", "self-collision"):
            columns = [k for k, p in enumerate(pairs) if p.obstacle == (reason == "obstacle")]
            wrong = touching[:, columns]
            self.remove(reason, [whats[k] for k in columns], wrong)
            if reason == "obstacle":
                touching = touching[~wrong.any(axis=1)]


def _screened(
    robot: ElasticRobot,
    positions: Array,
    surroundings: Surroundings | None,
    torque_limits: float | Sequence[float] | Array | None,
    progress: Progress | None = None,
    executor: Executor | None = None,
) -> _Screen:
    """Return the positions that remain after all checks."""
    screen = _Screen(np.arange(len(positions)))
    low, high = robot.position_limits.T
    angles = screen.of(positions)
    inside = (angles >= low - _SLACK) & (angles <= high + _SLACK)
    screen.remove("joint limits", [f"joint {joint!r}" for joint in robot.motor_joints], ~inside)
    repeated = repeated_positions(screen.of(positions), robot.turning)
    screen.remove("duplicate", ["an earlier position, whole turns aside"], repeated[:, None])
    if torque_limits is not None:
        limits = _torque_limits(torque_limits, robot.motor_names)
        torques = np.abs(holding_torques(robot, unloaded(robot, screen.of(positions))))
        screen.remove(
            "holding torque", [f"motor {m!r}" for m in robot.motor_names], torques > limits
        )
    if surroundings is not None:
        touching = surroundings.touching(screen.of(positions), progress, executor)
        screen.remove_pairs(surroundings, touching)
    return screen


def _summary(remaining: int, proposed: int, removed: dict[str, int]) -> str:
    why = ", ".join(f"{count} {reason}" for reason, count in removed.items() if count)
    line = f"{remaining} of {proposed} candidate positions are left"
    return f"{line}; removed: {why}" if why else line


def _checked(positions: Array, motors: list[str]) -> Array:
    positions = real_numbers(positions, "positions", copy=False)
    if positions.ndim != 2 or positions.shape[1] != len(motors) or not len(positions):
        raise InvalidInput(
            f"positions: an array of shape {positions.shape}; (Q, {len(motors)}) is "
            f"needed, one column per motor: {', '.join(motors)}"
        )
    wrong = ~np.isfinite(positions).all(axis=1)
    if wrong.any():
        raise InvalidInput(f"positions: position {int(np.argmax(wrong))} is not finite")
    far = np.abs(positions) > MOST_LENGTH
    if far.any():
        number, motor = np.argwhere(far)[0]
        raise InvalidInput(
            f"positions: position {number}: {positions[number, motor]:g} of motor "
            f"{motors[motor]!r} is beyond any joint; at most {MOST_LENGTH:g} rad or m is possible"
        )
    return positions


def _torque_limits(torque_limits: float | Sequence[float] | Array, motors: Sequence[str]) -> Array:
    limits = one_or_each(torque_limits, len(motors), "torque_limits")
    for motor, limit in zip(motors, limits, strict=True):
        if not limit > 0:
            raise InvalidInput(
                f"torque_limits of motor {motor!r}: {limit:g} N m; a positive number is needed"
            )
    return limits
