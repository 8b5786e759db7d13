"""The page of a study of movements: stiffnesses, systematic terms, pictures, tests."""

from pathlib import Path

import numpy as np

from oed.study.deflection_study import DeflectionResults
from reports import text
from reports.figures.deflection_figures import deflections
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
from reports.sections.verdict import KINDS, discredited, interval_words
from reports.summaries.deflection_summary import unit_of
from robotmodels.common.atomic_files import write_text
from robotmodels.common.fingerprints import file_digest


def write_deflection_page(results: DeflectionResults, path: Path, command: str = "") -> None:
    """Write the results of a study of movements as one HTML file that needs nothing else."""
    verdict = results.fit.verdict
    write_text(
        path,
        page(
            title=results.fit.start.name,
            kind="springs from deflection",
            kicker="Springs from encoders on both sides of the gears",
            lead="Gear stiffness, payload and friction identified from slow or ordinary movements.",
            sections=[
                _parameters(results),
                _systematic(results),
                _deflections(results),
                _tests(results),
                _provenance(results, command),
            ],
            banner=page_banner(
                text.sentence(str(verdict)),
                KINDS.get(verdict, "refused"),
                text.typeset(text.sentence(verdict.reason)),
                quote="Intervals include noise and the systematic terms.",
            ),
        ),
    )


def _parameters(results: DeflectionResults) -> Section:
    movements = results.movements
    body = filled(
        "deflection_parameters.html.j2",
        count=len(movements),
        seconds=text.duration(sum(len(m) * m.sample_time for m in movements)),
        parameters=parameter_table(results),
        conditional=results.fit.conditional,
    )
    return Section("parameters", "Parameters", body)


def parameter_table(results: DeflectionResults) -> Table:
    """Return every parameter with its interval, its verdict and what that rests on."""
    rows: list[Row] = []
    for one in results.fit.intervals():
        factor, unit = (1e3, "ms") if ".delay" in one.name else (1.0, unit_of(one.name))
        struck = discredited(one)
        value = factor * one.value
        rows.append(
            (
                one.name,
                Number(_significant(value, 4), value, struck),
                Number(_significant(factor * one.std, 2), factor * one.std, struck),
                interval_words(one, 1 / factor),
                unit,
                str(one.verdict),
                one.verdict.reason,
            )
        )
    columns = [
        Column("parameter", code=True),
        *numbers("estimate", "±", "95 % interval"),
        Column("unit", "u"),
        Column("verdict"),
        Column("reason", "words"),
    ]
    caption = (
        "Estimates with one standard deviation and 95 % interval, systematic terms included. "
        "Numbers not to be quoted are struck out."
    )
    return table("estimates", caption, columns, rows)


def _systematic(results: DeflectionResults) -> Section:
    shifts = results.fit.systematic_shifts()
    names = list(dict.fromkeys(name for each in shifts.values() for name in each))
    rows: list[Row] = [
        (term, *(percent_cell(each.get(name, np.nan)) for name in names))
        for term, each in shifts.items()
    ]
    caption = "Relative change of each result under the alternative assumption."
    shown = table(
        "systematic",
        caption,
        [Column("assumption changed"), *in_unit("%", *names)],
        rows,
    )
    return Section(
        "systematic", "Systematic terms", filled("deflection_systematic.html.j2", shifts=shown)
    )


def _deflections(results: DeflectionResults) -> Section:
    gears = [one for one in results.fit.intervals() if one.name in results.fit.gears]
    fitted = [one.name for one in sorted(gears, key=lambda one: discredited(one) != "")]
    body = filled(
        "deflection_pictures.html.j2",
        panels=[_panel(results, name) for name in fitted],
        least=text.significant(results.fit.at.least_speed, 2),
        low_pass=text.significant(results.fit.at.low_pass, 3),
        explained=share_table(results),
    )
    return Section("deflections", "Deflections", body)


def _panel(results: DeflectionResults, name: str) -> Figure:
    drawing = deflections(results.fit.histories(name))
    alt = f"Link less motor angle over time, measured and fitted, of the gear of {name}"
    return figure(f"deflection-{name.split('.')[0]}", drawing, alt, label=name)


def share_table(results: DeflectionResults) -> Table:
    """Return the shares of the movements' deflections that are explained."""
    kinds = {"fitted": results.fitted_shares, "other": results.shares}
    names = list(dict.fromkeys(name for share in results.fitted_shares for name in share))
    rows: list[Row] = [
        (f"{kind} {i}", *(percent_cell(share.get(name, np.nan)) for name in names))
        for kind, shares in kinds.items()
        for i, share in enumerate(shares, start=1)
    ]
    caption = "Share of the springs’ part of the deflection that is explained."
    return table("explained", caption, [Column("movement"), *in_unit("%", *names)], rows)


def _tests(results: DeflectionResults) -> Section:
    fit = results.fit
    rows: list[Row] = [
        (
            term.motor,
            term.term,
            percent_cell(term.share),
            Number(text.probability(term.p_value), term.p_value),
            "missing" if term.matters else "negligible",
            term.remark,
        )
        for term in sorted(fit.missing, key=lambda term: -term.share)
    ]
    columns = [
        Column("motor"),
        Column("term"),
        *numbers("share [%]", "p-value"),
        Column("verdict"),
        Column("size and meaning", "words"),
    ]
    caption = "Omitted terms, tested in the residuals of the fit."
    body = filled(
        "deflection_tests.html.j2",
        flags=[flag.sentence for flag in fit.flags],
        tests=table("tests", caption, columns, rows) if rows else None,
    )
    return Section("residuals", "Residuals", body)


def _provenance(results: DeflectionResults, command: str) -> Section:
    study = results.study
    files = [study.data.movements]
    files += [] if study.validation is None else [study.validation.movements]
    rows: list[Row] = [(path.name, file_digest(path)) for path in files]
    caption = "What the results depend on, by the SHA-256 of its content."
    inputs = table("inputs", caption, [Column("input"), Column("SHA-256", code=True)], rows)
    body = filled("deflection_provenance.html.j2", command=command, inputs=inputs)
    return Section("provenance", "Provenance", body)


def _significant(value: float, digits: int) -> str:
    return text.significant(value, digits) if np.isfinite(value) else "–"
