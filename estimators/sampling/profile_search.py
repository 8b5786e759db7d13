"""The search behind a profile likelihood: Newton's steps inside bounds, and where a curve rises."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.sampling.log_posterior import LogPosterior
from estimators.sampling.log_posterior_gradient import slope
from robotmodels.common.arrays import Array
from robotmodels.common.errors import IdentificationError

CROSSED, FLAT, AT_BOUND, FAILED = "found", "flat", "bound", "failed"

# Of -2 log p; the ends of an interval are then good to a thousandth of a standard deviation.
TOLERANCE, ROUNDING = 1e-6, 1e-13
# Of Newton's method, and of halvings of one of its steps.
STEPS, HALVINGS = 100, 30
# Of the search for an end, and by how much the distance grows at most from one to the next.
ROUNDS, GROWTH = 60, 3.0
# Of the root of the rise: intervals are good to a few thousandths of a standard deviation.
ROOT_TOLERANCE = 1e-4


@dataclass(frozen=True, eq=False)
class Point:
    """-2 log p at one point, in the units of a `Deviance`.

    Attributes
    ----------
    x, gradient : ndarray, (p,)
        x and gradient.
    hessian : ndarray, (p, p)
        Gauss-Newton Hessian.
    """

    x: Array
    value: float
    gradient: Array
    hessian: Array


@dataclass(frozen=True, eq=False)
class Deviance:
    """-2 log p, times a factor, of x = (ln theta - center) / unit.

    Attributes
    ----------
    density : LogPosterior
        Log posterior density log p.
    center, unit : ndarray, (p,)
        So that x is in standard deviations.
    factor : float
        Factor of -log p.
    """

    density: LogPosterior
    center: Array
    unit: Array
    factor: float

    @property
    def limits(self) -> Array:
        """Bounds of x, (2, p)."""
        return np.asarray((self.density.bounds - self.center) / self.unit)

    def __call__(self, x: Array) -> Point | None:
        """Return the value with its derivatives at `x` (p,); None where the model has no FRF."""
        try:
            there = slope(self.density, self.center + self.unit * x)
        except (IdentificationError, np.linalg.LinAlgError):
            return None
        value, gradient = self.factor * there.value, self.factor * self.unit * there.gradient
        if not (np.isfinite(value) and np.isfinite(gradient).all()):
            return None
        hessian = self.factor * np.outer(self.unit, self.unit) * there.hessian
        return Point(x, value, gradient, hessian)


def lowest(deviance: Deviance, start: Array, moving: NDArray[np.bool_]) -> Point | None:
    """Return the minimum over the parameters `moving` (p,), inside the limits; None if not reached.

    Projected Newton (Bertsekas 1982): parameters that a limit holds stay there while the gradient
    keeps them; a minimum at a limit is as good as any.
    """
    low, high = deviance.limits
    here = deviance(np.clip(start, low, high))
    for _ in range(STEPS):
        if here is None:
            return None
        step = _newton_step(here, low, high, moving)
        if -(here.gradient @ step) < TOLERANCE + ROUNDING * abs(here.value):
            return here
        here = _lower(deviance, here, step, low, high)
    return None


def moved(deviance: Deviance, here: Point, i: int, to: float) -> Point | None:
    """Return the minimum over all parameters but i, whose value is `to`, from a near one."""
    others = np.arange(len(here.x)) != i
    x = here.x + (to - here.x[i]) * _followed(here, deviance.limits, i)
    x[i] = to
    return lowest(deviance, x, others)


def end_of_interval(
    deviance: Deviance, mode: Point, i: int, side: int, rise: float
) -> tuple[float, str]:
    """Return where the profile of parameter i has risen by `rise`, and how the search ended.

    The root of the rise is nearly straight, so Newton's steps on it need few profile points; the
    slope of a profile is the gradient by its parameter.

    Parameters
    ----------
    side : {-1, 1}
        Below the mode or above it.
    """
    limit = float(deviance.limits[(1 + side) // 2, i])
    farthest = side * (limit - float(mode.x[i]))
    if farthest <= 0:
        return limit, AT_BOUND
    target = float(np.sqrt(rise))
    here, near, far = mode, 0.0, np.inf
    distance = min(target, farthest)
    for _ in range(ROUNDS):
        to = limit if distance == farthest else float(mode.x[i]) + side * distance
        there = moved(deviance, here, i, to)
        if there is None:
            far, distance = distance, (near + distance) / 2
            continue
        root = float(np.sqrt(max(there.value - mode.value, 0.0)))
        if abs(root - target) < ROOT_TOLERANCE:
            return to, CROSSED
        if root < target:
            if distance == farthest:
                return limit, FLAT
            here, near = there, distance
        else:
            far = distance
        distance = _next(near, far, distance, root, side * float(there.gradient[i]), target)
        distance = min(distance, farthest)
    return np.nan, FAILED


def _next(
    near: float, far: float, distance: float, root: float, gradient: float, target: float
) -> float:
    """Return the distance to try: Newton's on the root of the rise where it stays in between."""
    if gradient > 0 and root > 0:
        newton = distance + (target - root) * 2 * root / gradient
        if near < newton < min(far, GROWTH * distance):
            return float(newton)
    return GROWTH * distance if np.isinf(far) else (near + far) / 2


def _newton_step(here: Point, low: Array, high: Array, moving: NDArray[np.bool_]) -> Array:
    """Return the step (p,) of the parameters that are free to move, zero for the others."""
    x, gradient = here.x, here.gradient
    free = moving & ~((x <= low) & (gradient > 0) | (x >= high) & (gradient < 0))
    while True:
        step = np.zeros(len(x))
        rows = here.hessian[np.ix_(free, free)]
        step[free] = -np.linalg.lstsq(rows, gradient[free])[0]
        outward = (x <= low) & (step < 0) | (x >= high) & (step > 0)
        if not outward.any():
            return step
        free = free & ~outward


def _lower(deviance: Deviance, here: Point, step: Array, low: Array, high: Array) -> Point | None:
    """Return a lower point along a step that is cut at the limits; None if there is none."""
    for length in 0.5 ** np.arange(HALVINGS):
        there = deviance(np.clip(here.x + length * step, low, high))
        if there is not None:
            promised = float(here.gradient @ (here.x - there.x))
            if there.value <= here.value - 1e-4 * promised:
                return there
    return None


def _followed(here: Point, limits: Array, i: int) -> Array:
    """Return by how much (p,) the others' minimum moves with parameter i, to first order."""
    low, high = limits
    others = np.flatnonzero((np.arange(len(here.x)) != i) & (here.x > low) & (here.x < high))
    rows = here.hessian[np.ix_(others, others)]
    along = np.zeros(len(here.x))
    along[others] = -np.linalg.lstsq(rows, here.hessian[others, i])[0]
    return along
