"""The page of ``oed margins``: margins of each motor, all loops at once, what may help."""

from pathlib import Path

import numpy as np

from estimators.trust.trust import Trust
from reports import text
from reports.figures.margins_figures import determinant_curve, margins_by_motor
from reports.page_elements import (
    Column,
    Number,
    Section,
    Table,
    figure,
    filled,
    number_cell,
    numbers,
    page,
    table,
)
from reports.sections.verdict import bands_banner
from reports.summaries.margins_summary import (
    ControllerMargins,
    locus_words,
    remedy_words,
    worst_rows,
)
from robotmodels.common.atomic_files import write_text


def write_margins_page(
    margins: ControllerMargins, name: str, path: Path, trust: Trust | None = None
) -> None:
    """Write margins as one HTML file that needs nothing else.

    Parameters
    ----------
    trust : Trust, optional
        Of the fit that predicts; None of a robot file.
    """
    band = margins.band
    loops = filled(
        "margins.html.j2",
        worst=worst_table(margins),
        drawing=figure(
            "margins",
            margins_by_motor(band, margins.motors),
            "Gain margin, phase margin and peak of the sensitivity of each motor in each position",
            wide=True,
        ),
        positions=position_table(margins),
        draws=band.draws,
    )
    curve = figure(
        "determinant",
        determinant_curve(margins.loci[margins.weakest]),
        "Curve of det(1 + F G) about the origin over all frequencies",
    )
    words = text.sentence(locus_words(margins.loci[margins.weakest], margins.weakest))
    stability = filled("margins_stability.html.j2", curve=curve, words=words)
    remedies = [text.sentence(remedy_words(r, margins.motors)) for r in margins.remedies]
    sections = [
        Section("loops", "Margins", loops),
        Section("stability", "All loops at once", stability),
        Section("remedies", "To begin with", filled("margins_remedies.html.j2", remedies=remedies)),
    ]
    lead = (
        f"What the identified parameters say of the controller in "
        f"{text.plural(len(band.positions), 'position')}, with {band.level:.0%} intervals of what "
        f"they leave open ({margins.spread}); errors of the model are not in them."
    )
    banner, kicker = bands_banner(band.level, trust), "What this means for the controller"
    write_text(path, page(name, "margins", kicker, lead, sections, banner))


def worst_table(margins: ControllerMargins) -> Table:
    """Return the worst of each motor over the positions."""
    columns = [
        Column("motor"),
        *(Column(title) for title in ("gain margin", "phase margin [°]", "peak of |S|")),
        *(Column(title) for title in ("at [Hz]", "bandwidth [Hz]")),
    ]
    caption = "Worst over the positions; in brackets what the intervals allow; –: no limit."
    return table("worst", caption, columns, worst_rows(margins))


def position_table(margins: ControllerMargins) -> Table:
    """Return stability of each position."""
    band = margins.band
    rows = [
        (
            Number(f"{i + 1}", i + 1.0),
            number_cell(float(band.nominal.largest_sensitivity[i]), text.significant, 3),
            margins.motors[int(np.argmax(band.nominal.peak_sensitivity[i]))],
            Number(f"{band.unstable[i]} of {band.draws}", float(band.unstable[i])),
            number_cell(float(band.probability_bound[i]), text.percent),
        )
        for i in range(len(band.positions))
    ]
    columns = [
        *numbers("position", "largest singular value of S"),
        Column("motor of the highest peak"),
        *numbers("unstable draws", "probability at most"),
    ]
    caption = "Position by position; the probability of instability is at most the last, with 95 %."
    return table("by-position", caption, columns, rows)
