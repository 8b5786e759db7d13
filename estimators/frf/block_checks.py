"""What blocks, runs and samples of one position say of each other, before they are averaged."""

import numpy as np
from numpy.typing import NDArray

from estimators.frf.input_rank import excited_rank, input_noise
from estimators.frf.record_checks import check_records, warn
from estimators.frf.spectra import Spectra
from robotmodels.common.arrays import Array, ComplexArray, IntArray
from robotmodels.common.errors import InvalidInput
from robotmodels.records.records import Records

_SAME_PHASES = 0.98  # coherence of two blocks' excitation
_FEWEST_PHASES = 8
_OUTLIER = 25.0  # of a run's misfit power, against the same run's of other blocks
_LEAST_MISFIT = 0.05  # of a run's signal, rms
_REACH = 20  # samples that a slip may have
_JUMP = 5.0  # from the end of a period to its start, against other steps, rms
_WRAP = 0.4  # of the range, that a step from one sample to the next is not
_FEW_LEVELS = 40
_NAMED = 8  # lines in a message
_ROUNDING = 1e-13


def check_samples(records: Records, who: str) -> None:
    """Refuse copies; warn of angles that wrap, jump between periods or have few levels.

    Raises
    ------
    InvalidInput
        Naming blocks that hold the same samples, and as `check_records`.
    """
    check_records(records, 0, who)
    angle, present = records.angle[0], ~records.missing[0]
    _refuse_copies(angle, present, who)
    runs = angle[present]  # (runs, P, N, m)
    for i in range(runs.shape[-1]):
        _check_angle(runs[..., i], f"{who}: output {i + 1}")


def _refuse_copies(angle: Array, present: NDArray[np.bool_], who: str) -> None:
    blocks: dict[bytes, int] = {}
    for b, block in enumerate(angle):
        if not present[b].all() or np.ptp(block) == 0:
            continue
        first = blocks.setdefault(block.tobytes(), b)
        if first != b:
            raise InvalidInput(
                f"{who}: blocks {first + 1} and {b + 1} hold the same samples; a copy counts as "
                "new data, leave it out"
            )


def _check_angle(signal: Array, who: str) -> None:
    """Check the samples (runs, P, N) of one output."""
    size = float((signal.max(axis=-1) - signal.min(axis=-1)).max())
    if size == 0:
        return
    steps = np.abs(np.diff(signal, axis=-1))
    largest = steps.max()
    wraps = steps > largest / 2
    if largest > _WRAP * size and wraps.mean() < 0.02 and steps[~wraps].max() < largest / 3:
        warn(
            f"{who}: {int(wraps.sum())} steps of {largest:.3g} rad from one sample to the next, "
            f"others below {steps[~wraps].max():.2g}: the angle wraps around or samples are lost; "
            "unwrap it"
        )
        return
    last = signal[:, -1]  # earlier periods may hold the transient
    jump = np.sqrt(np.mean((last[..., 0] - last[..., -1]) ** 2))
    usual = np.sqrt(np.mean(steps**2))
    if jump > _JUMP * usual:
        warn(
            f"{who}: from the end of a period to its start the angle jumps by {jump:.3g} rad, "
            f"{jump / usual:.2g} times a usual step: it drifts, or these are no whole periods"
        )
    levels = len(np.unique(signal[0, 0]))
    if levels <= _FEW_LEVELS < signal.shape[-1] / 4:
        warn(f"{who}: the angle has {levels} different values in a period; move more")


def check_excited(
    measured: Spectra, records: Records, lines: IntArray, who: str, least: int
) -> None:
    """Refuse lines at which fewer than `least` torques are independent above their noise.

    Their FRFs would be noise over noise.

    Raises
    ------
    InvalidInput
        Naming them.
    """
    rank = excited_rank(measured, input_noise(records, measured, lines))
    few = rank < least
    if (rank == 0).any():
        raise InvalidInput(
            f"{who}: {line_words(lines[rank == 0], records)} are declared as excited, but "
            "no motor's torque is above its noise there, or the reference is zero; leave them out, "
            "or mend the number of samples a period"
        )
    if few.any():
        raise InvalidInput(
            f"{who}: {line_words(lines[few], records)}: {rank[few].min()} of {least} torques are "
            "independent above their noise; leave them out (estimators.excitation tells which are "
            "usable), or excite every motor at them"
        )


def line_words(lines: IntArray, records: Records) -> str:
    """Return words for lines: how many, their numbers and band."""
    numbers = ", ".join(map(str, lines[:_NAMED])) + (", ..." if len(lines) > _NAMED else "")
    unit = 1 / (records.samples * records.sample_time)
    word = "line" if len(lines) == 1 else "lines"
    return f"{len(lines)} {word}, {numbers} ({unit * lines[0]:.4g} to {unit * lines[-1]:.4g} Hz)"


def check_copied_periods(measured: Spectra, who: str) -> None:
    """Warn of periods that are the same to rounding: a noise covariance would be of nothing."""
    output = measured.output
    size = np.abs(output).max()
    if size > 0 and np.abs(output - output[:, :1]).max() <= _ROUNDING * size:
        warn(f"{who}: all periods hold the same samples; copies carry no information on noise")


def check_blocks(measured: Spectra, who: str) -> None:
    """Warn of blocks without new phases, and of runs that differ from those of other blocks."""
    _check_phases(measured, who)
    complete = measured.blocks(measured.complete)
    B, _, _, n, E = complete.input.shape
    if B > 2 and n == E:
        _check_runs(complete, np.flatnonzero(measured.complete), who)


def _check_phases(measured: Spectra, who: str) -> None:
    signal = measured.reference if measured.reference.any() else measured.input
    blocks = signal.mean(axis=1)[measured.complete]
    if len(blocks) < 2 or blocks[0].size < _FEWEST_PHASES or blocks.shape[1] < 2:
        return
    flat = blocks.reshape(len(blocks), -1)
    power = np.sum(np.abs(flat) ** 2, axis=1)
    with np.errstate(all="ignore"):
        coherence = np.abs(flat @ flat.conj().T) ** 2 / np.outer(power, power)
    alike = np.triu(coherence > _SAME_PHASES, 1)
    if alike.any():
        first, second = np.argwhere(alike)[0] + 1
        warn(
            f"{who}: blocks {first} and {second} have the same phases; what is not linear repeats "
            "in them, and their scatter hides it: give each block new random phases"
        )


def _check_runs(measured: Spectra, numbers: IntArray, who: str) -> None:
    """Compare each run with what the median FRF of all blocks makes of its torques."""
    Y, U, _ = measured.averaged()  # (B, F, ., E)
    try:
        G = np.linalg.solve(np.swapaxes(U, -1, -2), np.swapaxes(Y, -1, -2)).swapaxes(-1, -2)
    except np.linalg.LinAlgError:  # of which methods that sum over blocks make the best
        return
    median = np.median(G.real, axis=0) + 1j * np.median(G.imag, axis=0)
    expected = median @ U
    size = np.sqrt((np.abs(Y) ** 2).mean(axis=(0, 3), keepdims=True))
    size = np.where(size > 0, size, 1.0)
    power = (np.abs((Y - expected) / size) ** 2).mean(axis=1)  # (B, m, E)
    usual = np.maximum(np.median(power, axis=0), 1e-300)
    outlier = ((power > _OUTLIER * usual) & (power > _LEAST_MISFIT**2)).any(axis=1)
    for b, e in np.argwhere(outlier):
        slip = _slip(Y[b, ..., e], expected[b, ..., e], measured.omega)
        words = "samples lost, a disturbance, or another excitation"
        if slip:
            words = f"its angles lie {abs(slip) * 1e3:.3g} ms {'late' if slip > 0 else 'early'}"
        warn(
            f"{who}: block {numbers[b] + 1}, run {e + 1} differs from the same run of other blocks "
            f"by {np.sqrt(power[b, :, e].max()):.2g} of the signal, they by "
            f"{np.sqrt(usual[:, e].max()):.2g}: {words}; leave it out or mend it"
        )


def _slip(output: ComplexArray, expected: ComplexArray, omega: Array) -> float:
    """Return the delay [s] of outputs (F, m) that explains nearly all of their difference, or 0."""
    delays = np.linspace(-_REACH, _REACH, 40 * _REACH + 1) / (omega[-1] / np.pi)
    shifts = np.exp(-1j * omega * delays[:, None])[..., None]
    size = np.maximum(np.abs(expected), 1e-300)
    errors = (np.abs((output - shifts * expected) / size) ** 2).sum(axis=(1, 2))
    best = int(np.argmin(errors))
    return float(delays[best]) if errors[best] < 0.1 * errors[len(delays) // 2] else 0.0
