"""Validation: how well the fit predicts frequency responses of other positions."""

import numpy as np

from estimators.validation.held_out_positions import Validation
from oed.study.results import StudyResults
from oed.study.stages.validation import HeldOut
from reports import text
from reports.figures import study_figures
from reports.page_elements import (
    Column,
    Number,
    Row,
    Section,
    Table,
    figure,
    filled,
    numbers,
    percent_cell,
    table,
)
from reports.sections.plan_labels import data_words, prismatic


def section(results: StudyResults) -> Section | None:
    """Return the section; None without validation positions."""
    validation = results.validation
    if validation is None:
        return None
    body = filled(
        "validation.html.j2",
        validation=validation,
        measured=results.measured,
        data=data_words(results),
        count=len(validation.estimate.positions),
        judged=judged_table(validation),
        positions=position_table(results, validation),
        calibration=figure(
            "calibration",
            study_figures.calibration(
                validation.theorem1.levels,
                (validation.theorem1.coverage,),
                ("Theorem 1",),
            ),
            "Share of measured elements inside their predicted regions, against the nominal share",
        ),
    )
    return Section("validation", "Validation", body)


def judged_table(validation: HeldOut) -> Table:
    """Return misfit, its probability and coverage."""
    rows: list[Row] = []
    for name, one in (("Theorem 1", validation.theorem1),):
        at, covered = _highest(one), one.coverage
        rows.append(
            [
                name,
                Number(text.significant(one.misfit), one.misfit),
                Number(text.probability(one.probability), one.probability),
                percent_cell(float(covered[at])),
                str(one).split(";")[0],
            ]
        )
    level = text.percent(float(validation.theorem1.levels[_highest(validation.theorem1)]))
    columns = [
        Column("covariance"),
        *numbers("misfit per datum", "p-value", f"inside {level} regions [%]"),
        Column("verdict", "words"),
    ]
    caption = "Predictions with the covariance of the parameters and of the noise."
    return table("validation-table", caption, columns, rows)


def position_table(results: StudyResults, validation: HeldOut) -> Table:
    """Return the coverage in each validation position."""
    straight = prismatic(results)
    rows: list[Row] = []
    at = _highest(validation.theorem1)
    for q, position in enumerate(validation.estimate.positions):
        angles = ", ".join(text.format_position(position, straight))
        share = float(validation.theorem1.by_position[q, at])
        rows.append([angles, percent_cell(share)])
    level = text.percent(float(validation.theorem1.levels[at]))
    caption = f"Elements inside their {level} regions, position by position."
    columns = [Column("position"), *numbers("inside [%]")]
    return table("held-out", caption, columns, rows)


def _highest(one: Validation) -> int:
    return int(np.argmax(one.levels))
