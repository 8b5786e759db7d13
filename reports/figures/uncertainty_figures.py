"""Figures of how certain the parameters are: intervals, correlations, corner."""

from collections.abc import Sequence

import numpy as np
from matplotlib.ticker import FixedLocator

from reports.figures.panels import (
    SERIES,
    Area,
    Axis,
    Colour,
    Curve,
    Mark,
    Panel,
    Panels,
    Rule,
    bars,
    cells,
)
from robotmodels.common.arrays import Array

_SHADE, _LEAST_SHADE = 0.05, 0.02


def intervals(
    names: Sequence[str],
    offsets: Sequence[Array],
    stds: Sequence[Array],
    methods: Sequence[str],
    reference: str,
) -> Panels:
    """Return estimates in per cent of a reference, one standard deviation either way.

    Parameters
    ----------
    offsets, stds : sequence of ndarray
        Of ln theta, (p,) by each of the `methods`; the reference lies at zero.
    """
    groups = parameter_groups(names)
    shifts = 0.16 * (2 * np.arange(len(methods)) - len(methods) + 1)
    if len(methods) > 2:
        shifts *= 1.6 / len(methods)
    row = []
    for title, group in groups.items():
        marks: list[Mark] = [Rule(0.0, "muted", upright=True)]
        for k, (shift, offset, std) in enumerate(zip(shifts, offsets, stds, strict=True)):
            colour, y = SERIES[k % len(SERIES)], np.arange(len(group)) + shift
            x, half = 100 * offset[group], 100 * std[group]
            marks.append(Curve(*bars(y, x - half, x + half)[::-1], colour, 1.6))
            marks.append(Curve(x, y, colour, 0.0, 3.4))
        x_axis = Axis(f"estimate against {reference} [%]", count=5)
        row.append(Panel(marks, x_axis, _rows(names, group, _longest(groups)), title))
    size = (8.2, 0.95 + (0.2 + 0.08 * max(len(methods) - 2, 0)) * _longest(groups))
    return Panels(size, [row], legend=_legend(methods))


def deviations(
    names: Sequence[str],
    stds: Sequence[Array],
    studies: Sequence[str],
    ends: Sequence[Array | None] | None = None,
) -> Panels:
    """Return relative standard deviations on a logarithmic axis.

    Parameters
    ----------
    stds : sequence of ndarray
        (p,) of each study, or (k, p) of several that share a name.
    ends : sequence of ndarray, (p, 2), optional
        Ends between which the true ones of a study lie, drawn as a bar; None for no bar.
    """
    groups = parameter_groups(names)
    between = [None] * len(stds) if ends is None else ends
    # Bars lie beside each other.
    shifts = np.linspace(-0.22, 0.22, len(stds)) if ends else np.zeros(len(stds))
    row = []
    for title, group in groups.items():
        marks = []
        # The first study last, on top of the others.
        for k in reversed(range(len(stds))):
            colour, bar = SERIES[k % len(SERIES)], between[k]
            x = 100 * np.atleast_2d(stds[k])[:, group]
            y = np.arange(len(group)) + shifts[k]
            marks.append(
                Curve(x.ravel(), np.tile(y, len(x)), colour, 0.0, 4 if len(x) == 1 else 2.5)
            )
            if bar is not None:
                marks.append(Curve(*bars(y, *100 * bar[group].T)[::-1], colour))
        x_axis = Axis("relative standard deviation [%]", log=True, count=5)
        row.append(Panel(marks, x_axis, _rows(names, group, _longest(groups), grid=True), title))
    return Panels((8.2, 0.95 + 0.2 * _longest(groups)), [row], legend=_legend(studies))


def _longest(groups: dict[str, list[int]]) -> int:
    return max(len(group) for group in groups.values())


def _rows(names: Sequence[str], group: list[int], longest: int, grid: bool = False) -> Axis:
    """Return an axis with a row for each parameter of a group."""
    words = {float(row): names[i].rsplit(".", 1)[0] for row, i in enumerate(group)}
    return Axis(limits=(longest - 0.4, -0.6), names=words, grid=grid, line=False)


def _legend(names: Sequence[str]) -> list[tuple[str, Colour]]:
    return [(name, SERIES[k % len(SERIES)]) for k, name in enumerate(names)]


def correlation_map(names: Sequence[str], correlation: Array) -> Panels:
    """Return the correlations (p, p) as a map: one colour for each sign, strength as opacity."""
    p = len(names)
    edges, ends = np.arange(p + 1.0) - 0.5, (-0.5, p - 0.5)

    labels = {float(i): name for i, name in enumerate(names)}
    shades = _shades(edges, edges, correlation)
    x, y = (
        Axis("", ends, names=labels, rotation=90.0, grid=False),
        Axis("", ends[::-1], names=labels, grid=False),
    )
    levels = np.arange(-1, 1 + _SHADE / 2, _SHADE)
    middles = (levels[1:] + levels[:-1])[:, None] / 2
    scale = Axis(
        "correlation", (-1.0, 1.0), locator=FixedLocator([-1, -0.5, 0, 0.5, 1]), grid=False
    )
    key = _shades(np.array([0.0, 1.0]), levels, middles)
    side, words = max(0.19 * p, 1.6), 0.09 + 0.063 * max(len(name) for name in names)
    row = [
        Panel(shades, x, y, square=True, boxed=True),
        Panel(key, Axis(limits=(0.0, 1.0), names={}, grid=False), scale, boxed=True),
    ]
    return Panels((side + words + 0.9, side + words + 0.2), [row], widths=(side, 0.16))


def _shades(x: Array, y: Array, values: Array) -> list[Area]:
    """Return cells between edges, coloured by the sign and strength of `values`, (R, C)."""
    steps = np.rint(values / _SHADE).astype(int)
    steps = np.where(np.abs(values) < _LEAST_SHADE, 0, np.where(steps == 0, np.sign(values), steps))
    return [
        Area(
            *cells(x, y, steps == step),
            "second" if step > 0 else "accent",
            round(min(abs(int(step)) * _SHADE, 1.0), 2),
        )
        for step in np.unique(steps[steps != 0])
    ]


def parameter_groups(names: Sequence[str]) -> dict[str, list[int]]:
    """Return the indices of springs, dampers and others, each under its name for people."""
    groups: dict[str, list[int]] = {}
    for i, name in enumerate(names):
        kind = name.rsplit(".", 1)[-1]
        groups.setdefault(
            {"stiffness": "Springs", "damping": "Dampers"}.get(kind, "Others"), []
        ).append(i)
    return groups
