"""Panels drawn as SVG, in the page's colours and typeface."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from markupsafe import Markup

from reports.figures import compact_path
from reports.figures.panels import Area, Axis, Bubbles, Curve, Mark, Panel, Panels, Rule
from robotmodels.common.arrays import Array, IntArray

_UNITS = 10.0  # of a path in a point
_LETTER, _LINE = 0.6, 12.0  # width of a letter in its height, and height of a line [pt]
_SMALL, _SIZE = 8.0, 9.0  # letters of numbers, and of labels [pt]
_ROOM = 1.35  # of words in a legend, which are larger on narrow screens
_WIDE = 0x2E80  # code of the first letter of these scripts
_GAP, _EDGE = 8.0, 4.0  # between panels, and around all of them [pt]


@dataclass(frozen=True, eq=False)
class _Ready:
    """A panel with its ends and ticks."""

    panel: Panel
    spans: tuple[tuple[float, float], tuple[float, float]]
    ticks: tuple[dict[float, str], dict[float, str]]

    @classmethod
    def of(cls, panel: Panel | None) -> "_Ready | None":
        if panel is None:
            return None
        spans = panel.spans()
        return cls(panel, spans, (panel.x.ticks(spans[0]), panel.y.ticks(spans[1])))

    @property
    def margins(self) -> tuple[float, float, float, float]:
        """Room for words on the left, above, on the right and below [pt]."""
        x, y = self.panel.x, self.panel.y
        turned = x.rotation and _longest(self.ticks[0]) * np.sin(np.radians(x.rotation))
        numbers = (_longest(self.ticks[1]) + 5) * y.numbered + 1.2 * _LINE * len(_lines(y.label))
        below = (max(turned, _SMALL) + 6) * x.numbered + (_LINE if x.label else 0)
        last = _longest(dict([*self.ticks[0].items()][-1:])) if x.numbered else 0.0
        return numbers, 15.0 * bool(self.panel.title), 0.0 if x.rotation else last / 2, below


def svg(panels: Panels, alt: str) -> Markup:
    """Return panels as SVG; `alt` says what is to be seen."""
    width, height = (72 * side for side in panels.size)
    ready = [[_Ready.of(panel) for panel in row] for row in panels.rows]
    start, right = _EDGE + _LINE * bool(panels.up), width - _EDGE
    top, bottom = _EDGE + 16.0 * bool(panels.legend), height - _EDGE - _LINE * bool(panels.across)
    columns = list(zip(*ready, strict=True))
    across = _stretches(
        start,
        right,
        [_margin(c, 0) for c in columns],
        [_margin(c, 2) for c in columns],
        panels.widths,
    )
    down = _stretches(
        top, bottom, [_margin(r, 1) for r in ready], [_margin(r, 3) for r in ready], panels.heights
    )
    parts = [
        _panel(one, (x, y, w, h))
        for row, (y, h) in zip(ready, down, strict=True)
        for one, (x, w) in zip(row, across, strict=True)
        if one is not None
    ]
    parts.append(_legend(panels, right))
    middle = (
        (across[0][0] + across[-1][0] + across[-1][1]) / 2,
        (down[0][0] + down[-1][0] + down[-1][1]) / 2,
    )
    if panels.across:
        parts.append(_words(middle[0], height - _EDGE - 2, panels.across, "middle", "muted"))
    if panels.up:
        parts.append(_turned(_EDGE + _SIZE, middle[1], panels.up))
    return Markup(
        f'<svg viewBox="0 0 {width:g} {height:g}" role="img" aria-label="{escape(alt)}" '
        f'style="--width: {width:.0f}; max-width: {width * 4 / 3:.0f}px">{"".join(parts)}</svg>'
    )


def _lines(words: str) -> list[str]:
    return words.split("\n") if words else []


def _longest(ticks: dict[float, str]) -> float:
    """Return the width of the longest word [pt]."""
    return max((_width(words, _SMALL) for words in ticks.values()), default=0.0)


def _width(words: str, size: float) -> float:
    """Return about how wide words are [pt]; letters of Chinese and the like are as wide as high."""
    return size * sum(_LETTER if ord(letter) < _WIDE else 1.0 for letter in words)


def _margin(panels: Sequence[_Ready | None], side: int) -> float:
    return max((one.margins[side] for one in panels if one is not None), default=0.0)


def _stretches(
    start: float, end: float, before: list[float], after: list[float], ratios: Sequence[float]
) -> list[tuple[float, float]]:
    """Return start and length of the panels along one direction [pt]."""
    shares = np.array(ratios or np.ones(len(before)), dtype=float)
    room = end - start - sum(before) - sum(after) - _GAP * (len(before) - 1)
    stretches = []
    for first, last, share in zip(before, after, shares / shares.sum(), strict=True):
        length = max(room, 10.0) * float(share)
        stretches.append((start + first, length))
        start += first + length + last + _GAP
    return stretches


@dataclass(frozen=True, eq=False)
class _Scale:
    """From values along an axis to a box: 0 at its left or top, `length` at its other end [pt]."""

    ends: tuple[float, float]
    length: float
    log: bool

    def __call__(self, values: Array | IntArray) -> Array:
        with np.errstate(invalid="ignore", divide="ignore"):
            low, high, at = (np.log(v) if self.log else np.asarray(v) for v in (*self.ends, values))
        part = (at - low) / ((high - low) or 1.0)
        return np.where(np.isfinite(part), self.length * part, np.nan)


def _panel(one: _Ready, box: tuple[float, float, float, float]) -> str:
    """Return a panel in its box: left, top, width, height [pt]."""
    panel, (x, y, width, height) = one.panel, box
    if panel.square:
        per_unit = min(
            side / abs(b - a) for side, (a, b) in zip((width, height), one.spans, strict=True)
        )
        shrunk = [per_unit * abs(b - a) for a, b in one.spans]
        x, y = x + (width - shrunk[0]) / 2, y + (height - shrunk[1]) / 2
        width, height = shrunk
    across = _Scale(one.spans[0], width, panel.x.log)
    up = _Scale(one.spans[1][::-1], height, panel.y.log)
    at = [
        scale(np.array([*ticks], dtype=float))
        for scale, ticks in zip((across, up), one.ticks, strict=True)
    ]
    marks = "".join(_mark(mark, across, up) for mark in panel.marks)
    return (
        f'<g transform="translate({x:.1f} {y:.1f})">{_grid(panel, at, width, height)}'
        f'<g transform="scale({1 / _UNITS:g})" fill="none" stroke-linejoin="round">{marks}</g>'
        f"{_labels(one, at, width, height)}</g>"
    )


def _grid(panel: Panel, at: Sequence[Array], width: float, height: float) -> str:
    """Return the lines across at ticks, and those along the axes."""
    rules = "".join(f"M{x:.1f} 0v{height:.1f}" for x in at[0] if panel.x.grid)
    rules += "".join(f"M0 {y:.1f}h{width:.1f}" for y in at[1] if panel.y.grid)
    along = f"M0 0v{height:.1f}" * panel.y.line + f"M0 {height:.1f}h{width:.1f}" * panel.x.line
    colour = "muted"
    if panel.boxed:
        along, colour = f"M0 0h{width:.1f}v{height:.1f}h{-width:.1f}z", "rule"
    return "".join(
        f'<path d="{d}" fill="none" stroke="var(--{pen})" stroke-width="{thick}"/>'
        for d, pen, thick in ((rules, "rule", 0.5), (along, colour, 0.6))
        if d
    )


def _labels(one: _Ready, at: Sequence[Array], width: float, height: float) -> str:
    """Return the words around a panel."""
    panel, (x_axis, y_axis) = one.panel, (one.panel.x, one.panel.y)
    out = _words(0, -5, panel.title, "start", "ink") if panel.title else ""
    beside, _, _, below = one.margins
    if x_axis.numbered:
        out += _numbers(
            [
                _tick(x, height + 12, w, x_axis)
                for x, w in zip(at[0], one.ticks[0].values(), strict=True)
            ],
            "end" if x_axis.rotation else "middle",
        )
    if y_axis.numbered:
        out += _numbers(
            [_text(-4, y + 3, w) for y, w in zip(at[1], one.ticks[1].values(), strict=True)], "end"
        )
    if x_axis.label:
        out += _words(width / 2, height + below - 1, x_axis.label, "middle", "muted")
    for k, line in enumerate(_lines(y_axis.label)):
        out += _turned(_LINE * (k + 1) - beside - 2, height / 2, line)
    return out


def _tick(x: float, y: float, words: str, axis: Axis) -> str:
    if not axis.rotation:
        return _text(x, y, words)
    at = f"translate({x + 3:.1f} {y - 7:.1f}) rotate({-axis.rotation:g})"
    return f'<text transform="{at}">{escape(words)}</text>'


def _numbers(words: Sequence[str], anchor: str) -> str:
    return (
        f'<g font-size="{_SMALL:g}" fill="var(--muted)" text-anchor="{anchor}">{"".join(words)}</g>'
    )


def _text(x: float, y: float, words: str, more: str = "") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}"{more}>{escape(words)}</text>'


def _words(x: float, y: float, words: str, anchor: str, colour: str) -> str:
    more = f' font-size="{_SIZE:g}" fill="var(--{colour})" text-anchor="{anchor}"'
    return _text(x, y, words, more)


def _turned(x: float, y: float, words: str) -> str:
    """Return a label along an upright axis."""
    return (
        f'<text transform="translate({x:.1f} {y:.1f}) rotate(-90)" '
        f'font-size="{_SIZE:g}" fill="var(--muted)" text-anchor="middle">{escape(words)}</text>'
    )


def _legend(panels: Panels, right: float) -> str:
    """Return names with dots of their colours, above the panels and to the right."""
    out = []
    for name, colour in reversed(panels.legend):
        right -= _ROOM * _width(name, _SIZE)
        out.append(_words(right, _EDGE + 9, name, "start", "ink"))
        d = f"M{right - 15:.1f} {_EDGE + 6:.1f}h10"
        out.append(f'<path d="{d}" stroke="var(--{colour})" stroke-width="3"/>')
        right -= 30.0
    return "".join(out)


_CRISP = 'shape-rendering="crispEdges"'  # cells that touch have no seams


def _mark(mark: Mark, across: _Scale, up: _Scale) -> str:
    """Return one mark in units of a path."""
    size = (_UNITS * across.length, _UNITS * up.length)
    if isinstance(mark, Rule):
        at = float((across if mark.upright else up)(np.array(mark.at))) * _UNITS
        if not 0 <= at <= size[0 if mark.upright else 1]:
            return ""
        d = f"M{at:.0f} 0V{size[1]:.0f}" if mark.upright else f"M0 {at:.0f}H{size[0]:.0f}"
        return f'<path d="{d}"{_pen(mark.colour, mark.width, mark.dashes)}/>'
    x, y = _UNITS * across(mark.x), _UNITS * up(mark.y)
    match mark:
        case Curve():
            return _curve(mark, x, y, size)
        case Area():
            d = compact_path.polygons(np.clip(x, 0, size[0]), np.clip(y, 0, size[1]))
            return f'<path d="{d}" fill="var(--{mark.colour})"{_faint(mark.opacity)} {_CRISP}/>'
        case Bubbles():
            radii = _UNITS * np.sqrt(mark.areas / np.pi)
            discs = "".join(
                f'<circle cx="{a:.0f}" cy="{b:.0f}" r="{r:.0f}"/>'
                for a, b, r in zip(x, y, radii, strict=True)
            )
            return (
                f'<g fill="var(--{mark.colour})" stroke="var(--ink)" stroke-width="6">{discs}</g>'
            )


def _curve(mark: Curve, x: Array, y: Array, size: tuple[float, float]) -> str:
    out, faint = "", _faint(mark.opacity)
    origin = np.zeros((1, 2))
    if mark.width:
        path = compact_path.line(x, y, *size)
        pen = _pen(mark.colour, mark.width, mark.dashes)
        cap = "" if mark.dashes else ' stroke-linecap="round"'
        out = f'<path d="{compact_path.data([path], origin)}"{pen}{cap}{faint}/>'
    if mark.dots:
        inside = (x >= 0) & (x <= size[0]) & (y >= 0) & (y <= size[1])
        d = "".join(f"M{a:.0f} {b:.0f}h0" for a, b in zip(x[inside], y[inside], strict=True))
        out += f'<path d="{d}"{_pen(mark.colour, mark.dots)} stroke-linecap="round"{faint}/>'
    return out


def _pen(colour: str, width: float, dashes: Sequence[float] = ()) -> str:
    lengths = " ".join(f"{_UNITS * width * dash:g}" for dash in dashes)
    dashed = f' stroke-dasharray="{lengths}"' if dashes else ""
    return f' stroke="var(--{colour})" stroke-width="{_UNITS * width:g}"{dashed}'


def _faint(opacity: float) -> str:
    return "" if opacity == 1.0 else f' opacity="{opacity:g}"'
