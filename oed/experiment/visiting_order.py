"""In which order to visit positions: the one that takes the moves the least time."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from oed.experiment.moves import MoveLimits, move_times
from robotmodels.common.arrays import Array, BoolArray, IntArray, read_only
from robotmodels.common.deprecation import renamed_attributes
from robotmodels.common.errors import InvalidInput
from robotmodels.common.printing import ReprHtml

_EXACT = 12  # positions up to which all orders are considered
_STARTS = 6
_BLOCKED = 1e6  # s, of a move that is not free: no order of free moves takes as long


@renamed_attributes("0.2", given="unordered_duration")
@dataclass(frozen=True, eq=False)
class VisitingOrder(ReprHtml):
    """An order of positions.

    Attributes
    ----------
    order : ndarray of int, (Q,)
        Indices of the positions, first to last.
    duration : float, s
        Duration of all moves, from the start and back to it where asked.
    unordered_duration : float, s
        The same for the original order of the positions.
    optimal : bool
        Whether no other order is shorter; else moving or reversing a part yields none.
    """

    order: IntArray
    duration: float
    unordered_duration: float
    optimal: bool

    @property
    def saved(self) -> float:
        """Time that the order saves against the original one [s]."""
        return self.unordered_duration - self.duration

    def __str__(self) -> str:
        best = "no order is shorter" if self.optimal else "no part moved or reversed shortens it"
        return (
            f"order {', '.join(map(str, self.order))}: moves take {self.duration:.1f} s instead of "
            f"{self.unordered_duration:.1f} s; {best}"
        )


def visiting_order(
    positions: Array,
    limits: MoveLimits,
    start: Array | None = None,
    *,
    back: bool = False,
    free: Callable[[Array, Array], BoolArray] | None = None,
) -> VisitingOrder:
    """Return the order of `positions` (Q, n) that shortens the moves.

    Moves are those of `oed.move`: straight lines in joint space, all motors arriving together.
    Up to 12 positions by dynamic programming over subsets (Held and Karp 1962), beyond by
    reversing and moving parts of the order, from several first orders, until nothing helps.

    Parameters
    ----------
    positions : ndarray, (Q, n), rad or m
        Positions.
    limits : MoveLimits
        Positions, speeds and accelerations of the motors.
    start : ndarray, (n,), optional
        Where the robot is beforehand; None begins anywhere.
    back : bool
        Whether the robot returns to `start`.
    free : callable, optional
        Which straight moves from a position (n,) to others (k, n) are free; others are avoided.

    Raises
    ------
    InvalidInput
        If a position lies outside the limits, or `back` is asked for without a start.
    """
    positions = limits.check(positions)
    if back and start is None:
        raise InvalidInput("start: the robot cannot go back to it if it is not given")
    n = len(positions)
    times, first = move_times(positions, positions, limits), np.zeros(n)
    if start is not None:
        first = move_times(limits.check(np.atleast_2d(start), "start"), positions, limits)[0]
    last = first if back else np.zeros(n)
    moves = times, first, last
    if free is not None:
        times, first = _avoiding(positions, start, free, times, first)
        last = first if back else last
    exact = n <= _EXACT
    order = _held_karp(times, first, last) if exact else _improved(times, first, last)
    orders = order, np.arange(n)
    order = min(orders, key=lambda one: _duration(one, times, first, last))
    durations = _duration(order, *moves), _duration(np.arange(n), *moves)
    return VisitingOrder(read_only(order), *durations, exact)


def _avoiding(
    positions: Array,
    start: Array | None,
    free: Callable[[Array, Array], BoolArray],
    times: Array,
    first: Array,
) -> tuple[Array, Array]:
    """Return times between positions, and from the start, with those of moves that are not free.

    There and back a straight move is the same.
    """
    times = times.copy()
    for i in range(len(positions) - 1):
        blocked = np.append(np.zeros(i + 1, dtype=bool), ~free(positions[i], positions[i + 1 :]))
        times[i, blocked] = times[blocked, i] = _BLOCKED
    return times, first if start is None else np.where(free(start, positions), first, _BLOCKED)


def _duration(order: IntArray, times: Array, first: Array, last: Array) -> float:
    return float(first[order[0]] + times[order[:-1], order[1:]].sum() + last[order[-1]])


def _held_karp(times: Array, first: Array, last: Array) -> IntArray:
    """Return the best order: for each set of positions and its last one, the least time."""
    n = len(times)
    best = np.full((1 << n, n), np.inf)
    before = np.zeros((1 << n, n), dtype=np.int64)
    best[1 << np.arange(n), np.arange(n)] = first
    for visited in range(1, 1 << n):
        for end in range(n):
            before_end = visited & ~(1 << end)
            if not visited >> end & 1 or not before_end:
                continue
            ways = best[before_end] + times[:, end]
            before[visited, end] = np.argmin(ways)
            best[visited, end] = ways[before[visited, end]]
    visited, end = (1 << n) - 1, int(np.argmin(best[-1] + last))
    order = [end]
    while len(order) < n:
        visited, end = visited & ~(1 << end), int(before[visited, end])
        order.append(end)
    return np.array(order[::-1])


def _improved(times: Array, first: Array, last: Array) -> IntArray:
    """Return the best of the orders that nearest neighbours lead to, each improved."""
    firsts = np.argsort(first, kind="stable")[:_STARTS]
    starts = [_nearest(times, int(s)) for s in firsts]
    orders = [_local(order, times, first, last) for order in starts]
    return min(orders, key=lambda order: _duration(order, times, first, last))


def _nearest(times: Array, start: int) -> IntArray:
    order, unvisited = [start], np.ones(len(times), dtype=bool)
    while unvisited[order[-1]] and len(order) < len(times):
        unvisited[order[-1]] = False
        order.append(int(np.argmin(np.where(unvisited, times[order[-1]], np.inf))))
    return np.array(order)


def _local(order: IntArray, times: Array, first: Array, last: Array) -> IntArray:
    """Return an order that reversing a part (2-opt) or moving up to 3 (Or-opt) cannot shorten."""
    duration = _duration(order, times, first, last)
    improved = True
    while improved:
        improved = False
        for other in _neighbours(order):
            new = _duration(other, times, first, last)
            if new < duration - 1e-9:
                order, duration, improved = other, new, True
                break
    return order


def _neighbours(order: IntArray) -> Iterator[IntArray]:
    n = len(order)
    for i in range(n - 1):
        for j in range(i + 2, n + 1):
            yield np.concatenate([order[:i], order[i:j][::-1], order[j:]])
    for size in (1, 2, 3):
        for i in range(n - size + 1):
            part, others = order[i : i + size], np.delete(order, np.s_[i : i + size])
            for j in range(len(others) + 1):
                if j != i:
                    yield np.concatenate([others[:j], part, others[j:]])
                    yield np.concatenate([others[:j], part[::-1], others[j:]])
