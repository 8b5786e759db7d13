"""Candidate positions: grids of them, and which of them a position named from outside is."""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from robotmodels.common.arrays import Array, BoolArray, cartesian_grid, check_count, equal_rows
from robotmodels.common.errors import InvalidInput, check_word

# The first joint often turns about the vertical and then changes nothing; the next two carry
# the arm, so that they get a finer grid than the wrist.
_USUAL_POINTS = (1, 6, 6, 4)


SAME_POSITION = 1e-6
"""Largest difference of any angle [rad or m]: files and people round."""


_REPEATED = 1e-9  # [rad] or [m]: positions that agree to well below it repeat


class HasJoints(Protocol):
    """A robot with named driven joints that have limits."""

    @property
    def motor_joints(self) -> Sequence[str]:
        """Names of the n driven joints."""

    @property
    def position_limits(self) -> Array:
        """Lowest and highest position of each, (n, 2)."""


def candidate_positions(
    robot: HasJoints,
    per_joint: int | Sequence[int] | Mapping[str, int] | None = None,
    limits: Sequence[Sequence[float]] | Mapping[str, Sequence[float]] | Array | None = None,
) -> Array:
    """Return a joint grid, (Q, n) [rad], or [m] for a prismatic joint; the last joint runs fastest.

    Parameters
    ----------
    robot : HasJoints
        Gives the names and limits of its n driven joints.
    per_joint : int, sequence of int or mapping of str to int, optional
        Points per joint: one number for all, n numbers, or numbers by joint name (1 for joints not
        named). One point lies in the middle of the range, more include both its ends. Default: 1,
        6, 6, and 4 for each further joint.
    limits : sequence of sequence of float, mapping of str to sequence of float or ndarray, optional
        (n, 2) ranges, or (low, high) by joint name, within the joint limits.

    Raises
    ------
    InvalidInput
        Naming the joint, if it gets no point, an unknown name, a range outside its limits, or has
        no finite limits and gets no range; or if a list has the wrong length.
    """
    joints = list(robot.motor_joints)
    counts = _counts(per_joint, joints)
    ranges = _ranges(limits, joints, np.asarray(robot.position_limits, dtype=float))
    for joint, count, (low, high) in zip(joints, counts, ranges, strict=True):
        if count > 1 and low == high:
            raise InvalidInput(
                f"limits of joint {joint!r}: low and high are both {low:g}, which leaves room "
                f"for 1 point, not {count}"
            )
    axes = [
        np.linspace(low, high, count) if count > 1 else np.array([(low + high) / 2])
        for count, (low, high) in zip(counts, ranges, strict=True)
    ]
    return cartesian_grid(axes)


def sobol_positions(
    robot: HasJoints,
    count: int,
    limits: Sequence[Sequence[float]] | Mapping[str, Sequence[float]] | Array | None = None,
    rng: np.random.Generator | None = None,
) -> Array:
    """Return `count` Sobol points (Q, n) [rad or m], which fill the ranges evenly in any number.

    Parameters
    ----------
    robot : HasJoints
        Gives the names and limits of its n driven joints.
    count : int
        Number of points; powers of two are the most even.
    limits : sequence of sequence of float, mapping of str to sequence of float or ndarray, optional
        As in `candidate_positions`; a range of one value holds its joint.
    rng : Generator, optional
        Scrambles the points (Owen), which keeps them as even; None takes the plain sequence from
        its second point on, as its first is a corner.

    Raises
    ------
    InvalidInput
        If `count` is not a whole number >= 1, or as `candidate_positions`.
    """
    from scipy.stats import qmc  # takes half a second to import

    check_count(count, "sobol: points")
    joints = list(robot.motor_joints)
    ranges = _ranges(limits, joints, np.asarray(robot.position_limits, dtype=float))
    sequence = qmc.Sobol(len(joints), scramble=rng is not None, rng=rng)
    first = 1 if rng is None else 0
    points = sequence.random_base2((int(count) + first - 1).bit_length())[first:]
    low, high = ranges.T
    return np.asarray(low + points[:count] * (high - low))


def turns_apart(differences: Array, turning: BoolArray) -> Array:
    """Return differences of positions, (..., n), less whole turns where a joint turns."""
    turns = np.where(turning, np.round(differences / (2 * np.pi)), 0.0)
    return np.asarray(differences - 2 * np.pi * turns)


def repeated_positions(positions: Array, turning: BoolArray) -> BoolArray:
    """Return which positions (Q, n) repeat an earlier one or lie whole turns from it, (Q,)."""
    # On the circle: an angle next to pi has one cosine and sine on both of its sides.
    columns = (
        coordinate(column)
        for column, turns in zip(positions.T, turning, strict=True)
        for coordinate in ((np.cos, np.sin) if turns else (np.positive,))
    )
    group = equal_rows(columns, _REPEATED)
    number = np.arange(len(positions))
    first = np.empty_like(number)
    first[group[::-1]] = number[::-1]  # of several numbers the last one stays
    return np.asarray(number > first[group])


def candidate_at(
    positions: Array,
    position: Array,
    name: str,
    remedy: str,
    turning: BoolArray | None = None,
) -> int:
    """Return the index of the candidate at a position.

    For positions that come from outside only: what is computed carries the candidate's index.

    Parameters
    ----------
    positions : ndarray, (Q, n), rad or m
        Candidates.
    position : ndarray, (n,), rad or m
        Angles of one of them, to within `SAME_POSITION`.
    name : str
        What messages call the position.
    remedy : str
        What to do where no candidate is there.
    turning : ndarray of bool, (n,), optional
        Joints of which whole turns do not count; by default none.

    Raises
    ------
    InvalidInput
        Naming the position, if it has another number of angles or is no candidate.
    """
    if position.shape != positions.shape[1:]:
        raise InvalidInput(f"{name}: {position.size} angles; {positions.shape[1]} are needed")
    differences = positions - position
    distances = np.abs(differences if turning is None else turns_apart(differences, turning)).max(
        axis=1
    )
    closest = int(np.argmin(distances))
    if not distances[closest] <= SAME_POSITION:
        raise InvalidInput(
            f"{name}: {np.round(position, 4).tolist()} is not among the candidates; the nearest is "
            f"candidate {closest}, {np.round(positions[closest], 4).tolist()}, "
            f"{distances[closest]:.3g} away; {remedy}"
        )
    return closest


def _counts(
    per_joint: int | Sequence[int] | Mapping[str, int] | None, joints: list[str]
) -> list[int]:
    """Return the number of grid points of each joint."""
    counts: list[Any]
    if per_joint is None:
        counts = [_USUAL_POINTS[min(j, len(_USUAL_POINTS) - 1)] for j in range(len(joints))]
    elif isinstance(per_joint, Mapping):
        _check_names("per_joint", per_joint, joints)
        counts = [per_joint.get(joint, 1) for joint in joints]
    elif isinstance(per_joint, (int, np.integer)):
        counts = [per_joint] * len(joints)
    else:
        counts = list(per_joint)
        if len(counts) != len(joints):
            raise InvalidInput(
                f"per_joint: {len(counts)} numbers for {len(joints)} joints ({', '.join(joints)})"
            )
    for joint, count in zip(joints, counts, strict=True):
        check_count(count, f"per_joint of joint {joint!r}")
    return [int(count) for count in counts]


def _ranges(
    limits: Sequence[Sequence[float]] | Mapping[str, Sequence[float]] | Array | None,
    joints: list[str],
    joint_limits: Array,
) -> Array:
    """Return the range of each joint, (n, 2), checked against its limits."""
    ranges = joint_limits.copy()
    if isinstance(limits, Mapping):
        _check_names("limits", limits, joints)
        for joint, pair in limits.items():
            ranges[joints.index(joint)] = _pair(joint, pair)
    elif limits is not None:
        if len(limits) != len(joints):
            raise InvalidInput(
                f"limits: {len(limits)} ranges for {len(joints)} joints ({', '.join(joints)})"
            )
        ranges[:] = [_pair(joint, pair) for joint, pair in zip(joints, limits, strict=True)]
    for joint, (low, high), (lowest, highest) in zip(joints, ranges, joint_limits, strict=True):
        if not np.isfinite([low, high]).all():
            raise InvalidInput(
                f"limits of joint {joint!r}: [{low:g}, {high:g}] is not a finite range; "
                "give one with `limits`"
            )
        if low > high:
            raise InvalidInput(f"limits of joint {joint!r}: low {low:g} is above high {high:g}")
        # A limit typed with fewer digits than the robot file's is not outside it.
        slack = 1e-9 * max(1.0, abs(low), abs(high))
        if low < lowest - slack or high > highest + slack:
            raise InvalidInput(
                f"limits of joint {joint!r}: [{low:g}, {high:g}] reaches outside the joint's own "
                f"[{lowest:g}, {highest:g}] rad, or m if prismatic"
            )
    return ranges


def _pair(joint: str, pair: Sequence[float] | Array) -> Array:
    array = np.asarray(pair, dtype=float)
    if array.shape != (2,):
        raise InvalidInput(f"limits of joint {joint!r}: {pair!r} is not a pair (low, high)")
    return array


def _check_names(argument: str, by_joint: Mapping[str, object], joints: list[str]) -> None:
    for name in by_joint:
        check_word(f"{argument}:", name, joints, "is not a driven joint")
