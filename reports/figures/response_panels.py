"""Bode panels of an FRF matrix as SVG: magnitude above phase for each element, on shared axes."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.path import Path
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from reports.figures import compact_path
from reports.text import fixed
from robotmodels.common.arrays import Array, ComplexArray, IntArray

_DEEPEST = 160.0  # of a panel [dB]
# Percentiles of what is drawn that may lie below a panel; a model dips far under any noise.
_LEAST_LEVEL, _LEAST_FITTED = 5.0, 2.0
# Between columns, rows, and a magnitude and its phase, in widths and heights of the magnitude.
_GAP_X, _GAP_Y, _GAP_PHASE = 0.09, 0.16, 0.05
_PHASE = 0.5  # height of a phase
_PITCH = 1 + _GAP_PHASE + _PHASE + _GAP_Y  # from row to row
_UNITS = 3.0  # of a path in a point
_DASHES = f"{4 * _UNITS:g} {3 * _UNITS:g}"


@dataclass(frozen=True, eq=False)
class _Scales:
    """What all panels share: frequencies [Hz] and levels [dB], each mapped to 0 ... 1."""

    frequency: Array
    low: float
    high: float

    def across(self, frequency: Array) -> Array:
        first, last = np.log(self.frequency[[0, -1]])
        return np.asarray((np.log(frequency) - first) / max(last - first, 1e-12))

    def up(self, magnitude: Array) -> Array:
        return self.part(20 * np.log10(np.maximum(magnitude, 1e-300)))

    def part(self, level: Array) -> Array:
        return np.asarray((level - self.low) / (self.high - self.low))

    def line(self, magnitude: Array) -> Array:
        """Return heights of a curve, with gaps where there is no value."""
        return np.asarray(np.where(magnitude > 0, self.up(magnitude), np.nan))

    def frequency_ticks(self) -> Array:
        """Return 1, 2, 5, 10, ... Hz, or fewer where they would crowd."""
        first, last = self.frequency[[0, -1]]
        steps = (1, 2, 5) if last / first < 12 else (1, 5) if last / first < 60 else (1,)
        ticks = np.array([m * 10.0**e for e in range(-4, 7) for m in steps])
        inside = ticks[(ticks >= first * 0.999) & (ticks <= last * 1.001)]
        return inside if inside.size else self.frequency[:1]

    def level_ticks(self) -> Array:
        return np.asarray(MaxNLocator(4, steps=[1, 2, 4, 5, 10]).tick_values(self.low, self.high))


@dataclass(frozen=True)
class _Layout:
    """Sizes of the panels [pt]: of one magnitude, of the margins, of everything."""

    rows: int
    columns: int

    @property
    def panel(self) -> tuple[float, float]:
        """Width and height of a magnitude."""
        if self.columns > 2:
            return 108.0, 84.0
        return (194.0, 144.0) if self.columns == 2 else (331.0, 173.0)

    @property
    def margins(self) -> tuple[float, float, float]:
        """Left, above and below."""
        return 49.0, 20.0, 36.0

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the picture."""
        (width, height), (before, above, below) = self.panel, self.margins
        across = self.columns + (self.columns - 1) * _GAP_X
        return before + across * width + 4.0, above + (self.rows * _PITCH - _GAP_Y) * height + below

    def corner(self, i: int, j: int) -> tuple[float, float]:
        """Return the upper left corner of the panel of row i and column j."""
        (width, height), (before, above, _) = self.panel, self.margins
        return before + j * (1 + _GAP_X) * width, above + i * _PITCH * height


@dataclass(frozen=True, eq=False)
class ResponsePanels:
    """A drawing of an FRF, (F, m, n).

    Attributes
    ----------
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    measured : ndarray of complex, (F, m, n)
        Measured FRF.
    std : ndarray, (F, m, n)
        Its standard deviations, drawn as a band.
    fitted : ndarray of complex, (G, m, n), or None
        FRF of a model, at `fitted_omega` (G,) [rad/s].
    inputs, outputs : sequence of str
        Names of columns and rows.
    noise, distortion : ndarray, (F, m, n), or None
        Parts of `std`, drawn as levels below; gaps where one is zero or not a number.
    dashed : bool
        Whether `fitted` is drawn in dashes: another measurement, of equal rank.
    """

    omega: Array
    measured: ComplexArray
    std: Array
    fitted: ComplexArray | None
    fitted_omega: Array
    inputs: Sequence[str]
    outputs: Sequence[str]
    noise: Array | None
    distortion: Array | None
    dashed: bool = False

    def svg(self, name: str, alt: str) -> Markup:
        """Return the drawing for a page; `name` prefixes identifiers, `alt` says what is seen."""
        layout = _Layout(*self.measured.shape[1:])
        below = [part for part in (self.noise, self.distortion) if part is not None]
        low, high = _level_range(np.abs(self.measured), below, self.fitted)
        scales = _Scales(self.omega / (2 * np.pi), low, high)
        corners = np.array(
            [layout.corner(i, j) for i, j in np.ndindex(layout.rows, layout.columns)]
        )
        width, height = layout.size
        return Markup(
            f'<svg viewBox="0 0 {width:g} {height:g}" role="img" aria-label="{escape(alt)}" '
            f'style="--width: {width:.0f}; max-width: {width * 4 / 3:.0f}px" '
            f'class="{"many" if layout.columns > 2 else "few"}" '
            f'data-panels="{_panel_data(layout)}">'
            f"{_grid(name, layout, scales, corners)}"
            f"{self._curves(layout, scales, corners)}"
            f"{_labels(layout, self.outputs, self.inputs, scales)}</svg>"
        )

    def _curves(self, layout: _Layout, scales: _Scales, corners: Array) -> str:
        """Return the paths of all panels, one for each kind of curve."""
        width, height = (_UNITS * side for side in layout.panel)
        x, fitted_x = (
            width * scales.across(omega / (2 * np.pi)) for omega in (self.omega, self.fitted_omega)
        )
        corners = _UNITS * corners
        below = corners + np.array([0.0, height * (1 + _GAP_PHASE)])
        size = np.abs(self.measured)
        low, high = (height * (1 - scales.up(np.maximum(size + s * self.std, 0))) for s in (-1, 1))
        bands = [
            compact_path.band(x, *ends, height)
            for ends in zip(_each(low), _each(high), strict=True)
        ]
        drawn = [_path(bands, corners, 'fill="var(--accent)" opacity=".28"')]
        for values, across, colour, pen in (
            (self.noise, x, "muted", 0.6),
            (self.distortion, x, "ink", 0.6),
            (size, x, "accent", 0.7),
            (None if self.fitted is None else np.abs(self.fitted), fitted_x, "second", 1.1),
        ):
            if values is not None:
                heights = _each(height * (1 - scales.line(values)))
                lines = [compact_path.line(across, y, width, height) for y in heights]
                drawn.append(_path(lines, corners, self._pen(colour, pen)))
        for response, across, colour, pen in (
            (np.where(self.std < size, self.measured, np.nan), x, "accent", 0.7),
            (self.fitted, fitted_x, "second", 1.1),
        ):
            if response is not None:
                lines = [_phase(across, one, width, _PHASE * height) for one in _each(response)]
                drawn.append(_path(lines, below, self._pen(colour, pen)))
        return f'<g transform="scale({1 / _UNITS:g})" {_ROUND}>{"".join(drawn)}</g>'

    def _pen(self, colour: str, width: float) -> str:
        dashes = f' stroke-dasharray="{_DASHES}"' if self.dashed and colour == "second" else ""
        return f'fill="none" stroke="var(--{colour})" stroke-width="{_UNITS * width:g}"{dashes}'


_ROUND = 'stroke-linecap="round" stroke-linejoin="round"'


def _each(values: NDArray[Any]) -> NDArray[Any]:
    """Return the curves of (F, m, n), row after row, (m n, F)."""
    return values.reshape(len(values), -1).T


def _path(paths: Sequence[Path], corners: Array, style: str) -> str:
    return f'<path d="{compact_path.data(paths, corners)}" {style}/>'


def _phase(x: Array, response: ComplexArray, width: float, height: float) -> Path:
    """Return a phase from -180 to 180 degrees, below to above."""
    across, turns = unbroken(x, np.angle(response))
    return compact_path.line(across, height * (0.5 - turns / (2 * np.pi)), width, height)


def unbroken(x: Array, phase: Array) -> tuple[Array, Array]:
    """Return a wrapped phase with a gap wherever it jumps from one edge to the other."""
    jumps = np.flatnonzero(np.abs(np.diff(phase)) > np.pi) + 1
    return np.insert(x, jumps, np.nan), np.insert(phase, jumps, np.nan)


def _level_range(
    magnitude: Array, below: Sequence[Array], fitted: ComplexArray | None = None
) -> tuple[float, float]:
    """Return the lowest and highest level to show [dB], whole tens."""
    level = 20 * np.log10(np.maximum(magnitude, 1e-300))
    low, high = float(np.percentile(level, 0.5)), float(level.max())
    parts = [(part, _LEAST_LEVEL) for part in below]
    parts += [] if fitted is None else [(np.abs(fitted), _LEAST_FITTED)]
    for part, percentile in parts:
        positive = part[part > 0]
        if positive.size:
            low = min(low, float(20 * np.log10(np.percentile(positive, percentile))))
    low = max(low, high - _DEEPEST)
    return 10 * float(np.floor(low / 10)), 10 * float(np.ceil((high + 1) / 10))


def _grid(name: str, layout: _Layout, scales: _Scales, corners: Array) -> str:
    """Return grid and axes: drawn once, and used for every panel."""
    width, height = layout.panel
    top = height * (1 + _GAP_PHASE)  # of the phase
    bottom = top + _PHASE * height
    rules = "".join(
        f"M{x:.1f} 0V{height:.1f}M{x:.1f} {top:.1f}V{bottom:.1f}"
        for x in width * scales.across(scales.frequency_ticks())
    )
    levels = scales.part(scales.level_ticks())
    inside = levels[(levels >= -1e-9) & (levels <= 1 + 1e-9)]
    for y in (*(height * (1 - inside)), top + _PHASE * height / 2):
        rules += f"M0 {y:.1f}H{width:.1f}"
    axes = f"M0 0V{height:.1f}H{width:.1f}M0 {top:.1f}V{bottom:.1f}H{width:.1f}"
    uses = "".join(f'<use href="#{name}-grid" x="{x:.1f}" y="{y:.1f}"/>' for x, y in corners)
    return (
        f'<defs><g id="{name}-grid" fill="none"><path d="{rules}" stroke="var(--rule)" '
        f'stroke-width=".5"/><path d="{axes}" stroke="var(--muted)" stroke-width=".6"/></g></defs>'
        + uses
    )


def _labels(layout: _Layout, outputs: Sequence[str], inputs: Sequence[str], scales: _Scales) -> str:
    """Return the words: names of rows and columns, levels, degrees and frequencies."""
    width, height = layout.panel
    names, numbers, levels = [], [], []
    ticks = scales.frequency_ticks()
    last = layout.corner(layout.rows, 0)[1] - _GAP_Y * height  # below the lowest phase
    for j, word in enumerate(inputs):
        x, y = layout.corner(0, j)
        names.append(_text(x + width / 2, y - 6, f"from {word}"))
        for tick, part in zip(ticks, scales.across(ticks), strict=True):
            numbers.append(_text(x + width * float(part), last + 11, f"{tick:g}", "below"))
    for i, word in enumerate(outputs):
        x, y = layout.corner(i, 0)
        at = f"translate({x - 38:.1f} {y + 0.7 * height:.1f})"
        names.append(f'<text transform="{at} rotate(-90)">to {escape(word)}</text>')
        levels += _beside(x - 4, y, height, scales)
    left, right = layout.corner(0, 0)[0], layout.corner(0, len(inputs) - 1)[0] + width
    axis = _text((left + right) / 2, last + 28, "frequency [Hz]", "below")
    small = 'font-size="8" fill="var(--muted)"'
    return (
        f'<g font-size="9" fill="var(--ink)" text-anchor="middle">{"".join(names)}</g>'
        f'<g {small} text-anchor="middle">{"".join(numbers)}</g>'
        f'<g {small} text-anchor="end">{"".join(levels)}</g>'
        f'<g font-size="9" fill="var(--muted)" text-anchor="middle">{axis}</g>'
    )


def _beside(x: float, y: float, height: float, scales: _Scales) -> list[str]:
    """Return levels and degrees on the left of a row whose magnitudes begin at y."""
    words, ticks = [], scales.level_ticks()
    for k, (tick, part) in enumerate(zip(ticks, scales.part(ticks), strict=True)):
        if 0.06 < part <= 1 + 1e-9:  # the lowest would meet the phase's highest
            at = y + height * (1 - part) + 3
            words.append(_text(x, at, fixed(float(tick), 0), "spare" if k % 2 else ""))
    for degrees, down in ((180, 7), (0, 3), (-180, 0)):
        at = y + height * (1 + _GAP_PHASE + _PHASE * (0.5 - degrees / 360)) + down
        words.append(_text(x, at, fixed(degrees, 0) + "°", "spare"))
    return words


def _text(x: float, y: float, words: str, kind: str = "") -> str:
    """Return words at a place; narrow screens leave `kind` "spare" out and shift "below"."""
    mark = kind and f' class="{kind}"'
    return f'<text x="{x:.1f}" y="{y:.1f}"{mark}>{escape(words)}</text>'


def _panel_data(layout: _Layout) -> str:
    """Return where panels are, for the script that enlarges one: corner, pitches, size [pt]."""
    (x, y), (width, height) = layout.corner(0, 0), layout.panel
    right, below = layout.corner(1, 1)
    bottom = height * (1 + _GAP_PHASE + _PHASE)
    return json.dumps([round(v, 1) for v in (x, y, right - x, below - y, width, bottom)])


def response_panels(
    omega: Array,
    measured: ComplexArray,
    std: Array,
    fitted: ComplexArray | None,
    motors: Sequence[str],
    noise: Array | None = None,
    distortion: Array | None = None,
    outputs: Sequence[str] | None = None,
    fitted_omega: Array | None = None,
    dashed: bool = False,
) -> ResponsePanels:
    """Return the panels; by default outputs are the motors, and the model is at `omega`."""
    return ResponsePanels(
        omega,
        measured,
        std,
        fitted,
        omega if fitted_omega is None else fitted_omega,
        motors,
        motors if outputs is None else outputs,
        noise,
        distortion,
        dashed,
    )


BUDGET = 1_200_000
"""Bytes that all panels of a page and their data may take."""

_BYTES_OF_ELEMENT, _BYTES_OF_LINE, _FEWEST = 600, 18.5, 20
"""What an element of a position takes, and each of its lines; fewest lines to draw."""


def lines_drawn(shape: tuple[int, ...]) -> IntArray:
    """Return which lines of (Q, F, m, n) responses are drawn: all, or evenly so many as fit."""
    positions, lines, m, n = shape
    room = (BUDGET / (positions * m * n) - _BYTES_OF_ELEMENT) / _BYTES_OF_LINE
    count = min(lines, max(int(room), _FEWEST))
    return np.unique(np.linspace(0, lines - 1, count).round().astype(np.int64))
