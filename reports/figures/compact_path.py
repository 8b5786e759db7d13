"""Curves as short SVG path data: whole units, simplified, steps from point to point."""

from collections.abc import Iterable

import numpy as np
from matplotlib.path import Path

from robotmodels.common.arrays import Array

_TOLERANCE, _OF_BAND = 1.0, 3.0  # distance of a left-out point from its line [units]


def line(x: Array, y: Array, width: float, height: float) -> Path:
    """Return a curve cut at the frame from (0, 0) to (width, height), with gaps at NaN.

    Points closer than a unit to the line through the others are left out, those between two gaps
    are dots.
    """
    points = np.column_stack([x, y])
    curve = _simplified(points, (0.0, 0.0, width, height), _TOLERANCE)
    gap = np.concatenate([[True], np.isnan(y), [True]])
    lone = gap[:-2] & ~gap[1:-1] & gap[2:] & (y >= 0) & (y <= height)
    dots = Path(points[lone], np.full(np.count_nonzero(lone), Path.MOVETO))
    return Path.make_compound_path(curve, dots) if lone.any() else curve


def band(x: Array, low: Array, high: Array, height: float) -> Path:
    """Return the area between two curves without gaps, which are bent along the frame."""
    ends = [np.column_stack([x, np.clip(y, 0.0, height)]) for y in (high, low)]
    upper, lower = (_simplified(points, None, _OF_BAND).vertices for points in ends)
    return Path(np.concatenate([upper, np.asarray(lower)[::-1]]))


def data(paths: Iterable[Path], corners: Array) -> str:
    """Return path data of curves, each moved to its corner (N, 2)."""
    words = []
    for path, corner in zip(paths, corners, strict=True):
        points = np.rint(path.vertices + corner).astype(np.int64)
        starts = [0] if path.codes is None else np.flatnonzero(path.codes == Path.MOVETO)
        for run in np.split(points, starts)[1:]:
            x, y = run[0].tolist()
            steps = np.diff(run, axis=0)
            numbers = ("%+d%+d" * len(steps)) % tuple(steps.ravel().tolist())
            words.append(f"M{x} {y}" + (f"l{numbers}" if numbers else "h0"))  # a dot
    return "".join(words)


def polygons(x: Array, y: Array) -> str:
    """Return path data of closed polygons with corners (N,), parted by NaN."""
    points = np.column_stack([x, y])
    words = []
    for part in np.split(points, np.flatnonzero(np.isnan(points).any(axis=1))):
        corners = np.rint(part[~np.isnan(part).any(axis=1)]).astype(np.int64)
        if len(corners):
            numbers = ("%+d%+d" * (len(corners) - 1)) % tuple(np.diff(corners, axis=0).ravel())
            words.append(f"M{corners[0, 0]} {corners[0, 1]}l{numbers}z")
    return "".join(words)


def _simplified(
    points: Array, frame: tuple[float, float, float, float] | None, tolerance: float
) -> Path:
    path = Path(points)
    path.simplify_threshold = tolerance
    cleaned = path.cleaned(remove_nans=True, clip=frame, simplify=True)
    codes = np.append(np.asarray(cleaned.codes), Path.STOP)
    drawn = (codes[:-1] == Path.LINETO) | (codes[1:] == Path.LINETO)
    return Path(np.asarray(cleaned.vertices)[drawn], np.asarray(cleaned.codes)[drawn])
