"""One pass through a channel: range, jumps by whole turns, steps, values at the limits."""

from dataclasses import dataclass

import numpy as np

from robotmodels.common.arrays import Array, IntArray
from robotmodels.logs.binding import BoundSignal

JUMP = 0.75
"""Of a turn, from which a step is a jump."""
_SPAN = 1.01  # of what a counter runs through before it begins anew
_FASTER = 2.0  # than elsewhere, that a step behind a jump may be
_FEW_LEVELS = 64
_SATURATED = 0.01
_DRIVES = ("torque", "current")


@dataclass(frozen=True, eq=False)
class Survey:
    """What one pass through a channel shows, in the unit of the channel.

    Attributes
    ----------
    low, high : float
        Range; NaN where no value is finite.
    missing : int
        Values that are not finite.
    jumps, turns : ndarray of int
        Rows at which the channel jumps by whole turns, and the turns since its beginning.
    wraps : bool
        Whether they are those of a counter that begins anew, see `wraps`.
    quantum : float
        Smallest step, 0 where nothing changes.
    at_limit : int
        Values equal to the largest or the smallest, where steps around are smaller than usual.
    changes : int
        Rows at which the value changes.
    rows : int
        Rows of the channel.
    """

    low: float
    high: float
    missing: int
    jumps: IntArray
    turns: IntArray
    wraps: bool
    quantum: float
    at_limit: int
    changes: int
    rows: int

    @property
    def constant(self) -> bool:
        """Whether the channel never changes."""
        return not self.high > self.low

    def unwrapped(self, values: Array, start: int, turn: float) -> Array:
        """Return values of rows from `start` on without their jumps."""
        if not len(self.jumps):
            return values
        index = np.searchsorted(self.jumps, np.arange(start, start + len(values)), "right")
        return np.asarray(values - turn * np.r_[0, self.turns][index])


def survey(signal: BoundSignal) -> Survey:
    """Pass through the channel of a signal."""
    limits, quantum, changes, row, last = _Limits(), np.inf, 0, 0, np.nan
    jumps: list[IntArray] = [np.empty(0, dtype=int)]
    steps_by_turns: list[Array] = [np.empty(0)]
    fastest = 0.0
    for piece in signal.table.pieces(signal.channel):
        values = np.asarray(piece, dtype=float)
        limits.add(values)
        steps = np.diff(values, prepend=last)
        size = np.abs(steps[np.isfinite(steps) & (steps != 0)])
        changes += len(size)
        quantum = min(quantum, size.min(initial=np.inf))
        if signal.turn:
            hits = np.flatnonzero(np.abs(steps) > JUMP * signal.turn).astype(int)
            jumps.append(row + hits)
            steps_by_turns.append(steps[hits] / signal.turn)
            fastest = max(fastest, size[size <= JUMP * signal.turn].max(initial=0.0) / signal.turn)
        last, row = values[-1], row + len(values)
    by_turns = np.concatenate(steps_by_turns)
    span = (limits.high - limits.low) / signal.turn if signal.turn else 0.0
    return Survey(
        low=limits.low if limits.low <= limits.high else np.nan,
        high=limits.high if limits.low <= limits.high else np.nan,
        missing=limits.missing,
        jumps=np.concatenate(jumps),
        turns=np.cumsum(np.rint(by_turns)).astype(int),
        wraps=wraps(by_turns, span, fastest),
        quantum=float(quantum) if np.isfinite(quantum) else 0.0,
        at_limit=max(limits.at_low, limits.at_high) if limits.high > limits.low else 0,
        changes=changes,
        rows=row,
    )


def wraps(steps: Array, span: float, fastest: float) -> bool:
    """Return whether steps are those of a counter that begins anew.

    It does so after one turn, or a power of two of them, and spans no more. Other steps lead to
    another recording, or over a gap.

    Parameters
    ----------
    steps : ndarray, (jumps,), turns
        Steps of more than `JUMP`.
    span, fastest : float, turns
        Range of the channel, and its largest step elsewhere.
    """
    turns = np.abs(np.rint(steps))
    size = turns.max(initial=0.0)
    if size == 0 or (turns != size).any() or np.log2(size) % 1 or span > _SPAN * size:
        return False
    likely = np.abs(np.abs(steps) - size) <= _FASTER * fastest
    return bool(likely.mean() >= 0.5)


@dataclass
class _Limits:
    """Range of values so far, and how often its ends were met."""

    low: float = np.inf
    high: float = -np.inf
    at_low: int = 0
    at_high: int = 0
    missing: int = 0

    def add(self, values: Array) -> None:
        finite = values[np.isfinite(values)]
        self.missing += len(values) - len(finite)
        if not len(finite):
            return
        low, high = float(finite.min()), float(finite.max())
        self.at_low = (0 if low < self.low else self.at_low) + int(
            (finite <= min(low, self.low)).sum()
        )
        self.at_high = (0 if high > self.high else self.at_high) + int(
            (finite >= max(high, self.high)).sum()
        )
        self.low, self.high = min(low, self.low), max(high, self.high)


def signal_key(signal: BoundSignal) -> str:
    """Return what tells a signal from the others."""
    return f"{signal.role}:{signal.name}"


def unwraps(signal: BoundSignal, seen: Survey) -> bool:
    """Return whether jumps by whole turns are taken out, as the mapping or the jumps say."""
    if not len(seen.jumps):
        return False
    return seen.wraps if signal.entry.wrapped is None else signal.entry.wrapped


def survey_messages(signal: BoundSignal, seen: Survey, absent: bool) -> list[str]:
    """Return what a person should know of a channel, in words.

    Parameters
    ----------
    absent : bool
        Whether a channel that never changes counts as no measurement.
    """
    name = f"{signal.channel} ({signal.role} of {signal.name})"
    if seen.constant:
        value = "zero" if seen.low == 0 else f"{seen.low:g}"
        meaning = "it counts as absent, not as measured" if absent else "nothing moves"
        return [f"{name}: {value} throughout; {meaning}"]
    lines = []
    if seen.missing:
        lines.append(f"{name}: {seen.missing} of {seen.rows} values are missing")
    if unwraps(signal, seen):
        lines.append(f"{name}: {len(seen.jumps)} jumps by whole turns are taken out")
    elif len(seen.jumps) and signal.entry.wrapped is None:
        lines.append(
            f"{name}: {len(seen.jumps)} steps of more than {JUMP} turns are left, since no counter "
            "begins anew there; wrapped: true would take them out"
        )
    levels = (seen.high - seen.low) / seen.quantum
    if levels < _FEW_LEVELS:
        lines.append(
            f"{name}: only {levels:.0f} levels, {seen.quantum:.3g} {signal.unit} apart; the "
            "quantisation is coarse"
        )
    elif signal.role.endswith(_DRIVES) and seen.at_limit > _SATURATED * seen.rows:
        lines.append(
            f"{name}: {seen.at_limit} of {seen.rows} values at the limit of {seen.high:.5g} or "
            f"{seen.low:.5g} {signal.unit}; it may have saturated"
        )
    if 0 < seen.changes < 0.55 * seen.rows and levels >= _FEW_LEVELS:
        lines.append(
            f"{name}: {1 - seen.changes / seen.rows:.0%} of values repeat the one before: rest, "
            "or a channel slower than its table"
        )
    return lines
