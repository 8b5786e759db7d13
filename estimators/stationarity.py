"""How many periods a transient lasts, judged from the periods themselves."""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from estimators.spectra import Spectra
from robotmodels.arrays import Array, ComplexArray
from robotmodels.errors import InvalidInput

# Chance of dropping a period from records without a transient.
LEVEL = 1e-4
# Deviations below this part of the signal are left alone, however significant.
NEGLIGIBLE = 1e-4
_DEGREES = 12  # pool neighbouring lines until a variance rests on at least so many


@dataclass(frozen=True, eq=False)
class Settling:
    """How each period compares with the later ones.

    Attributes
    ----------
    first : the first period that agrees with the later ones; those before it are to be dropped.
    p_values : (P - 2,) chance of a period differing from the later ones by as much as it does.
    deviations : (P - 2,) rms difference from the mean of the later ones, relative to it [-].
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
    level : chance of a false alarm, per period.
    negligible : transients below this part of the signal are kept.
    """
    if not 0 < level < 1:
        raise InvalidInput(f"level: {level!r} is not a probability between 0 and 1")
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
    apart = np.abs(period - mean) ** 2 / (1 + 1 / K)
    scatter = (np.abs(later - mean[:, None]) ** 2).sum(axis=1) / (K - 1)
    # Channels differ in size and unit, lines in noise: sums over experiments only.
    ratio, numerator, denominator = _ratios(
        apart.sum(axis=(0, 3)), scatter.sum(axis=(0, 3)), int(found.present.sum()), K
    )
    centre = denominator / (denominator - 2)
    spread = stats.f(numerator, denominator).std()
    score = (ratio.mean() - centre) / (spread / np.sqrt(ratio.size))
    size = np.sum(np.abs(mean) ** 2, axis=(0, 1, 3))
    change = np.sum(np.abs(period - mean) ** 2, axis=(0, 1, 3))
    relative = float(np.sqrt(np.max(change / np.where(size > 0, size, 1.0))))
    return float(stats.norm.sf(score)), relative


def _ratios(apart: Array, scatter: Array, experiments: int, later: int) -> tuple[Array, int, int]:
    """Return F ratios (groups of lines, channels) and their degrees of freedom."""
    lines = len(apart)
    group = min(lines, int(np.ceil(_DEGREES / (2 * experiments * (later - 1)))))
    starts = np.arange(0, lines - group + 1, group)
    above, below = (np.add.reduceat(a[: starts[-1] + group], starts) for a in (apart, scatter))
    ratio = np.divide(above, below, out=np.ones_like(above), where=below > 0)
    # Without any scatter among the later periods a difference is beyond doubt.
    ratio = np.where((below == 0) & (above > 0), np.inf, ratio)
    degrees = 2 * experiments * group
    return ratio, degrees, max(degrees * (later - 1), 5)
