"""Stick figures: the robot in a position, as SVG that the page's script turns.

What is drawn here is what ``robots.js`` draws anew from another side; the two share `data-robot`.
"""

import json
from dataclasses import dataclass
from html import escape

import numpy as np
from markupsafe import Markup

from robotmodels.common.arrays import Array
from robotmodels.elastic.mode_pictures import ModeMovements

AZIMUTH, ELEVATION = -55, 18  # of the camera [deg]
_WIDTH = 160  # of a picture [px]
_MARGIN = 0.04
_TALLEST = 1.25  # height of a picture over its width, also of an upright arm
_DECIMALS = 3  # of what is drawn [m]

# In the order of drawing: what, colour, width of the line [px], opacity.
_PARTS = (
    ("floor", "rule", 0.8, 1.0),
    ("shadow", "muted", 3.0, 0.25),
    ("links", "ink", 3.2, 1.0),
    ("joints", "ink", 5.4, 1.0),
    ("pins", "rule", 2.0, 1.0),
    ("tool", "second", 6.0, 1.0),
)

_MARKS = ("marks", "second", 4.5, 0.85)
_LETTERS = 6  # height of the marks' numbers [px]
_OUTLINED = (
    'font-weight="600" fill="var(--ink)" stroke="var(--paper)" stroke-width=".3em" '
    'paint-order="stroke" stroke-linejoin="round"'
)


@dataclass(frozen=True)
class Scene:
    """What all pictures share: the floor's radius [m] and the edges of what is seen."""

    radius: float
    x_min: float
    y_min: float
    width: float
    height: float


def seen(points: Array) -> Array:
    """Return points (..., 3) as the camera sees them, (..., 2): right and down, no perspective."""
    (sa, ca), (se, ce) = ((np.sin(a), np.cos(a)) for a in np.radians([AZIMUTH, ELEVATION]))
    x, y, z = np.moveaxis(points, -1, 0)
    return np.stack([y * ca - x * sa, se * (x * ca + y * sa) - ce * z], axis=-1)


def scene_of(skeletons: list[Array]) -> Scene:
    """Return the scene in which every skeleton (k, 3) fits."""
    everything = _rounded(np.concatenate(skeletons))
    reach = float(np.linalg.norm(everything[:, :2], axis=1).max())
    radius = round(1.05 * max(reach, 0.01), _DECIMALS)
    drawn = np.concatenate([seen(everything), *map(seen, _floor(radius))])
    low, high = drawn.min(axis=0), drawn.max(axis=0)
    margin = _MARGIN * float((high - low).max())
    (x_min, y_min), (width, height) = low - margin, high - low + 2 * margin
    wider = max(float(height) / _TALLEST, float(width))
    return Scene(radius, float(x_min - (wider - width) / 2), float(y_min), wider, float(height))


def stick_figure(
    skeleton: Array,
    scene: Scene,
    alt: str,
    marks: Array | None = None,
    modes: ModeMovements | None = None,
    placements: Array | None = None,
) -> Markup:
    """Return the picture of one position: floor, shadow, links from base to tool.

    Parameters
    ----------
    skeleton : ndarray, (k, 3), m
        Joint origins, from base to tool.
    alt : str
        Says what is to be seen.
    marks : ndarray, (r, 3), m, optional
        Points to number, drawn as large dots.
    modes : ModeMovements, optional
        What can move the picture.
    placements : ndarray, (joints, 4, 4), optional
        Of the joints, with which the page's script draws the links' surfaces.
    """
    skeleton, marked = _rounded(skeleton), _rounded(np.zeros((0, 3)) if marks is None else marks)
    shadow, joints = skeleton * [1.0, 1.0, 0.0], skeleton[1:-1]
    lines = {
        "floor": "".join(_line(part) for part in _floor(scene.radius)),
        "shadow": _line(shadow),
        "links": _line(skeleton),
        "joints": _dots(joints),
        "pins": _dots(joints),
        "tool": _dots(skeleton[-1:]),
        "marks": _dots(marked),
    }
    box = " ".join(f"{v:.3f}" for v in (scene.x_min, scene.y_min, scene.width, scene.height))
    scale = scene.width / _WIDTH
    paths = "".join(
        f'<path class="{name}" d="{lines[name]}" fill="none" stroke="var(--{colour})" '
        f'stroke-width="{scale * width:.4f}" stroke-linecap="round" stroke-linejoin="round"'
        + (f' opacity="{opacity}"/>' if opacity < 1 else "/>")
        for name, colour, width, opacity in (_PARTS if marks is None else (*_PARTS[:-1], _MARKS))
    )
    numbers = "".join(
        f'<text x="{x:.3f}" y="{y:.3f}" dx=".5em" font-size="{scale * _LETTERS:.4f}" {_OUTLINED}>'
        f"{label}</text>"
        for label, (x, y) in zip(_labels(seen(marked), scale * _LETTERS), seen(marked), strict=True)
    )
    data = {"robot": skeleton.tolist(), "marks": marked.tolist()}
    if modes is not None:
        data["modes"] = _mode_data(modes)
    if placements is not None:
        data["joints"] = _rounded(placements[:, :3]).tolist()
    words = " ".join(
        f'data-{name}="{json.dumps(value, separators=(",", ":"))}"' for name, value in data.items()
    )
    return Markup(
        f'<svg viewBox="{box}" role="img" aria-label="{escape(alt)}" {words} '
        f'data-radius="{scene.radius}" data-view="[{AZIMUTH},{ELEVATION}]">{paths}{numbers}</svg>'
    )


def _mode_data(modes: ModeMovements) -> list[list[object]]:
    """Return frequency [Hz], movements of the skeleton and twists of the joints of each mode."""
    hertz = (modes.frequencies / (2 * np.pi)).round(2).tolist()
    moved = _rounded(modes.movements).tolist(), _rounded(modes.twists).tolist()
    return [list(one) for one in zip(hertz, *moved, strict=True)]


def _labels(spots: Array, near: float) -> list[str]:
    """Return the numbers of spots (r, 2), those near an earlier one with the numbers of that."""
    leaders = list[int]()
    for i, spot in enumerate(spots):
        away = np.linalg.norm(spots[:i] - spot, axis=1)
        leaders.append(next((leaders[k] for k in np.flatnonzero(away < near)), i))
    numbers = [[str(k + 1) for k, one in enumerate(leaders) if one == i] for i in range(len(spots))]
    return [", ".join(one) for one in numbers]


def _floor(radius: float) -> list[Array]:
    """Return the lines of the floor: two circles and a cross."""
    angle = np.linspace(0, 2 * np.pi, 49)
    circle = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    return [circle, circle / 2, circle[[0, 24]], circle[[12, 36]]]


def _rounded(points: Array) -> Array:
    """Return what the script gets, so that it draws the same picture."""
    return np.asarray(np.round(points, _DECIMALS)) + 0.0


def _line(points: Array) -> str:
    return "M" + "L".join(f"{x:.3f} {y:.3f}" for x, y in seen(points))


def _dots(points: Array) -> str:
    return "".join(f"M{x:.3f} {y:.3f}h0" for x, y in seen(points))
