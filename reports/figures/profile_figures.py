"""Figures of profile likelihoods: how the data constrain one parameter, all others adapted."""

from collections.abc import Sequence
from statistics import NormalDist

import numpy as np

from estimators.sampling.profile_likelihood import Profile
from reports.figures.panels import Axis, Curve, Mark, Panel, Panels, Rule
from robotmodels.common.arrays import Array

_COLUMNS, _POINTS = 3, 121
_DOTTED = (1.0, 2.0)
_BELOW = "deviation from the estimate [%]"


def profiles(curves: Sequence[Profile], estimate: Array, std: Array) -> Panels:
    """Return the rise of -2 log p over each parameter, beside the parabola of a covariance.

    Parameters
    ----------
    curves : sequence of Profile, (k,)
        With their curves.
    estimate : ndarray, (k,)
        Estimates [SI], from which deviations are drawn in per cent.
    std : ndarray, (k,)
        Relative standard deviations, of the parabolas.
    """
    below = _BELOW if len(curves) < _COLUMNS else ""  # else once, in the middle
    panels: list[Panel | None] = [
        _panel(one, float(value), float(width), below, first=k % _COLUMNS == 0)
        for k, (one, value, width) in enumerate(zip(curves, estimate, std, strict=True))
    ]
    rows = -(-len(panels) // _COLUMNS)
    panels += [None] * (_COLUMNS * rows - len(panels))
    return Panels(
        (7.6, 0.5 + 1.9 * rows),
        [panels[k : k + _COLUMNS] for k in range(0, len(panels), _COLUMNS)],
        across="" if below else _BELOW,
        up="rise of −2 log p",
    )


def _panel(one: Profile, estimate: float, std: float, below: str, first: bool) -> Panel:
    """Return one profile, its interval and the parabola; numbers on the left in the first only."""
    rise = NormalDist().inv_cdf((1 + one.level) / 2) ** 2
    at, height, between, smooth = _smooth(one, estimate)
    ends = [100 * float(np.log(end / estimate)) for end in (one.lower, one.upper)]
    marks: list[Mark] = [
        Curve(between, smooth, "accent"),
        Curve(at, height, "accent", 0.0, 3.0),
        Curve(between, (between / (100 * std)) ** 2, "second", 1.4, dashes=(6.0, 6.0)),
        Rule(rise, "muted", 0.8, _DOTTED),
        *(Rule(end, "muted", 0.8, _DOTTED, upright=True) for end in ends if np.isfinite(end)),
    ]
    y = Axis(limits=(0.0, 3 * rise), numbered=first)
    return Panel(marks, Axis(below, count=5), y, title=one.name)


def _smooth(one: Profile, estimate: float) -> tuple[Array, Array, Array, Array]:
    """Return the points of a curve, (2, n), and the curve between them, (2, N), in per cent.

    The signed root of a rise is nearly linear, which makes it easy to interpolate.
    """
    values, rises = np.insert(one.curve, 0, [one.mode, 0.0], axis=1)
    at = 100 * np.log(values / estimate)
    order = np.argsort(at)
    order = order[np.isfinite(rises[order])]
    at, height = at[order], np.maximum(rises[order], 0.0)
    root = np.sign(at - 100 * np.log(one.mode / estimate)) * np.sqrt(height)
    between = np.linspace(at[0], at[-1], _POINTS)
    return at, height, between, np.interp(between, at, root) ** 2
