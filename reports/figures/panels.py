"""What a figure shows: panels of marks over two axes, drawn as SVG on pages, by matplotlib else."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
from markupsafe import Markup
from matplotlib.ticker import Locator, LogLocator, MaxNLocator

from reports.figures.palette import Palette
from reports.text import MINUS
from robotmodels.common.arrays import Array, IntArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Colour = Literal["ink", "muted", "rule", "accent", "second"]
Limits = tuple[float | None, float | None]

SERIES: tuple[Colour, ...] = ("accent", "second", "ink", "muted")
"""Colours of curves side by side."""

DASHES = (4.0, 3.0)
_MARGIN = 0.05  # beside the data, of their span
_FEW, _SOME = 10.0, 200.0  # largest over smallest number on a logarithmic axis


@dataclass(frozen=True, eq=False)
class Curve:
    """Points (N,) joined by a line, with gaps at NaN.

    Attributes
    ----------
    width : float, pt
        Of the line; none is drawn where it is zero.
    dots : float, pt
        Diameter of a dot at every point; none where it is zero.
    dashes : tuple of float
        Lengths of line and gap in line widths; empty for a solid line.
    """

    x: Array | IntArray
    y: Array
    colour: Colour
    width: float = 1.4
    dots: float = 0.0
    dashes: tuple[float, ...] = ()
    opacity: float = 1.0


@dataclass(frozen=True, eq=False)
class Rule:
    """A line across the panel at a value of y, or of x where it is upright; width as of `Curve`."""

    at: float
    colour: Colour
    width: float = 0.8
    dashes: tuple[float, ...] = ()
    upright: bool = False


@dataclass(frozen=True, eq=False)
class Area:
    """Filled polygons with corners (N,), parted by NaN."""

    x: Array
    y: Array
    colour: Colour
    opacity: float = 1.0


@dataclass(frozen=True, eq=False)
class Bubbles:
    """Discs at (N,) points, with their areas [pt^2]."""

    x: Array
    y: Array
    areas: Array
    colour: Colour


Mark = Curve | Rule | Area | Bubbles


def bars(at: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Return bars from low to high at places along an axis, (3 N,) each, with gaps between."""
    gaps = np.full(len(at), np.nan)
    return np.repeat(at, 3), np.column_stack([low, high, gaps]).ravel()


def cells(x: Array, y: Array, filled: Array) -> tuple[Array, Array]:
    """Return corners of cells between edges x (C + 1,) and y (R + 1,) where `filled` (R, C)."""
    i, j = np.nonzero(filled)
    gaps = np.full(len(i), np.nan)
    across = np.column_stack([x[j], x[j + 1], x[j + 1], x[j], gaps])
    return across.ravel(), np.column_stack([y[i], y[i], y[i + 1], y[i + 1], gaps]).ravel()


def plain(value: float) -> str:
    """Return a number of an axis as short as it can be."""
    return f"{value:g}".replace("-", MINUS)


@dataclass(frozen=True, eq=False)
class Axis:
    """One axis of a panel.

    Attributes
    ----------
    limits : tuple of float or None
        Ends; those of the marks with a margin where None. The first may be the larger.
    locator : Locator, optional
        Where ticks are; evenly, or at round numbers of decades, by default.
    words : callable
        Words of a number.
    names : mapping of float to str, optional
        Ticks and their words, instead of numbers.
    count : int
        Numbers, at most, by default.
    integer : bool
        Whether these are whole.
    rotation : float, deg
        Of the words.
    numbered, grid, line : bool
        Whether ticks have words; whether there are lines across at the ticks, and one along.
    """

    label: str = ""
    limits: Limits = (None, None)
    log: bool = False
    locator: Locator | None = None
    words: Callable[[float], str] = plain
    names: Mapping[float, str] | None = None
    count: int = 6
    integer: bool = False
    rotation: float = 0.0
    numbered: bool = True
    grid: bool = True
    line: bool = True

    def span(self, values: Sequence[Array]) -> tuple[float, float]:
        """Return the ends for marks with such values."""
        every = np.concatenate([np.ravel(value) for value in values] or [np.ones(1)])
        every = every[np.isfinite(every) & ((every > 0) | (not self.log))]
        every = every if every.size else np.ones(1)
        ends = np.array([every.min(), every.max()])
        ends = np.log(ends) if self.log else ends
        margin = _MARGIN * (ends[1] - ends[0]) or 0.5 * (abs(float(ends[0])) or 1.0)
        ends = ends + np.array([-margin, margin])
        low, high = np.exp(ends) if self.log else ends
        first, last = self.limits
        return float(low if first is None else first), float(high if last is None else last)

    def ticks(self, span: tuple[float, float]) -> dict[float, str]:
        """Return the ticks between the ends and their words."""
        if self.names is not None:
            return dict(self.names)
        low, high = sorted(span)
        at = np.asarray((self.locator or self._round(low, high)).tick_values(low, high))
        slack = 1e-9 * np.abs(at if self.log else high - low)
        inside = at[(at >= low - slack) & (at <= high + slack)]
        return {float(tick): self.words(float(tick)) for tick in inside}

    def _round(self, low: float, high: float) -> Locator:
        if not self.log or high < _FEW * low:
            return MaxNLocator(self.count, steps=[1, 2, 2.5, 5, 10], integer=self.integer)
        if high < _SOME * low:
            return LogLocator(subs=(1.0, 2.0, 5.0), numticks=20)
        return LogLocator(numticks=self.count)


@dataclass(frozen=True, eq=False)
class Panel:
    """Marks over two axes, the later above the earlier.

    Attributes
    ----------
    square : bool
        Whether units are as long across as up.
    boxed : bool
        Whether a faint line goes all around, instead of the two axes.
    """

    marks: Sequence[Mark]
    x: Axis = field(default_factory=Axis)
    y: Axis = field(default_factory=Axis)
    title: str = ""
    square: bool = False
    boxed: bool = False

    def spans(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return the ends of both axes."""
        free = [mark for mark in self.marks if not isinstance(mark, Rule)]
        rules = [mark for mark in self.marks if isinstance(mark, Rule)]
        across = [mark.x for mark in free] + [np.array(r.at) for r in rules if r.upright]
        up = [mark.y for mark in free] + [np.array(r.at) for r in rules if not r.upright]
        return self.x.span(across), self.y.span(up)


@dataclass(frozen=True, eq=False)
class Panels:
    """A figure: rows of panels, of which some places may be empty.

    Attributes
    ----------
    size : tuple of float, in
        Width and height.
    widths, heights : sequence of float
        Of columns and rows, in any unit; equal where empty.
    legend : sequence of tuple
        Names and colours, above the panels.
    across, up : str
        Labels below all panels, and on their left.
    """

    size: tuple[float, float]
    rows: Sequence[Sequence[Panel | None]]
    widths: Sequence[float] = ()
    heights: Sequence[float] = ()
    legend: Sequence[tuple[str, Colour]] = ()
    across: str = ""
    up: str = ""

    def svg(self, name: str, alt: str) -> Markup:
        """Return the figure for a page; `name` prefixes identifiers, `alt` says what is seen."""
        from reports.figures.svg_panels import svg

        return svg(self, alt)

    def __call__(self, palette: Palette) -> "Figure":
        """Return the figure of matplotlib, in the colours of a palette."""
        from reports.figures.matplotlib_panels import drawn

        return drawn(self, palette)
