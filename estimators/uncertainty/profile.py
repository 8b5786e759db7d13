"""Profile likelihoods: how far one parameter can move if all others make up for it."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from estimators.fitting.least_squares import Fit
from estimators.fitting.priors import Prior
from estimators.levels import check_level
from estimators.uncertainty.laplace import laplace, student_t
from estimators.uncertainty.log_posterior import LogPosterior, posterior_density
from estimators.uncertainty.log_posterior_slope import Slope, slope
from estimators.uncertainty.theorem_1 import sandwich_parts
from robotmodels.arrays import Array, read_only
from robotmodels.errors import IdentificationError
from robotmodels.notebook import Printed

if TYPE_CHECKING:
    from iminuit import Minuit

FOUND, FLAT, FAILED = "found", "flat", "failed"
# What counts as infinitely bad where the model has no FRF; Minuit cannot do with infinity.
NO_FRF = 1e12


@dataclass(frozen=True, eq=False)
class Profile(Printed):
    """The profile likelihood interval of one parameter.

    Attributes
    ----------
    name : of the parameter.
    mode : where the likelihood is largest [SI].
    lower, upper : ends of the interval [SI]; a bound of the fit where the profile is flat, not a
        number where the search failed.
    sides : "found", "flat" or "failed" for either end.
    level : of the interval.
    curve : (2, points) values [SI] and rise of -2 log p, in units of the adjusted chi square; none
        if not asked for.
    """

    name: str
    mode: float
    lower: float
    upper: float
    sides: tuple[str, str]
    level: float
    curve: Array

    @property
    def flat(self) -> bool:
        """Whether the data do not bound the parameter on at least one side."""
        return FLAT in self.sides

    @property
    def asymmetry(self) -> float:
        """Distance of the upper end over that of the lower, in ln theta; one if symmetric."""
        return float(np.log(self.upper / self.mode) / np.log(self.mode / self.lower))

    @property
    def std(self) -> float:
        """Standard deviation of ln theta of the normal with as wide an interval."""
        from scipy.special import ndtri

        return float(np.log(self.upper / self.lower) / (2 * ndtri((1 + self.level) / 2)))

    def __str__(self) -> str:
        notes = {FOUND: "", FLAT: " (flat up to the bound)", FAILED: " (search failed)"}
        return (
            f"{self.name}: {self.mode:.6g}, {100 * self.level:g} % from {self.lower:.6g}"
            f"{notes[self.sides[0]]} to {self.upper:.6g}{notes[self.sides[1]]}, "
            f"asymmetry {self.asymmetry:.3g}"
        )


def profile_likelihood(
    fit: Fit,
    names: Sequence[str] | None = None,
    *,
    level: float = 0.95,
    noise: str = "known",
    scale: float | None = None,
    blocks: int | None = None,
    prior: Prior | None = None,
    points: int = 0,
    executor: Executor | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> tuple[Profile, ...]:
    """Return profile likelihood intervals by Minuit's MINOS.

    For weights that are not inverse covariances -2 log p does not rise like a chi square. Where
    the noise is known each parameter's rise is then divided by its own factor, the ratio of
    Theorem 1's variance to that of the inverse Hessian, so that the interval tends to Theorem 1's
    as data increase (Kent 1982).

    Parameters
    ----------
    names : parameters to profile; all where None.
    level : of the intervals.
    noise, blocks, prior : as in `sample_posterior`.
    scale : one factor for all parameters instead of their own.
    points : of the curve between twice the distance of either end; none by default.
    executor : takes one parameter at a time; in sequence where None.
    progress : called with the parameters done and their number.

    Raises
    ------
    InvalidInput : for an unknown parameter, a level outside (0, 1), or as `sample_posterior`.
    SolverFailed : if the fit's cost is not finite.
    """
    check_level(level, "profile")
    chosen = fit.parameters.names if names is None else tuple(names)
    columns = [fit.parameters.index(name) for name in chosen]
    known = noise == "known" and scale is None
    density = posterior_density(fit, noise=noise, scale=scale, blocks=blocks, prior=prior)
    factors = adjustments(fit, density.noise.scale) if known else np.ones(len(fit.parameters))
    start = laplace(fit, density)
    unit = np.sqrt(np.sum(start.root**2, axis=1))
    one = partial(_profile, density, start.center, unit, level, points)
    tasks = [(i, float(factors[i])) for i in columns]
    found = []
    for profile in map(one, tasks) if executor is None else executor.map(one, tasks):
        found.append(profile)
        if progress is not None:
            progress(len(found), len(tasks))
    return tuple(found)


def adjustments(fit: Fit, scale: float) -> Array:
    """Return Theorem 1's variances over those of exp(-scale V), (p,); one where singular."""
    bread, meat = (scale * part for part in sandwich_parts(fit))
    root = student_t(np.zeros(len(bread)), bread).root
    inverse = root @ root.T
    ratio = scale * np.diag(inverse @ meat @ inverse) / np.diag(inverse)
    seen = np.diag(bread) > 1e-12 * np.diag(bread).max()
    return np.asarray(np.where(seen & (ratio > 0), ratio, 1.0))


class _Function:
    """-2 log p over the adjustment for Minuit, in units of the standard deviations."""

    def __init__(
        self, density: LogPosterior, center: Array, unit: Array, adjustment: float
    ) -> None:
        self.density, self.center, self.unit = density, center, unit
        self.factor = 2 / adjustment
        self._x: Array | None = None
        self._last: Slope | None = None

    def at(self, x: Array) -> Slope | None:
        if self._x is None or not np.array_equal(x, self._x):
            self._x = np.array(x)
            try:
                self._last = slope(self.density, self.center + self.unit * self._x)
            except (IdentificationError, np.linalg.LinAlgError):
                self._last = None
        return self._last

    def value(self, x: Array) -> float:
        found = self.at(x)
        return NO_FRF if found is None else self.factor * found.value

    def gradient(self, x: Array) -> Array:
        found = self.at(x)
        return np.zeros(len(x)) if found is None else self.factor * self.unit * found.gradient

    def hessian(self, x: Array) -> Array:
        found = self.at(x)
        size = self.factor * np.outer(self.unit, self.unit)
        return np.eye(len(x)) if found is None else size * found.hessian


def _minuit(function: _Function, limits: Array) -> "Minuit":
    """Return Minuit at the minimum."""
    from iminuit import Minuit

    p = len(function.center)
    search = Minuit(
        function.value,
        np.zeros(p),
        grad=function.gradient,
        hessian=function.hessian,
        name=function.density.names,
    )
    search.limits = limits.T
    search.errors = np.ones(p)
    search.errordef = 1.0
    search.strategy = 1
    search.migrad(ncall=100 * p)
    return search


def _profile(
    density: LogPosterior,
    center: Array,
    unit: Array,
    level: float,
    points: int,
    task: tuple[int, float],
) -> Profile:
    i, adjustment = task
    unit = unit * np.sqrt(adjustment)
    function = _Function(density, center, unit, adjustment)
    search = _minuit(function, (density.bounds - center) / unit)
    name = density.names[i]
    search.minos(name, cl=level)
    error = search.merrors[name]
    mode = search.values[i]
    ends = [
        _end(error, "lower", mode, search.limits[i][0]),
        _end(error, "upper", mode, search.limits[i][1]),
    ]
    values = np.exp(center[i] + unit[i] * np.array([mode, *(end for end, _ in ends)]))
    curve = _curve(search, i, mode, ends, points)
    curve[0] = np.exp(center[i] + unit[i] * curve[0])
    return Profile(
        name=name,
        mode=float(values[0]),
        lower=float(values[1]),
        upper=float(values[2]),
        sides=(ends[0][1], ends[1][1]),
        level=level,
        curve=read_only(curve),
    )


def _end(error: Any, side: str, mode: float, limit: float) -> tuple[float, str]:
    """Return one end, in units of the search, and how it was found."""
    if getattr(error, f"at_{side}_limit"):
        return float(limit), FLAT
    if not getattr(error, f"{side}_valid"):
        return float("nan"), FAILED
    return float(mode + getattr(error, side)), FOUND


def _curve(
    search: "Minuit",
    i: int,
    mode: float,
    ends: list[tuple[float, str]],
    points: int,
) -> Array:
    """Return (2, points) places and the rise of -2 log p over the minimum, adjusted."""
    if not points:
        return np.empty((2, 0))
    low, high = (mode + 2 * (end - mode) if found == FOUND else end for end, found in ends)
    low, high = np.clip([low, high], *search.limits[i])
    low, high = np.nan_to_num([low, high], nan=mode)
    minimum = float(search.fval)
    grid = np.linspace(low, high, points)
    places, values, _ = search.mnprofile(i, grid=grid)
    return np.stack([places, values - minimum])
