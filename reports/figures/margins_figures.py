"""Figures of margins: each motor's in every position with intervals, all loops as one curve."""

from collections.abc import Sequence

import numpy as np

from estimators.validation.margin_bands import MarginBand
from reports.figures.panels import Axis, Curve, Panel, Panels, bars
from robotmodels import DeterminantLocus
from robotmodels.common.arrays import Array

_PANELS = (
    ("gain_margin", "gain margin [–]", 1.0),
    ("phase_margin", "phase margin [°]", 180 / np.pi),
    ("peak_sensitivity", "peak of |S| [–]", 1.0),
)
_DOTTED = (1.0, 1.65)
_WIDTH = 0.6
"""Of the positions of one motor, in motors."""


def margins_by_motor(band: MarginBand, motors: Sequence[str]) -> Panels:
    """Return margins of each motor, one dot with its interval for each position."""
    names = {float(j): motor for j, motor in enumerate(motors)}
    ends, rotation = (-0.5, len(motors) - 0.5), 30.0 if len(motors) > 4 else 0.0
    rows = []
    shown = [one for one in _PANELS if np.isfinite(getattr(band.nominal, one[0])).any()]
    for name, label, factor in shown or _PANELS[-1:]:
        last = name == (shown or _PANELS)[-1][0]
        x = Axis("", ends, names=names, rotation=rotation, numbered=last, grid=False)
        parts = [factor * getattr(m, name) for m in (band.nominal, band.lower, band.upper)]
        rows.append([Panel(_dots(parts), x, Axis(label))])
    return Panels((7.0, 0.5 + 1.7 * len(rows)), rows)


def _dots(values: list[Array]) -> tuple[Curve, Curve]:
    """Return values and intervals, (Q, n); what has no limit is not drawn."""
    positions, motors = values[0].shape
    shifts = _WIDTH * ((np.arange(positions) + 0.5) / positions - 0.5)
    x = (np.arange(motors) + shifts[:, None]).ravel()
    nominal, low, high = (np.where(np.isfinite(v), v, np.nan).ravel() for v in values)
    intervals = Curve(*bars(x, low, high), "accent", 1.2, opacity=0.5)
    return intervals, Curve(x, nominal, "accent", 0.0, 3.0)


def determinant_curve(locus: DeterminantLocus) -> Panels:
    """Return det(1 + F G), its distance r from the origin drawn as r / (1 + r)."""
    curve = locus.values / (1 + np.abs(locus.values))
    turn = np.exp(1j * np.linspace(0, 2 * np.pi, 200))
    marks = (
        Curve(0.5 * turn.real, 0.5 * turn.imag, "rule", 0.8, dashes=_DOTTED),
        Curve(turn.real, turn.imag, "rule", 0.8),
        Curve(curve.real, curve.imag, "accent", 1.2),
        Curve(curve.real, -curve.imag, "accent", 0.9, dashes=_DOTTED),
        Curve(
            np.array([-0.03, 0.03, np.nan, 0, 0]), np.array([0, 0, np.nan, -0.03, 0.03]), "second"
        ),
    )
    x, y = (Axis(f"{part} part, compressed", names={}) for part in ("real", "imaginary"))
    return Panels((4.6, 4.6), [[Panel(marks, x, y, square=True)]])
