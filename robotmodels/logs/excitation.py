"""Where a movement repeats: period, runs in steady state, positions, excited lines."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robotmodels.common.arrays import Array, BoolArray, IntArray
from robotmodels.common.errors import InvalidInput
from robotmodels.records.movement import Movement

_REPEATS = 0.3
"""Of a joint's variation, as rms over rms, up to which a period may repeat the one before."""
_LEAST_MISFIT = 0.01  # of noise between periods that is always allowed for
_STEADY = 0.005  # of a joint's variation, by which a period in steady state may differ
_LATE = 1.25  # of the usual distance between periods, from which one is a transient
_MOVES = 0.02  # of the largest amplitude of all joints, from which a joint moves
_WHOLE = 0.05  # of a sample, by which a period may be no whole number of samples
_MOST_SPAN = 0.2  # [rad] of a joint in one position: inertias change by some per cent beyond
_STRONG = 0.1  # of the amplitude of the largest run, from which a stretch is one
_CANDIDATES = 12  # lags that are tried
_LEAST_SAMPLES = 16  # of a period
_REACH = 50  # periods over the samples by which the ends of runs are off at most
_ROUNDING = 1e-6  # of a reference's largest value, by which files may round it
_ABOVE, _SHARE = 10.0, 0.01  # of excited lines: over the median of lines, and of the largest


@dataclass(frozen=True, eq=False)
class Excitation:
    """Periodic runs in a movement.

    Attributes
    ----------
    samples : int
        Samples of a period.
    starts : ndarray of int, (runs,)
        First sample of each run, transients dropped.
    periods : ndarray of int, (runs,)
        Whole periods of each run from there.
    lines : ndarray of int, (F,)
        Excited DFT lines of a period.
    notes : tuple of str
        What was seen, in words.
    """

    samples: int
    starts: IntArray
    periods: IntArray
    lines: IntArray
    notes: tuple[str, ...]


def find_excitation(
    movement: Movement, period: float | None = None, transient: int | None = None
) -> Excitation:
    """Return the periodic runs of a movement.

    Parameters
    ----------
    movement : Movement
        Motor angles and torques, and reference velocities where there are some.
    period : float, optional, s
        Of the excitation; looked for by default.
    transient : int, optional
        Periods dropped at the beginning of each run; by default those that differ from the next.

    Raises
    ------
    InvalidInput
        If it is not periodic, saying how far each joint is from repeating; or the period is no
        whole number of samples.
    """
    angle = movement.motor_angle
    samples = _likeliest_period(angle) if period is None else _whole(period, movement.sample_time)
    starts, stops = _repeating(angle, samples)
    if not len(starts):
        raise InvalidInput(f"not periodic: {_by_joint(movement, samples)}")
    starts, periods = _without_transients(angle, samples, starts, stops, transient)
    for role in ("reference_velocity", "reference_torque"):
        if (reference := movement.signals.get(role)) is not None and np.isfinite(reference).all():
            starts = _aligned(reference, samples, starts, periods)
            break
    lines = _excited_lines(movement, samples, starts, periods)
    seconds = samples * movement.sample_time
    notes: tuple[str, ...] = (
        f"period of {samples} samples, {seconds:.6g} s; {len(starts)} runs of "
        f"{periods.min()} to {periods.max()} whole periods in steady state",
        f"{len(lines)} excited lines from {lines[0] / seconds:.4g} to {lines[-1] / seconds:.4g} Hz",
    )
    notes += tuple(_wide_runs(movement, samples, starts, periods))
    return Excitation(samples, starts, periods, lines, notes)


def _without_transients(
    angle: Array, samples: int, starts: IntArray, stops: IntArray, transient: int | None
) -> tuple[IntArray, IntArray]:
    """Return starts and whole periods of runs without their first periods.

    Dropped are `transient` of them, or those that differ from the last by more than others do.
    """
    present = np.isfinite(angle).all(axis=0)
    begun, counts = [], []
    for start, stop in zip(starts, stops, strict=True):
        count = int((stop - start) // samples)
        run = angle[start : start + count * samples, present].reshape(count, samples, -1)
        dropped = _transient_periods(run) if transient is None else transient
        if count > dropped:
            begun.append(int(start) + dropped * samples)
            counts.append(count - dropped)
    if not begun:
        raise InvalidInput(f"periods: none is left after a transient of {transient}")
    return np.array(begun), np.array(counts)


def _aligned(reference: Array, samples: int, starts: IntArray, periods: IntArray) -> IntArray:
    """Return the starts (runs,) near which a reference (N, n) repeats best, the nearest such ones.

    Angles show the ends of runs to some samples only, where the motion changes little in between.
    """
    reach = max(samples // _REACH, 1)
    aligned = []
    for start, length in zip(starts.tolist(), (periods * samples).tolist(), strict=True):
        first, last = max(start - reach, 0), min(start + reach, len(reference) - length)
        near = sorted(range(first, last + 1), key=lambda each: abs(each - start))
        runs = (reference[each : each + length] for each in near)
        misfits = np.array([np.abs(run[samples:] - run[:-samples]).mean() for run in runs])
        rounding = _ROUNDING * np.abs(reference[start : start + length]).max()
        aligned.append(near[int(np.argmax(misfits <= misfits.min() + rounding))])
    return np.array(aligned)


def _transient_periods(run: Array) -> int:
    """Return how many periods at the beginning are farther from the last than noise explains."""
    distance = np.sqrt(((run[:-1] - run[-1]) ** 2).mean(axis=1))  # (periods - 1, joints)
    if len(distance) < 2:
        return 0
    usual = np.median(distance[len(distance) // 2 :], axis=0)
    late = (distance > _LATE * usual + _STEADY * run[-1].std(axis=0)).any(axis=1)
    return int(np.flatnonzero(late)[-1]) + 1 if late.any() else 0


def run_positions(movement: Movement, excitation: Excitation) -> Array:
    """Return the mean angles of each run, (runs, n) [rad]."""
    spans = zip(excitation.starts, excitation.periods * excitation.samples, strict=True)
    return np.array([movement.motor_angle[a : a + n].mean(axis=0) for a, n in spans])


def _whole(period: float, sample_time: float) -> int:
    samples = round(period / sample_time)
    if samples < _LEAST_SAMPLES or abs(period / sample_time - samples) > _WHOLE:
        raise InvalidInput(
            f"period: {period:g} s are {period / sample_time:.6g} samples; a whole number of "
            f"{_LEAST_SAMPLES} or more is needed"
        )
    return samples


def _likeliest_period(angle: Array) -> int:
    """Return the lag after which most samples repeat, the shortest of those nearly alike."""
    speed = np.diff(angle[:, np.isfinite(angle).all(axis=0)], axis=0)
    low, high = np.quantile(speed, [0.005, 0.995], axis=0)  # moves between positions
    np.clip(speed, low, high, out=speed)
    speed = speed[:, np.ptp(speed, axis=0) > 0]
    peaks = _correlation_peaks(speed).tolist() if speed.size else []
    lags = sorted({_nearest_repeat(speed, peak) for peak in peaks})
    covered = [int(np.subtract(*_repeating(angle, lag)[::-1]).sum()) for lag in lags]
    if not covered:
        return _LEAST_SAMPLES
    most = max(covered)
    return next(lag for lag, count in zip(lags, covered, strict=True) if count >= 0.8 * most)


def _correlation_peaks(speed: Array) -> IntArray:
    """Return lags at which speeds are alike, the most alike first."""
    n = len(speed)
    correlation = np.zeros(n // 2 + 1)
    for column in speed.T:  # one by one: spectra of all joints would be the most in memory
        spectrum = np.abs(np.fft.rfft(column / column.std(), 2 * n)) ** 2
        correlation += np.fft.irfft(spectrum)[: n // 2 + 1]
    inner = np.arange(_LEAST_SAMPLES, len(correlation) - 1)
    rises = correlation[inner] >= correlation[inner - 1]
    peaks = inner[rises & (correlation[inner] > correlation[inner + 1])]
    return np.asarray(peaks[np.argsort(-correlation[peaks])][:_CANDIDATES])


def _nearest_repeat(speed: Array, lag: int) -> int:
    """Return the lag near `lag` after which speeds differ least; moves would pull the peak."""
    near = [each for each in range(lag - 2, lag + 3) if _LEAST_SAMPLES <= each < len(speed)]
    costs = [float(np.median(np.abs(speed[each:] - speed[:-each]), axis=0).sum()) for each in near]
    return near[int(np.argmin(costs))]


def _repeating(angle: Array, samples: int) -> tuple[IntArray, IntArray]:
    """Return first samples and ends of stretches in which all moving joints repeat a period."""
    if len(angle) < 2 * samples:
        empty = np.zeros(0, dtype=int)
        return empty, empty
    misfit, variation = _misfits(angle, samples)
    largest = variation.max(axis=1)
    moves = variation > _MOVES * largest[:, None]
    np.divide(misfit, variation, out=misfit, where=moves)
    ratio = np.where(moves, misfit, 0.0).max(axis=1)
    ratio[largest <= 0] = np.inf
    spans = [_clean_part(ratio, a, b, samples) for a, b in _true_spans(ratio < _REPEATS)]
    # A rest with a little noise may repeat too, but moves less than runs do.
    size = np.array([largest[a : max(b - 2 * samples, a) + 1].mean() for a, b in spans])
    strong = [span for span, each in zip(spans, size, strict=True) if each > _STRONG * size.max()]
    starts, ends = np.array(strong, dtype=int).reshape(-1, 2).T
    return starts, ends


def _true_spans(mask: BoolArray) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _clean_part(ratio: Array, first: int, stop: int, samples: int) -> tuple[int, int]:
    """Return first sample and end of the part of a stretch that repeats as well as noise lets it.

    A window that reaches by a share f into another movement has a misfit of about sqrt(2 f).
    """
    limit = max(2 * float(np.quantile(ratio[first:stop], 0.25)), _LEAST_MISFIT)
    low, high = max(_true_spans(ratio[first:stop] <= limit), key=lambda span: span[1] - span[0])
    margin = int(np.ceil(0.5 * limit**2 * samples))
    length = high - 1 - low + 2 * samples
    spare = length % samples
    if spare <= 2 * margin:  # whole periods, of which neither end is known better than that
        return first + low + spare // 2, first + low + spare // 2 + length - spare
    return first + low + margin, first + low + length - margin


def _misfits(angle: Array, samples: int) -> tuple[Array, Array]:
    """Return rms of the difference to the next period and of the variation, at each sample.

    Both over the period that begins there, (N - 2 samples + 1, n).
    """
    present = np.flatnonzero(np.isfinite(angle).all(axis=0))
    misfit, variation = np.empty((2, len(angle) - 2 * samples + 1, len(present)))
    for column, joint in enumerate(present):
        values = angle[:, joint] - angle[:, joint].mean()
        square = _window_mean((values[samples:] - values[:-samples]) ** 2, samples)
        misfit[:, column] = np.sqrt(np.maximum(square, 0.0))
        variance = _window_mean(values**2, samples) - _window_mean(values, samples) ** 2
        variation[:, column] = np.sqrt(np.maximum(variance[: len(misfit)], 0.0))
    return misfit, variation


def _window_mean(values: Array, samples: int) -> Array:
    total = np.concatenate([[0.0], np.cumsum(values)])
    return np.asarray((total[samples:] - total[:-samples]) / samples)


def _by_joint(movement: Movement, samples: int) -> str:
    """Return how far each moving joint is from repeating, at its best."""
    if len(movement) < 2 * samples:
        return f"{len(movement)} samples are less than two periods of {samples}"
    misfit, variation = _misfits(movement.motor_angle, samples)
    present = np.flatnonzero(np.isfinite(movement.motor_angle).all(axis=0))
    size = np.median(variation, axis=0)
    shares = [
        f"{movement.joints[j]} by {np.median(misfit[:, i]) / size[i]:.0%}"
        for i, j in enumerate(present)
        if size[i] > _MOVES * size.max()
    ]
    return (
        f"after {samples * movement.sample_time:.4g} s, where joints repeat most, the next period "
        f"differs, for {', '.join(shares)} of the movement; it is kept as a movement"
    )


def _wide_runs(movement: Movement, samples: int, starts: IntArray, periods: IntArray) -> list[str]:
    """Return a warning for each run in which a joint moves too far for one position."""
    lines = []
    for number, (start, count) in enumerate(zip(starts, periods, strict=True)):
        span = np.nan_to_num(np.ptp(movement.motor_angle[start : start + count * samples], axis=0))
        worst = int(np.argmax(span))
        if span[worst] > _MOST_SPAN:
            lines.append(
                f"run {number + 1}: {movement.joints[worst]} moves by {span[worst]:.3g} rad, too "
                f"far for one position: above {_MOST_SPAN:g} rad its linear model changes"
            )
    return lines


def _excited_lines(
    movement: Movement, samples: int, starts: IntArray, periods: IntArray
) -> IntArray:
    """Return lines that stand out of their neighbours, in references or else in torques."""
    role = next(
        r for r in ("reference_velocity", "motor_torque", "motor_angle") if r in movement.signals
    )
    values = movement.signals[role]
    values = values[:, np.isfinite(values).all(axis=0)]
    amplitude = np.zeros(samples // 2)
    for start, count in zip(starts, periods, strict=True):
        run = values[start : start + count * samples].reshape(count, samples, -1).mean(axis=0)
        amplitude += (np.abs(np.fft.rfft(run, axis=0)[: samples // 2]) ** 2).sum(axis=1)
    amplitude = np.sqrt(amplitude[1:])
    floor = max(_ABOVE * float(np.median(amplitude)), _SHARE * float(amplitude.max()))
    lines = 1 + np.flatnonzero(amplitude > floor)
    return lines if len(lines) else 1 + np.array([int(np.argmax(amplitude))])


def group_runs(positions: Array, motors: int) -> list[list[list[int]]]:
    """Return runs by experiment and block: experiments where the position changes.

    Parameters
    ----------
    positions : ndarray, (runs, n), rad
        Mean angles of each run.
    motors : int
        Number of motors that move; as many runs make a block, where that comes out even.
    """
    same = 0.02  # [rad]; the mean of a run moves less, positions lie farther apart
    changes = np.abs(np.diff(positions, axis=0)).max(axis=1) > same
    visits = np.split(np.arange(len(positions)), np.flatnonzero(changes) + 1)
    return [_blocks(visit.tolist(), motors) for visit in visits]


def _blocks(runs: Sequence[int], motors: int) -> list[list[int]]:
    size = motors if len(runs) % motors == 0 else len(runs)
    return [list(runs[i : i + size]) for i in range(0, len(runs), size)]
