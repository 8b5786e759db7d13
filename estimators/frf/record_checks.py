"""What can be wrong with records before any FRF is estimated from them."""

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from estimators.frf.input_rank import condition_numbers
from estimators.frf.spectra import Spectra
from robotmodels.common.arrays import Array, ComplexArray, check_level
from robotmodels.common.errors import IdentificationWarning, InvalidInput
from robotmodels.records.records import Records

# A designed reference has all of its power at its lines, rounding and a controller's
# interpolation aside. A torque under friction has some elsewhere.
REFERENCE_SHARE = 0.9
TORQUE_SHARE = 0.5
# Beyond this condition number rounding and the faintest noise decide, not the experiments.
SINGULAR = 1e8
POOR = 1e3


def warn(message: str) -> None:
    """Warn a user of something in the data."""
    warnings.warn(message, IdentificationWarning, stacklevel=3)


def check_records(records: Records, index: int = 0, name: str | None = None) -> None:
    """Refuse what is not periodic at the declared lines; warn of what only looks wrong.

    Parameters
    ----------
    index : int
        Position to be checked.
    name : str, optional
        How messages call the position; its number, counted from 1, by default.

    Raises
    ------
    InvalidInput
        If all is missing, the reference differs from period to period or has its power elsewhere,
        or a motor is not driven at all.
    """
    who = name or f"position {index + 1}"
    present = ~records.missing[index]
    if not present.any():
        raise InvalidInput(f"{who}: every run is missing; leave the position out")
    _check_reference(records.reference[index], records, present, who)
    _check_torque(records, index, present, who)
    met = records.saturated[index].any(axis=2) & present[..., None]  # (B, E, n)
    if met.any():
        motors = ", ".join(str(j + 1) for j in np.flatnonzero(met.any(axis=(0, 1))))
        warn(
            f"{who}: the torque limit was met by motors {motors} in "
            f"{int(met.any(axis=2).sum())} of {int(present.sum())} runs; clipped torques "
            "distort the FRF, excite less"
        )


def _check_reference(
    reference: Array, records: Records, present: NDArray[np.bool_], who: str
) -> None:
    used = reference[present]  # (runs, P, N, n)
    size = np.abs(used).max(initial=0.0)
    if size == 0:
        return  # not recorded
    change = np.abs(used - used[:, :1]).max(axis=(0, 2, 3))
    if change.max() > 1e-6 * size:
        period = int(np.argmax(change > 1e-6 * size))
        raise InvalidInput(
            f"{who}: the reference is not periodic: period {period + 1} differs from period 1 by "
            f"{change[period] / size:.2g} of its largest value; are there {records.samples} "
            "samples a period?"
        )
    share = _share(used[:, 0], records)
    if share < REFERENCE_SHARE:
        raise InvalidInput(
            f"{who}: only {100 * share:.3g} % of the reference's power lies at the declared lines; "
            f"are there {records.samples} samples a period, and are the lines right?"
        )


def _check_torque(records: Records, index: int, present: NDArray[np.bool_], who: str) -> None:
    torque = records.torque[index][present].mean(axis=1)  # (runs, N, n)
    varies = np.abs(torque - torque.mean(axis=1, keepdims=True)).max(axis=(0, 1))
    if (varies == 0).any():
        motor = int(np.argmax(varies == 0))
        raise InvalidInput(f"{who}: the torque of motor {motor + 1} is constant in every run")
    share = _share(torque, records)
    if share < TORQUE_SHARE:
        warn(
            f"{who}: only {100 * share:.3g} % of the torque's power lies at the declared lines; "
            f"are there {records.samples} samples a period, and are the lines right?"
        )


def _share(signal: Array, records: Records) -> float:
    """Return which part of the power of (runs, N, n), means aside, is at the lines."""
    power = (np.abs(np.fft.rfft(signal, axis=1)[:, 1:]) ** 2).sum(axis=(0, 2))
    return float(power[records.lines - 1].sum() / power.sum())


def check_periods(measured: Spectra, who: str) -> None:
    """Warn if periods differ more than they agree."""
    for name, signal in (("torque", measured.input), ("angle", measured.output)):
        mean = signal.mean(axis=1, keepdims=True)
        scatter = np.abs(signal - mean) ** 2
        if scatter.mean() > np.mean(np.abs(mean) ** 2):
            warn(
                f"{who}: the {name}'s periods differ more than they agree; not periodic, not "
                "settled, or buried in noise"
            )


def check_condition(
    inputs: ComplexArray, omega: Array, lines: Array, who: str, what: str = "torques"
) -> None:
    """Refuse inputs (F, n, E) that do not move the n motors independently of each other.

    Rows are scaled first: motors of different size are no fault.

    Raises
    ------
    InvalidInput
        Naming line, frequency and condition number.
    """
    condition = condition_numbers(inputs)
    worst = int(np.argmax(condition))
    if condition[worst] < POOR:
        return
    message = (
        f"{who}: the {what} at line {int(lines[worst])} ({omega[worst] / (2 * np.pi):.6g} Hz) are "
        f"nearly dependent, condition number {condition[worst]:.2g}; "
    )
    if condition[worst] > SINGULAR:
        raise InvalidInput(message + "excite the motors by orthogonal signals, one set a block")
    warn(message + "the FRF there is poor")


# Chance of dropping a period from records without a transient.
LEVEL = 1e-4
# Deviations below this part of the signal are left alone, however significant.
NEGLIGIBLE = 1e-4
_ROUNDING = 1e-13
_DEGREES = 12  # pool neighbouring lines until a variance rests on at least so many


@dataclass(frozen=True, eq=False)
class Settling:
    """Differences of each period from the later ones.

    Attributes
    ----------
    first : int
        The first period that agrees with the later ones; those before it are to be dropped.
    p_values : ndarray, (P - 2,)
        Chance of a period differing from the later ones by as much as it does.
    deviations : ndarray, (P - 2,), dimensionless
        Difference from the mean of the later ones relative to it, rms over lines, of the signal
        that differs most.
    """

    first: int
    p_values: Array
    deviations: Array

    @property
    def settled(self) -> bool:
        """Whether any tested period agrees with the later ones."""
        return self.first < len(self.p_values) or not len(self.p_values)


def settling(measured: Spectra, level: float = LEVEL, negligible: float = NEGLIGIBLE) -> Settling:
    """Find the first period without a transient.

    A period's difference from the mean of the K later ones has, without a transient, (1 + 1/K)
    times their variance: line by line an F ratio, whose mean over lines is compared with what
    chance allows. The last two periods have too few successors to be judged, so fewer than three
    periods tell nothing.

    Parameters
    ----------
    level : float
        Chance of a false alarm, per period.
    negligible : float
        Transients below this part of the signal are kept.
    """
    check_level(level, "settling")
    signal = np.concatenate([measured.input, measured.output], axis=3)[measured.present.any(axis=1)]
    P = signal.shape[1]
    p_values, deviations = [], []
    for p in range(P - 2):
        chance, deviation = _compare(signal[:, p], signal[:, p + 1 :], measured)
        p_values.append(chance)
        deviations.append(deviation)
    unsettled = [a < level and b > negligible for a, b in zip(p_values, deviations, strict=True)]
    first = next((p for p, bad in enumerate(unsettled) if not bad), len(unsettled))
    return Settling(first, np.array(p_values), np.array(deviations))


def _compare(period: ComplexArray, later: ComplexArray, measured: Spectra) -> tuple[float, float]:
    """Return the chance of a difference so large, and its size, of (B, F, c, E) spectra."""
    K = later.shape[1]
    mean = later.mean(axis=1)
    # Channels differ in size and unit, lines in noise: sums over experiments only.
    difference = (np.abs(period - mean) ** 2).sum(axis=(0, 3))
    scatter = (np.abs(later - mean[:, None]) ** 2).sum(axis=(0, 1, 4)) / (K - 1)
    size = (np.abs(mean) ** 2).sum(axis=(0, 3))
    # Line by line: a transient is slow, and would drown in the acceleration at high frequencies.
    parts = np.divide(difference, size, out=np.zeros_like(difference), where=size > 0)
    relative = float(np.sqrt(parts.mean(axis=0).max()))
    runs = int(measured.present.sum())
    ratio, degrees = _ratios(difference / (1 + 1 / K), scatter, size, (runs, K))
    if not ratio.size:
        return 1.0, relative
    below = max(degrees * (K - 1), 5)
    centre = below / (below - 2)
    spread = centre * np.sqrt(2 * (degrees + below - 2) / (degrees * (below - 4)))
    # Feedback makes the channels' errors dependent: only lines count as independent.
    score = (ratio.mean() - centre) / (spread / np.sqrt(len(ratio)))
    return float(ndtr(-score)), relative


def _ratios(
    difference: Array, scatter: Array, size: Array, count: tuple[int, int]
) -> tuple[Array, int]:
    """Return F ratios (groups of lines, channels) and the degrees of freedom of what is above.

    Channels that do not change at all, such as torques in open loop, are left out.
    """
    runs, later = count
    rounding = _ROUNDING**2 * size
    moving = ((difference > rounding) | (scatter > rounding)).any(axis=0)
    difference, scatter, rounding = (a[:, moving] for a in (difference, scatter, rounding))
    lines = len(difference)
    group = min(lines, int(np.ceil(_DEGREES / (2 * runs * (later - 1)))))
    starts = np.arange(0, lines - group + 1, group)
    # Without any scatter among the later periods a difference is beyond doubt.
    scatter = np.maximum(scatter, rounding)
    above, below = (np.add.reduceat(a[: starts[-1] + group], starts) for a in (difference, scatter))
    return np.asarray(above / np.where(below > 0, below, 1.0)), 2 * runs * group
