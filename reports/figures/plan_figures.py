"""Figures of plans: what more visits bring."""

from collections.abc import Sequence

import numpy as np

from reports.figures.panels import Axis, Curve, Panel, Panels
from robotmodels.common.arrays import Array, IntArray


def trade_off(
    cost: Array | IntArray,
    std: Array,
    names: Sequence[str],
    *,
    bound: Array | None = None,
    label: str = "visits",
) -> Panels:
    """Return the largest and the median standard deviation over the robot's time or visits.

    Parameters
    ----------
    cost : ndarray, (C,)
        Visits or minutes of each plan.
    std : ndarray, (C, p)
        Relative standard deviations of the parameters `names`; infinite ones leave a gap.
    bound : ndarray, (C,), optional
        Certified efficiency of each plan, written below the curve.
    label : str
        What `cost` is.
    """
    x = Axis(label, integer=label == "visits", count=10)
    above = Axis(integer=x.integer, count=10, numbered=False)
    worst = int(np.argmax(np.where(np.isfinite(std[-1]), std[-1], -np.inf)))
    marks = _accuracy(cost, np.where(np.isfinite(std), 100 * std, np.nan))
    rows = [[Panel(marks, x if bound is None else above, Axis("std [%]", log=True))]]
    if bound is not None:
        shares = Curve(cost, 100 * bound, "accent", 1.3, 3.0)
        lowest = 98.0 if bound.min() > 0.99 else None
        rows.append([Panel([shares], x, Axis("efficiency [%]", (lowest, 101.0), count=3))])
    return Panels(
        (7.0, 2.9 if bound is None else 3.6),
        rows,
        heights=[1] if bound is None else [2, 1],
        legend=[(f"largest, at last {names[worst]}", "accent"), ("median", "second")],
    )


def _accuracy(cost: Array | IntArray, shown: Array) -> list[Curve]:
    """Return every parameter's standard deviation, (C, p), their largest and their median."""
    return [
        *(Curve(cost, one, "rule", 0.6) for one in shown.T),
        Curve(cost, shown.max(axis=1), "accent", 1.3, 3.0),
        Curve(cost, np.median(shown, axis=1), "second", 1.3, 3.0),
    ]
