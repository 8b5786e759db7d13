"""A line through stamps, block by block: long logs have more stamps than memory for copies."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from robotmodels.common.arrays import Array, BoolArray, IntArray

_BLOCK = 1 << 17  # stamps
_WINDOW = 8  # stamps on both sides that tell a gap from a late stamp
_RESTART = 5  # spacings that the time runs back by where it begins anew, and rises after
_MOST_MISSING = 2**40  # ticks
_LEAST_STEP = 1e-3  # of the usual step; smaller ones repeat a time


@dataclass(frozen=True, eq=False)
class StampLine:
    """Stretches of samples, and the line ``offset + slope * tick`` through their stamps.

    Attributes
    ----------
    slope, offset : float, s
        Of the line.
    rows, ticks, counts : ndarray of int
        First row, first tick and length of stretches in which both rise by one.
    jitter, worst : float, s
        Root mean square and largest distance of the stamps from the line.
    """

    slope: float
    offset: float
    rows: IntArray
    ticks: IntArray
    counts: IntArray
    jitter: float
    worst: float


def continued_stamps(stamps: Array) -> tuple[Array, tuple[int, ...]]:
    """Return stamps that go on rising where recordings were put one behind the other.

    Returns
    -------
    stamps : ndarray
        The argument itself where no time begins anew.
    rows : tuple of int
        Rows at which one does.
    """
    spacing, backward = _usual_step(stamps), []
    for low in range(0, len(stamps) - 1, _BLOCK):
        steps = np.diff(stamps[low : low + _BLOCK + 1])
        backward += (low + 1 + np.flatnonzero(steps < -_RESTART * spacing)).tolist()
    # What runs back for a row or two is a stamp that came wrong, not a recording.
    starts = [row for row in backward if _goes_on(stamps[row : row + _RESTART])]
    if starts:
        stamps = stamps.copy()
    for row in starts:
        stamps[row:] += stamps[row - 1] + _RESTART * spacing - stamps[row]
    return stamps, tuple(starts)


def rising(stamps: Array) -> BoolArray:
    """Return which stamps are finite and later than all before, by more than rounding."""
    valid = np.zeros(len(stamps), dtype=bool)
    least, latest = _LEAST_STEP * _usual_step(stamps), -np.inf
    for low in range(0, len(stamps), _BLOCK):
        block = np.where(
            np.isfinite(stamps[low : low + _BLOCK]), stamps[low : low + _BLOCK], -np.inf
        )
        before = np.maximum.accumulate(np.concatenate([[latest], block]))
        valid[low : low + _BLOCK] = block > before[:-1] + (least if np.isfinite(least) else 0.0)
        latest = before[-1]
    return valid


def fit_line(stamps: Array, valid: BoolArray, slope: float | None = None) -> StampLine:
    """Return the line through valid stamps; with `slope` [s] where that is stated."""
    spacing = _spacing(stamps, valid) if slope is None else slope
    rows, ticks, counts = _stretches(stamps, valid, spacing)
    moments = _Moments()
    for k, t in _samples(stamps, rows, ticks, counts):
        moments.add(k, t)
    fitted = moments.covariance / moments.variance if slope is None else slope
    offset = moments.mean_time - fitted * moments.mean_tick
    square, worst = 0.0, 0.0
    for k, t in _samples(stamps, rows, ticks, counts):
        residual = t - offset - fitted * k
        square += float(residual @ residual)
        worst = max(worst, float(np.abs(residual).max()))
    jitter = float(np.sqrt(square / counts.sum()))
    return StampLine(float(fitted), float(offset), rows, ticks, counts, jitter, worst)


@dataclass
class _Moments:
    """Means and second moments of ticks and times, block by block without cancellation."""

    count: int = 0
    mean_tick: float = 0.0
    mean_time: float = 0.0
    variance: float = 0.0
    covariance: float = 0.0

    def add(self, k: Array, t: Array) -> None:
        n, total = len(k), self.count + len(k)
        mean_k, mean_t = float(k.mean()), float(t.mean())
        dk, dt = mean_k - self.mean_tick, mean_t - self.mean_time
        weight = self.count * n / total
        centred = k - mean_k
        self.variance += float(centred @ centred) + weight * dk * dk
        self.covariance += float(centred @ (t - mean_t)) + weight * dk * dt
        self.mean_tick += dk * n / total
        self.mean_time += dt * n / total
        self.count = total


def _samples(
    stamps: Array, rows: IntArray, ticks: IntArray, counts: IntArray
) -> Iterator[tuple[Array, Array]]:
    """Yield ticks and stamps of all samples, block by block."""
    for low in range(0, len(rows), _BLOCK // 64):
        part = slice(low, low + _BLOCK // 64)
        for row, tick, count in zip(rows[part], ticks[part], counts[part], strict=True):
            for start in range(0, int(count), _BLOCK):
                stop = min(start + _BLOCK, int(count))
                k = np.arange(tick + start, tick + stop, dtype=float)
                yield k, stamps[row + start : row + stop]


def _stretches(
    stamps: Array, valid: BoolArray, spacing: float
) -> tuple[IntArray, IntArray, IntArray]:
    rows: list[int] = []
    ticks: list[int] = []
    starts: list[int] = []
    tick, last, done = -1, -2, 0
    for low in range(0, len(stamps), _BLOCK):
        inside = low + np.flatnonzero(valid[low : low + _BLOCK])
        if not len(inside):
            continue
        increments = _increments(stamps, valid, inside, last, spacing)
        numbers = tick + np.cumsum(increments)
        before = np.concatenate([[last], inside[:-1]])
        breaks = np.flatnonzero((inside - before > 1) | (increments > 1))
        rows += inside[breaks].tolist()
        ticks += numbers[breaks].tolist()
        starts += (done + breaks).tolist()
        tick, last, done = int(numbers[-1]), int(inside[-1]), done + len(inside)
    return np.array(rows), np.array(ticks), np.diff([*starts, done])


def _increments(
    stamps: Array, valid: BoolArray, inside: IntArray, last: int, spacing: float
) -> IntArray:
    """Return by how many ticks each valid row of a block is later than the one before."""
    before = np.concatenate([[last if last >= 0 else inside[0]], inside[:-1]])
    increments = np.ones(len(inside), dtype=int)
    for i in np.flatnonzero(stamps[inside] - stamps[before] > 1.5 * spacing):
        increments[i] = _missing(stamps, valid, int(before[i]), int(inside[i]), spacing)
    return increments


def _missing(stamps: Array, valid: BoolArray, before: int, after: int, spacing: float) -> int:
    """Return the ticks of a long step: more than one only if later stamps stay behind."""
    low, high = max(0, before - 4 * _WINDOW), after + 4 * _WINDOW
    earlier = stamps[low : before + 1][valid[low : before + 1]][-_WINDOW:]
    later = stamps[after:high][valid[after:high]][:_WINDOW]
    ends = earlier + spacing * np.arange(len(earlier) - 1, -1, -1)
    shift = np.median(later - spacing * np.arange(len(later))) - np.median(ends)
    return int(np.clip(np.rint(shift / spacing), 1, _MOST_MISSING))


def _spacing(stamps: Array, valid: BoolArray) -> float:
    """Return the usual spacing; the mean of usual steps, where stamps are rounded."""
    head = stamps[:_BLOCK][valid[:_BLOCK]]
    steps = np.diff(head if len(head) > 2 else stamps[valid])
    middle = float(np.median(steps))
    usual = steps[(steps > 0.5 * middle) & (steps < 1.5 * middle)]
    return float(usual.mean()) if len(usual) else middle


def _usual_step(stamps: Array) -> float:
    head = stamps[np.isfinite(stamps)] if len(stamps) < _BLOCK else stamps[:_BLOCK]
    steps = np.diff(head[np.isfinite(head)])
    steps = steps[steps > 0]
    return float(np.median(steps)) if len(steps) else float(np.inf)


def _goes_on(stamps: Array) -> bool:
    return len(stamps) > 2 and bool((np.diff(stamps) > 0).all())
