"""How many periods a transient lasts, judged from the periods themselves."""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from estimators.frf.spectra import Spectra
from estimators.levels import check_level
from robotmodels.arrays import Array, ComplexArray

# Chance of dropping a period from records without a transient.
LEVEL = 1e-4
# Deviations below this part of the signal are left alone, however significant.
NEGLIGIBLE = 1e-4
_ROUNDING = 1e-13
_DEGREES = 12  # pool neighbouring lines until a variance rests on at least so many


@dataclass(frozen=True, eq=False)
class Settling:
    """How each period compares with the later ones.

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


def settling(found: Spectra, level: float = LEVEL, negligible: float = NEGLIGIBLE) -> Settling:
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
    signal = np.concatenate([found.input, found.output], axis=3)[found.present.any(axis=1)]
    P = signal.shape[1]
    p_values, deviations = [], []
    for p in range(P - 2):
        chance, deviation = _compare(signal[:, p], signal[:, p + 1 :], found)
        p_values.append(chance)
        deviations.append(deviation)
    unsettled = [a < level and b > negligible for a, b in zip(p_values, deviations, strict=True)]
    first = next((p for p, bad in enumerate(unsettled) if not bad), len(unsettled))
    return Settling(first, np.array(p_values), np.array(deviations))


def _compare(period: ComplexArray, later: ComplexArray, found: Spectra) -> tuple[float, float]:
    """Return the chance of a difference so large, and its size, of (B, F, c, E) spectra."""
    K = later.shape[1]
    mean = later.mean(axis=1)
    # Channels differ in size and unit, lines in noise: sums over experiments only.
    apart = (np.abs(period - mean) ** 2).sum(axis=(0, 3))
    scatter = (np.abs(later - mean[:, None]) ** 2).sum(axis=(0, 1, 4)) / (K - 1)
    size = (np.abs(mean) ** 2).sum(axis=(0, 3))
    # Line by line: a transient is slow, and would drown in the acceleration at high frequencies.
    parts = np.divide(apart, size, out=np.zeros_like(apart), where=size > 0)
    relative = float(np.sqrt(parts.mean(axis=0).max()))
    experiments = int(found.present.sum())
    ratio, degrees = _ratios(apart / (1 + 1 / K), scatter, size, (experiments, K))
    if not ratio.size:
        return 1.0, relative
    below = max(degrees * (K - 1), 5)
    centre = below / (below - 2)
    spread = centre * np.sqrt(2 * (degrees + below - 2) / (degrees * (below - 4)))
    # Feedback makes the channels' errors dependent: only lines count as independent.
    score = (ratio.mean() - centre) / (spread / np.sqrt(len(ratio)))
    return float(ndtr(-score)), relative


def _ratios(apart: Array, scatter: Array, size: Array, count: tuple[int, int]) -> tuple[Array, int]:
    """Return F ratios (groups of lines, channels) and the degrees of freedom of what is above.

    Channels that do not change at all, such as torques in open loop, are left out.
    """
    experiments, later = count
    rounding = _ROUNDING**2 * size
    moving = ((apart > rounding) | (scatter > rounding)).any(axis=0)
    apart, scatter, rounding = (a[:, moving] for a in (apart, scatter, rounding))
    lines = len(apart)
    group = min(lines, int(np.ceil(_DEGREES / (2 * experiments * (later - 1)))))
    starts = np.arange(0, lines - group + 1, group)
    # Without any scatter among the later periods a difference is beyond doubt.
    scatter = np.maximum(scatter, rounding)
    above, below = (np.add.reduceat(a[: starts[-1] + group], starts) for a in (apart, scatter))
    return np.asarray(above / np.where(below > 0, below, 1.0)), 2 * experiments * group
