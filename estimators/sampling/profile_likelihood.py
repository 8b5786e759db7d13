"""Profile likelihoods: how far one parameter can move if all others make up for it."""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from statistics import NormalDist

import numpy as np

from estimators.fitting.fitted_model import FittedModel
from estimators.fitting.priors import Prior
from estimators.sampling.log_posterior import LogPosterior, posterior_density
from estimators.sampling.profile_search import (
    AT_BOUND,
    CROSSED,
    FAILED,
    FLAT,
    Deviance,
    Point,
    end_of_interval,
    lowest,
    moved,
)
from estimators.sampling.student_t_proposal import laplace, student_t
from robotmodels.common.arrays import Array, check_level, read_only
from robotmodels.common.printing import ReprHtml
from robotmodels.common.progress import Progress, tell


@dataclass(frozen=True, eq=False)
class Profile(ReprHtml):
    """The profile likelihood interval of one parameter.

    Attributes
    ----------
    name : str
        Name of the parameter.
    mode : float
        Where the likelihood is largest [SI].
    lower, upper : float
        Ends of the interval [SI]; a bound of the fit where the profile is flat, or where the mode
        is at it and the interval one-sided; not a number where the search failed.
    sides : tuple of (str, str)
        "found", "flat", "bound" or "failed" for either end.
    level : float
        Level of the interval.
    curve : ndarray, (2, points)
        Values [SI] and rise of -2 log p, in units of the adjusted chi square; none if not asked
        for.
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
        above, below = np.log(self.upper / self.mode), np.log(self.mode / self.lower)
        return float(above / below) if below else np.inf

    @property
    def std(self) -> float:
        """Standard deviation of ln theta of the normal with as wide an interval."""
        from scipy.special import ndtri

        return float(np.log(self.upper / self.lower) / (2 * ndtri((1 + self.level) / 2)))

    def __str__(self) -> str:
        notes = {
            CROSSED: "",
            FLAT: " (flat up to the bound)",
            AT_BOUND: " (the mode is at this bound)",
            FAILED: " (search failed)",
        }
        return (
            f"{self.name}: {self.mode:.6g}, {100 * self.level:g} % from {self.lower:.6g}"
            f"{notes[self.sides[0]]} to {self.upper:.6g}{notes[self.sides[1]]}, "
            f"asymmetry {self.asymmetry:.3g}"
        )


def profile_likelihood(
    fit: FittedModel,
    names: Sequence[str] | None = None,
    *,
    level: float = 0.95,
    noise: str = "known",
    scale: float | None = None,
    prior: Prior | None = None,
    points: int = 0,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> tuple[Profile, ...]:
    """Return profile likelihood intervals, inside the fit's bounds.

    A parameter whose mode is at a bound has a one-sided interval, which ends there.

    For weights that are not inverse covariances -2 log p does not rise like a chi square. Where
    the noise is known each parameter's rise is then divided by its own factor, the ratio of
    Theorem 1's variance to that of the inverse Hessian, so that the interval tends to Theorem 1's
    as data increase (Kent 1982).

    Parameters
    ----------
    names : sequence of str, optional
        Parameters to profile; all where None.
    level : float
        Level of the intervals.
    noise : str
        As in `sample_posterior`.
    prior : Prior, optional
        As in `sample_posterior`.
    scale : float, optional
        One factor for all parameters instead of one for each.
    points : int
        Points of the curve between twice the distance of either end; none by default.
    executor : Executor, optional
        Takes one parameter at a time; in sequence where None.
    progress : Progress, optional
        Called with the parameters done and their number.

    Raises
    ------
    InvalidInput
        For an unknown parameter, a level outside (0, 1), or as `sample_posterior`.
    SolverFailed
        If the fit's cost is not finite.
    """
    check_level(level, "profile")
    selected = fit.parameters.names if names is None else tuple(names)
    columns = [fit.parameters.index(name) for name in selected]
    fixed_scale = noise == "known" and scale is None
    if fixed_scale:
        scale = _mean_scale(fit)
    density = posterior_density(fit, noise=noise, scale=scale, prior=prior)
    factors = adjustments(fit, density.noise.scale) if fixed_scale else np.ones(len(fit.parameters))
    start = laplace(fit, density)
    unit = np.sqrt(np.sum(start.root**2, axis=1))
    one = partial(_profile, density, start.center, unit, level, points)
    tasks = [(i, float(factors[i])) for i in columns]
    profiles = []
    for profile in map(one, tasks) if executor is None else executor.map(one, tasks):
        profiles.append(profile)
        tell(progress, len(profiles), len(tasks))
    return tuple(profiles)


def _mean_scale(fit: FittedModel) -> float:
    """Return the factor of V that makes exp(-V) as wide as Theorem 1 on average."""
    bread, meat = fit.sandwich_parts()
    # Directions without information have neither bread nor meat.
    return len(bread) / float(np.trace(np.linalg.lstsq(bread, meat)[0]))


def adjustments(fit: FittedModel, scale: float) -> Array:
    """Return Theorem 1's variances over those of exp(-scale V), (p,); one where singular."""
    bread, meat = (scale * part for part in fit.sandwich_parts())
    root = student_t(np.zeros(len(bread)), bread).root
    inverse = root @ root.T
    ratio = scale * np.diag(inverse @ meat @ inverse) / np.diag(inverse)
    seen = np.diag(bread) > 1e-12 * np.diag(bread).max()
    return np.asarray(np.where(seen & (ratio > 0), ratio, 1.0))


def _profile(
    density: LogPosterior,
    center: Array,
    unit: Array,
    level: float,
    points: int,
    task: tuple[int, float],
) -> Profile:
    i, adjustment = task
    deviance = Deviance(density, center, unit * np.sqrt(adjustment), 2 / adjustment)
    mode = lowest(deviance, np.zeros(len(center)), np.ones(len(center), dtype=bool))
    rise = NormalDist().inv_cdf((1 + level) / 2) ** 2
    x, ends = 0.0, [(np.nan, FAILED)] * 2
    if mode is not None:
        x = float(mode.x[i])
        ends = [end_of_interval(deviance, mode, i, side, rise) for side in (-1, 1)]
    curve = np.empty((2, 0))
    if mode is not None and points:
        curve = _curve(deviance, mode, i, ends, points)
    values = np.exp(center[i] + deviance.unit[i] * np.array([x, *(end for end, _ in ends)]))
    curve[0] = np.exp(center[i] + deviance.unit[i] * curve[0])
    return Profile(
        name=density.names[i],
        mode=float(values[0]),
        lower=float(values[1]),
        upper=float(values[2]),
        sides=(ends[0][1], ends[1][1]),
        level=level,
        curve=read_only(curve),
    )


def _curve(
    deviance: Deviance, mode: Point, i: int, ends: list[tuple[float, str]], points: int
) -> Array:
    """Return (2, points) values and the rise of -2 log p over the minimum, adjusted."""
    at = mode.x[i]
    low, high = (at + 2 * (end - at) if status == CROSSED else end for end, status in ends)
    low, high = np.nan_to_num(np.clip([low, high], *deviance.limits[:, i]), nan=at)
    grid = np.linspace(low, high, points)
    rises = np.full(points, np.nan)
    for side in (grid < at, grid >= at):
        here: Point | None = mode
        for k in sorted(np.flatnonzero(side), key=lambda k: abs(grid[k] - at)):
            here = moved(deviance, mode if here is None else here, i, grid[k])
            rises[k] = np.nan if here is None else here.value - mode.value
    return np.stack([grid, rises])
