"""What ``oed margins`` says: a table for the terminal, JSON, and CSV."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from estimators.validation.controller_margins import ControllerMargins
from reports import text
from reports.sections.controller import locus_words, remedy_words, worst_rows
from reports.summaries.columns import csv_text, number, plain, table
from robotmodels.common.plain_data import json_data

_MARGINS = {
    "gain_margin": "-",
    "gain_reduction": "-",
    "phase_margin": "rad",
    "peak_sensitivity": "-",
    "peak_frequency": "rad/s",
    "bandwidth": "rad/s",
}


def margins_summary(margins: ControllerMargins, spread: str, written: Sequence[Path]) -> str:
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
        f"{text.level(band.level)} intervals allow; each loop with the others closed; "
        f"–: no limit; draws: {spread}",
        *table(header, worst_rows(margins), right=range(1, 6)),
        f"  largest singular value of S: {number(band.nominal.largest_sensitivity.max())}",
        f"  instability: {band.unstable[unstable]} of {band.draws} draws in position "
        f"{unstable + 1}, the worst; at most {100 * band.probability_bound[unstable]:.2g} % (95 %)",
    ]
    lines.append(f"  {locus_words(locus, margins.weakest)}")
    lines += [f"  to begin with, {remedy_words(r, margins.motors)}" for r in margins.remedies]
    return "\n".join(plain(line) for line in [*lines, *(f"written  {p}" for p in written)])


def margins_document(margins: ControllerMargins, spread: str) -> dict[str, Any]:
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
        "spread": spread,
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
