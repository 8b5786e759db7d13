"""Figures of margins: each motor's in every position with intervals, all loops as one curve."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from estimators.validation.margin_bands import MarginBand
from reports.figures.study_figures import Drawing
from reports.figures.svg import Palette
from robotmodels import DeterminantLocus
from robotmodels.common.arrays import Array

_PANELS = (
    ("gain_margin", "gain margin", 1.0),
    ("phase_margin", "phase margin [°]", 180 / np.pi),
    ("peak_sensitivity", "peak of |S|", 1.0),
)
_WIDTH = 0.6
"""Of the positions of one motor, in motors."""


def margins_by_motor(band: MarginBand, motors: Sequence[str]) -> Drawing:
    """Return margins of each motor, one dot with its interval for each position."""

    def draw(palette: Palette) -> Figure:
        figure = Figure(figsize=(7.0, 5.6), layout="constrained")
        for axes, (name, label, factor) in zip(
            figure.subplots(3, 1, sharex=True), _PANELS, strict=True
        ):
            parts = (getattr(m, name) for m in (band.nominal, band.lower, band.upper))
            _dots(axes, palette, [factor * part for part in parts])
            axes.set(ylabel=label)
            axes.grid(True, axis="y")
        axes.set_xticks(range(len(motors)), motors, rotation=30 if len(motors) > 4 else 0)
        return figure

    return draw


def _dots(axes: Axes, palette: Palette, values: list[Array]) -> None:
    """Draw values and intervals, (Q, n); what has no limit is not drawn."""
    positions, motors = values[0].shape
    shifts = _WIDTH * ((np.arange(positions) + 0.5) / positions - 0.5)
    x = np.arange(motors) + shifts[:, None]
    nominal, low, high = (np.where(np.isfinite(v), v, np.nan) for v in values)
    axes.vlines(x, low, high, color=palette.accent, lw=1.2, alpha=0.5)
    axes.plot(x, nominal, "o", color=palette.accent, ms=3)


def determinant_curve(locus: DeterminantLocus) -> Drawing:
    """Return det(1 + F G), its distance r from the origin drawn as r / (1 + r)."""

    def draw(palette: Palette) -> Figure:
        figure = Figure(figsize=(4.6, 4.6), layout="constrained")
        axes = figure.add_subplot()
        curve = locus.values / (1 + np.abs(locus.values))
        axes.plot(curve.real, curve.imag, color=palette.accent, lw=1.2)
        axes.plot(curve.real, -curve.imag, color=palette.accent, lw=0.9, ls=":")
        angle = np.linspace(0, 2 * np.pi, 200)
        for radius, style in ((0.5, ":"), (1.0, "-")):
            ring = radius * np.exp(1j * angle)
            axes.plot(ring.real, ring.imag, color=palette.rule, lw=0.8, ls=style)
        axes.plot(0, 0, "+", color=palette.second, ms=9)
        axes.set(aspect="equal", xticks=[], yticks=[])
        axes.set(xlabel="real part, squeezed", ylabel="imaginary part, squeezed")
        return figure

    return draw
