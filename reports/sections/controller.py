"""The controller: margins of each motor with bands, and stability of all loops at once."""

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from estimators.validation.controller_margins import ControllerMargins
from estimators.validation.margin_bands import Suggestion
from oed.study.results import StudyResults
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
    percent_cell,
    table,
)
from reports.sections.tool import bands_words
from robotmodels import DeterminantLocus


def section(results: StudyResults) -> Section | None:
    """Return the section; None where the study names no controller, or without a covariance."""
    if results.uncertainty.theorem1 is None or results.controller is None:
        return None
    body = loops_body(results.controller) + stability_body(results.controller)
    return Section("controller", "Controller", body + bands_words(results))


def loops_body(margins: ControllerMargins) -> Markup:
    """Return margins of each motor as tables and a figure."""
    alt = "Gain margin, phase margin and peak of the sensitivity of each motor in each position"
    drawing = figure("margins", margins_by_motor(margins.band, margins.motors), alt, wide=True)
    return filled(
        "margins.html.j2",
        worst=worst_table(margins),
        drawing=drawing,
        positions=position_table(margins),
        draws=margins.band.draws,
    )


def stability_body(margins: ControllerMargins) -> Markup:
    """Return the Nyquist curve of all loops in the weakest position, and what it says."""
    locus = margins.loci[margins.weakest]
    alt = "Curve of det(1 + F G) about the origin over all frequencies"
    curve = figure("determinant", determinant_curve(locus), alt)
    words = text.sentence(locus_words(locus, margins.weakest))
    return filled("margins_stability.html.j2", curve=curve, words=words)


def worst_rows(margins: ControllerMargins) -> list[tuple[str, ...]]:
    """Return the worst of each motor over the positions, in brackets what intervals allow."""
    rows, band, nominal = list[tuple[str, ...]](), margins.band, margins.band.nominal
    for i, motor in enumerate(margins.motors):
        gains = (text.significant(m.gain_margin[:, i].min(), 3) for m in (nominal, band.lower))
        phases = (np.rad2deg(m.phase_margin[:, i].min()) for m in (nominal, band.lower))
        peaks = (text.significant(m.peak_sensitivity[:, i].max(), 3) for m in (nominal, band.upper))
        worst = int(np.argmax(nominal.peak_sensitivity[:, i]))
        rows.append(
            (
                motor,
                "{} ({})".format(*gains),
                "{:.1f} ({:.1f})".format(*phases),
                "{} ({})".format(*peaks),
                text.significant(nominal.peak_frequency[worst, i] / (2 * np.pi), 3),
                text.significant(nominal.bandwidth[:, i].min() / (2 * np.pi), 3),
            )
        )
    return rows


def worst_table(margins: ControllerMargins) -> Table:
    """Return the worst of each motor over the positions."""
    columns = [
        Column("motor"),
        *(Column(title) for title in ("gain margin [–]", "phase margin [°]", "peak of |S| [–]")),
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
            percent_cell(float(band.probability_bound[i])),
        )
        for i in range(len(band.positions))
    ]
    columns = [
        *numbers("position", "largest singular value of S"),
        Column("motor of the highest peak"),
        *numbers("unstable draws", "probability at most [%]"),
    ]
    caption = "Position by position; the probability of instability is at most the last, with 95 %."
    return table("by-position", caption, columns, rows)


def locus_words(locus: DeterminantLocus, position: int) -> str:
    """Return what the Nyquist curve of all loops says."""
    count = abs(locus.encirclements)
    times = "once" if count == 1 else f"{count} times"
    sense = "counter-clockwise" if locus.encirclements > 0 else "clockwise"
    turns = f"encircles the origin {times} {sense}" if count else "does not encircle the origin"
    return (
        f"det(1 + F G) in position {position + 1}, the weakest, {turns}, "
        f"with {text.plural(locus.open_unstable, 'unstable open-loop pole')}: "
        f"{'stable' if locus.stable else text.plural(locus.unstable, 'unstable pole')}"
    )


def remedy_words(remedy: Suggestion, motors: Sequence[str]) -> str:
    """Return a suggestion in words."""
    what = f"{remedy.gain:g} times its gain"
    if remedy.notch is not None:
        hertz = remedy.notch.frequency / (2 * np.pi)
        what = f"a notch at {text.significant(hertz, 3)} Hz, damping {remedy.notch.zeros:g}"
        what += f" over {remedy.notch.poles:g}"
    change = f"from {text.significant(remedy.before, 3)} to {text.significant(remedy.after, 3)}"
    return f"{motors[remedy.motor]}: {what} takes its worst peak of S {change}"
