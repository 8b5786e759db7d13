"""What ``oed margins`` says: a table for the terminal, JSON, and CSV."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from estimators.validation.margin_bands import MarginBand, Suggestion
from reports import text
from reports.summaries.columns import csv_text, number, plain, table
from robotmodels import DeterminantLocus
from robotmodels.common.plain_data import json_data


@dataclass(frozen=True, eq=False)
class ControllerMargins:
    """What a fit says of a controller.

    Attributes
    ----------
    band : MarginBand
        Margins in Q positions.
    loci : tuple of DeterminantLocus
        Nyquist curves of all loops at once, at the fitted values, by position.
    motors : tuple of str
        Names of the n motors.
    remedies : tuple of Suggestion
        Values to begin tuning with.
    spread : str
        What the bands rest on.
    """

    band: MarginBand
    loci: tuple[DeterminantLocus, ...]
    motors: tuple[str, ...]
    remedies: tuple[Suggestion, ...]
    spread: str

    @property
    def weakest(self) -> int:
        """Position of the largest singular value of S, an unstable one first."""
        return int(np.argmax(self.band.nominal.largest_sensitivity))


_MARGINS = {
    "gain_margin": "-",
    "gain_reduction": "-",
    "phase_margin": "rad",
    "peak_sensitivity": "-",
    "peak_frequency": "rad/s",
    "bandwidth": "rad/s",
}


def worst_rows(margins: ControllerMargins) -> list[tuple[str, ...]]:
    """Return the worst of each motor over the positions, in brackets what intervals allow."""
    rows, band, nominal = list[tuple[str, ...]](), margins.band, margins.band.nominal
    for i, motor in enumerate(margins.motors):
        gains = (number(m.gain_margin[:, i].min()) for m in (nominal, band.lower))
        phases = (np.rad2deg(m.phase_margin[:, i].min()) for m in (nominal, band.lower))
        peaks = (number(m.peak_sensitivity[:, i].max()) for m in (nominal, band.upper))
        worst = int(np.argmax(nominal.peak_sensitivity[:, i]))
        rows.append(
            (
                motor,
                "{} ({})".format(*gains),
                "{:.1f} ({:.1f})".format(*phases),
                "{} ({})".format(*peaks),
                number(nominal.peak_frequency[worst, i] / (2 * np.pi)),
                number(nominal.bandwidth[:, i].min() / (2 * np.pi)),
            )
        )
    return rows


def margins_summary(margins: ControllerMargins, written: Sequence[Path]) -> str:
    """Return the worst of each motor over the positions, stability, and what may help."""
    band, locus = margins.band, margins.loci[margins.weakest]
    header = (
        "motor",
        "gain margin\n(lower end)",
        "phase [deg]\n(lower end)",
        "peak of S\n(upper end)",
        "at\n[Hz]",
        "bandwidth\n[Hz]",
    )
    unstable = int(np.argmax(band.unstable))
    lines = [
        f"worst over {text.plural(len(band.positions), 'position')}, in brackets what "
        f"{band.level:.0%} intervals allow; each loop with the others closed; "
        f"–: no limit; draws: {margins.spread}",
        *table(header, worst_rows(margins), right=range(1, 6)),
        f"  largest singular value of S: {number(band.nominal.largest_sensitivity.max())}",
        f"  instability: {band.unstable[unstable]} of {band.draws} draws in position "
        f"{unstable + 1}, the worst; at most {100 * band.probability_bound[unstable]:.2g} % (95 %)",
    ]
    lines.append(f"  {locus_words(locus, margins.weakest)}")
    lines += [f"  to begin with, {remedy_words(r, margins.motors)}" for r in margins.remedies]
    return "\n".join(plain(line) for line in [*lines, *(f"written  {p}" for p in written)])


def locus_words(locus: DeterminantLocus, position: int) -> str:
    """Return what the Nyquist curve of all loops says."""
    turns = text.plural(abs(locus.encirclements), "time")
    against = "against the clock" if locus.encirclements >= 0 else "with the clock"
    return (
        f"det(1 + F G) in position {position + 1}, the weakest, turns {turns} {against}, with "
        f"{text.plural(locus.open_unstable, 'unstable open pole')}: "
        f"{'stable' if locus.stable else text.plural(locus.unstable, 'unstable pole')}"
    )


def margins_document(margins: ControllerMargins) -> dict[str, Any]:
    """Return margins, their intervals and suggestions as plain numbers, SI units."""
    band = margins.band
    content = {
        "schema": "margins/1",
        "motors": list(margins.motors),
        "positions": band.positions,
        "nominal": band.nominal,
        "lower": band.lower,
        "upper": band.upper,
        "level": band.level,
        "draws": band.draws,
        "spread": margins.spread,
        "unstable": band.unstable,
        "probability_of_instability": band.probability,
        "probability_bound": band.probability_bound,
        "unstable_poles": [locus.unstable for locus in margins.loci],
        "suggestions": margins.remedies,
    }
    document: dict[str, Any] = json_data(content)
    return document


def margins_csv(margins: ControllerMargins) -> str:
    """Return a table with a row for each position and motor."""
    band, motors = margins.band, margins.motors
    header = ["position", "motor", "stable", "unstable draws", "largest singular value of S"]
    for name, unit in _MARGINS.items():
        header += [f"{name} [{unit}]", f"{name} lower", f"{name} upper"]
    rows = []
    for q, i in np.ndindex(len(band.positions), len(motors)):
        row: list[Any] = [q + 1, motors[i], bool(band.nominal.stable[q]), int(band.unstable[q])]
        row.append(float(band.nominal.largest_sensitivity[q]))
        for name in _MARGINS:
            row += [float(getattr(m, name)[q, i]) for m in (band.nominal, band.lower, band.upper)]
        rows.append(row)
    return csv_text(header, rows)


def remedy_words(remedy: Suggestion, motors: Sequence[str]) -> str:
    """Return a suggestion in words."""
    what = f"{remedy.gain:g} of its gain"
    if remedy.notch is not None:
        hertz = remedy.notch.frequency / (2 * np.pi)
        what = f"a notch at {number(hertz)} Hz, damping {remedy.notch.zeros:g}"
        what += f" over {remedy.notch.poles:g}"
    change = f"from {number(remedy.before)} to {number(remedy.after)}"
    return f"{motors[remedy.motor]}: {what} takes its worst peak of S {change}"
