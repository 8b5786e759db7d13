"""Stick figures: the robot in a position, seen from one side above the floor."""

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from reports.svg import Palette
from robotmodels.arrays import Array

_AZIMUTH, _ELEVATION = np.radians(-55.0), np.radians(18.0)


def projected(points: Array) -> Array:
    """Return points (k, 3) as seen by the camera, (k, 2): right and up, no perspective."""
    right = np.array([-np.sin(_AZIMUTH), np.cos(_AZIMUTH), 0.0])
    toward = np.array(
        [
            np.cos(_ELEVATION) * np.cos(_AZIMUTH),
            np.cos(_ELEVATION) * np.sin(_AZIMUTH),
            np.sin(_ELEVATION),
        ]
    )
    return np.asarray(points @ np.stack([right, np.cross(toward, right)], axis=1))


def frame_of(skeletons: list[Array]) -> tuple[Array, Array, float]:
    """Return what all pictures share: lower and upper corner, and the floor's radius [m]."""
    everything = np.concatenate(skeletons)
    radius = 1.05 * max(np.linalg.norm(everything[:, :2], axis=1).max(), 1e-3)
    seen = np.concatenate([projected(everything), projected(_circle(radius))])
    margin = 0.04 * np.ptp(seen, axis=0).max()
    return seen.min(axis=0) - margin, seen.max(axis=0) + margin, radius


def stick_figure(skeleton: Array, frame: tuple[Array, Array, float]) -> Callable[[Palette], Figure]:
    """Return a drawing of one position: floor, shadow, links from base to tool."""
    low, high, radius = frame

    def draw(palette: Palette) -> Figure:
        width = 2.2
        figure = Figure(figsize=(width, width * (high[1] - low[1]) / (high[0] - low[0])))
        axes = figure.add_axes((0, 0, 1, 1))
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        axes.set_axis_off()
        for part in (1.0, 0.5):
            axes.plot(*projected(_circle(part * radius)).T, color=palette.rule, lw=0.8)
        for cross in ([[-1, 0, 0], [1, 0, 0]], [[0, -1, 0], [0, 1, 0]]):
            axes.plot(
                *projected(radius * np.array(cross, dtype=float)).T, color=palette.rule, lw=0.6
            )
        shadow = projected(skeleton * [1.0, 1.0, 0.0])
        round_ends: dict[str, Any] = {"solid_capstyle": "round", "solid_joinstyle": "round"}
        axes.plot(*shadow.T, color=palette.muted, lw=3, alpha=0.22, **round_ends)
        seen = projected(skeleton)
        axes.plot(*seen.T, color=palette.ink, lw=3, **round_ends)
        axes.plot(*seen[1:-1].T, "o", color=palette.ink, ms=4.6)
        axes.plot(*seen[1:-1].T, "o", color=palette.rule, ms=1.8)
        axes.plot(*seen[-1:].T, "o", color=palette.second, ms=5)
        return figure

    return draw


def _circle(radius: float) -> Array:
    angle = np.linspace(0, 2 * np.pi, 49)
    return radius * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
