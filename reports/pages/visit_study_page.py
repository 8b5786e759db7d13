"""The page of a study of visits: minutes, predicted accuracy, which motor shakes on which line."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from oed.visit_study.run_visit_study import VisitStudyResults
from oed.visit_study.visit_problem import StudyVisit
from reports import text
from reports.figures.visit_study_figures import deviations_over_minutes, motors_on_lines
from reports.page_elements import (
    Column,
    Figure,
    Number,
    Row,
    Section,
    Table,
    figure,
    filled,
    in_unit,
    numbers,
    page,
    page_banner,
    percent_cell,
    table,
)
from reports.summaries.visit_study_summary import predicted_words, spectra_words
from robotmodels.common.atomic_files import write_text


def write_visit_study_page(results: VisitStudyResults, path: Path, command: str = "") -> None:
    """Write the results of a study of visits as one HTML file that needs nothing else."""
    minutes = text.duration(float(results.seconds.sum()))
    visits = text.plural(len(results.visits), "visit")
    missed = bool((results.overall_std > results.targets).any())
    banner = page_banner(
        "Targets out of reach" if missed else f"{visits} in {minutes}",
        "doubtful" if missed else "sound",
        text.sentence(predicted_words(results)),
        next_step="run the visits in their order, with the files of the folder visits",
    )
    write_text(
        path,
        page(
            title=results.robot.name,
            kind="visits",
            kicker="Visits of an elastic robot",
            lead="Which visits to run, how long they take, how certain they make each parameter.",
            sections=[_visits(results), _accuracy(results), _spectra(results), _files(command)],
            banner=banner,
        ),
    )


def _visits(results: VisitStudyResults) -> Section:
    body = filled(
        "visit_study_visits.html.j2",
        choice=str(results.table),
        efficiency=text.efficiency(results.plan.efficiency),
        visits=visit_table(results),
    )
    return Section("visits", "Visits", body)


def visit_table(results: VisitStudyResults) -> Table:
    """Return the visits in order: where, what, how long, from which minute on."""
    starts = np.cumsum(results.seconds) - results.seconds
    robot = results.robot
    prismatic = [joint in robot.elements.prismatic for joint in robot.motor_joints]
    rows: list[Row] = []
    for i, (one, seconds) in enumerate(zip(results.visits, results.seconds, strict=True)):
        rows.append(
            (
                Number(str(i + 1), i + 1),
                ", ".join(text.format_position(one.plan.positions[0], prismatic)),
                one.excitation,
                *(Number(str(n), n) for n in (one.plan.runs, one.plan.periods)),
                _minutes(starts[i]),
                _minutes(seconds),
            )
        )
    columns = [
        *numbers("visit"),
        Column("position"),
        Column("excitation"),
        *numbers("runs", "periods", "begins at [min]", "takes [min]"),
    ]
    caption = "Visits in order. Their time has the move, settling, transients and all periods."
    return table("visit-table", caption, columns, rows)


def _minutes(seconds: float) -> Number:
    return Number(text.fixed(seconds / 60, 1), seconds / 60)


def _accuracy(results: VisitStudyResults) -> Section:
    targeted = ~np.isnan(results.targets)
    shown = targeted if targeted.any() else np.ones_like(targeted)
    names = [name for name, one in zip(results.names, shown, strict=True) if one]
    std = results.curve.std[:, shown]
    ylabel = "relative standard deviation"
    if targeted.any():
        std, ylabel = std / results.targets[shown], "standard deviation / target"
    drawing = deviations_over_minutes(results.curve.times, std, names, ylabel)
    alt = "Standard deviations of all parameters in falling lines over the robot time"
    body = filled(
        "visit_study_accuracy.html.j2",
        samples=len(results.std),
        curve=figure("minutes", drawing, alt),
        accuracy=accuracy_table(results),
    )
    return Section("accuracy", "Accuracy", body)


def accuracy_table(results: VisitStudyResults) -> Table:
    """Return the standard deviations predicted for the visits, beside the targets."""
    columns = {"expected": results.std[0]}
    if len(results.std) > 1:
        columns["worst sample"] = results.std.max(axis=0)
    if not np.isnan(results.targets).all():
        columns["target"] = results.targets
    rows: list[Row] = [
        (name, *(percent_cell(float(one)) for one in values))
        for name, *values in zip(results.names, *columns.values(), strict=True)
    ]
    caption = "Relative standard deviations after these visits, by the model."
    heads = [Column("parameter", code=True), *in_unit("%", *columns)]
    return table("accuracy-table", caption, heads, rows)


def _spectra(results: VisitStudyResults) -> Section:
    motors = results.robot.motor_names
    panels: list[Figure] = []
    for label, one in distinct(results.visits).items():
        drawing = motors_on_lines(results.omega, one.spectrum / one.plan.runs, motors)
        alt = f"Root mean square torque of every line, a row for each motor, in {label}"
        panels.append(figure(f"lines-{len(panels) + 1}", drawing, alt, label=label))
    body = filled(
        "visit_study_spectra.html.j2", panels=panels, words=text.typeset(spectra_words(results))
    )
    return Section("spectra", "Spectra", body)


def distinct(visits: Sequence[StudyVisit]) -> dict[str, StudyVisit]:
    """Return a visit of each excitation and position, by its label."""
    first: dict[tuple[object, ...], int] = {}
    for i, one in enumerate(visits):
        first.setdefault((one.excitation, one.plan.positions.tobytes()), i)
    return {f"visit {i + 1}, {visits[i].excitation}": visits[i] for i in first.values()}


def _files(command: str) -> Section:
    return Section("files", "Files", filled("visit_study_files.html.j2", command=command))
