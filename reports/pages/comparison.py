"""Several studies side by side: a page, one screen of text, JSON."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from oed.study.results import StudyResults
from reports import text
from reports.figures import uncertainty_figures
from reports.page_elements import (
    Cell,
    Column,
    Number,
    Row,
    Section,
    Table,
    figure,
    filled,
    number_cell,
    numbers,
    page,
    table,
)
from reports.sections.verdict import discredited
from reports.summaries import columns
from reports.summaries.study_summary import study_json
from robotmodels.common.arrays import Array
from robotmodels.common.atomic_files import write_text

Studies = Mapping[str, StudyResults]


def write_comparison(studies: Studies, path: Path) -> None:
    """Write a page that compares studies, by name."""
    content = page(
        title=text.listed(list(studies)),
        kind="studies side by side",
        kicker="Experiment design and uncertainty for elastic robots",
        lead="What differs between these studies, and how certain each makes the parameters.",
        sections=[
            _section("overview", "Overview", overview=overview_table(studies)),
            _section("settings", "Settings", settings=settings_table(studies)),
            _section(
                "certainty",
                "Certainty",
                stds=std_table(studies),
                dots=figure(
                    "stds",
                    uncertainty_figures.deviations(
                        all_names(studies), std_rows(studies), list(studies)
                    ),
                    "Relative standard deviation of every parameter, a dot per study",
                ),
            ),
            *estimates(studies),
        ],
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, content)


def estimates(studies: Studies) -> list[Section]:
    """Return the section that compares estimates; none of different robots."""
    if len({r.robot.name for r in studies.values()}) > 1:
        return []
    first = next(iter(studies))
    forest = figure(
        "forest",
        uncertainty_figures.intervals(
            all_names(studies), _offsets(studies), std_rows(studies), list(studies), first
        ),
        "Estimates of every study against those of the first",
    )
    return [_section("estimates", "Estimates", first=first, forest=forest)]


def all_names(studies: Studies) -> list[str]:
    """Return the parameters of all studies: stiffnesses first, as robots have them."""
    return list(
        dict.fromkeys(name for r in studies.values() for name in r.fits.result.parameters.names)
    )


def std_rows(studies: Studies) -> list[Array]:
    """Return the recommended standard deviations of ln theta, (p,) per study; NaN for none."""
    return [_aligned(studies, r, r.trust.std) for r in studies.values()]


def struck_rows(studies: Studies) -> list[dict[str, str]]:
    """Return why a study's number of a parameter must not be quoted, by name."""
    return [{one.name: discredited(one) for one in r.trust.intervals} for r in studies.values()]


def overview_table(studies: Studies) -> Table:
    """Return the key figures of the studies, a row each."""
    rows: list[Row] = []
    for name, r in studies.items():
        plan, fit = r.plan_summary, r.fit_summary
        values: list[Cell] = [
            *(_count(v) for v in (plan.candidates, plan.positions, plan.experiments, plan.runs)),
            Number(text.efficiency(plan.efficiency), plan.efficiency),
            Number(text.significant(fit.residual_ratio, 3), fit.residual_ratio),
            *(number_cell(v) for v in fit.spread),
        ]
        rows.append([name, r.robot.name, str(r.trust.verdict), *values])
    titles = [
        "candidates",
        "positions",
        "experiments",
        "runs",
        "efficiency",
        "residuals over expected",
    ]
    columns_ = [
        Column("study"),
        Column("robot"),
        Column("verdict"),
        *numbers(*titles, "least std", "mean std", "largest std"),
    ]
    caption = (
        "Key figures; standard deviations are relative, the recommended ones of the parameters "
        "that have an interval, their mean is geometric."
    )
    return table("overview-table", caption, columns_, rows)


def settings_table(studies: Studies) -> Table:
    """Return the settings in which the studies differ."""
    flat = [settings_of(r.study.model_dump(mode="json", by_alias=True)) for r in studies.values()]
    keys = dict.fromkeys(key for one in flat for key in one)
    rows: list[Row] = []
    for key in keys:
        values = [one.get(key, "–") for one in flat]
        if len(set(values)) > 1 and key != "output":
            rows.append([key, *values])
    header = [Column("setting", code=True), *(Column(name, "words") for name in studies)]
    return table("settings-table", "Settings in which the studies differ.", header, rows)


def std_table(studies: Studies) -> Table:
    """Return the standard deviations, and those of later studies over the first's."""
    stds, struck, rows = std_rows(studies), struck_rows(studies), []
    for i, name in enumerate(all_names(studies)):
        row: list[Cell] = [
            name,
            *(
                number_cell(float(s[i]), struck=why.get(name, ""))
                for s, why in zip(stds, struck, strict=True)
            ),
        ]
        row += [number_cell(float(std[i] / stds[0][i]), text.significant) for std in stds[1:]]
        rows.append(row)
    first, *others = studies
    header = [
        Column("parameter", code=True),
        *numbers(*studies, *(f"{other} / {first}" for other in others)),
    ]
    caption = "Recommended relative standard deviations, and their ratios."
    return table("std-table", caption, header, rows)


def comparison_summary(studies: Studies, path: Path) -> str:
    """Return the comparison as a table for a terminal."""
    rows = [
        (
            name,
            str(r.plan_summary.positions),
            str(r.plan_summary.experiments),
            str(r.plan_summary.runs),
            *(columns.plain(number_cell(v).text).replace("–", "-") for v in r.fit_summary.spread),
            str(r.trust.verdict),
        )
        for name, r in studies.items()
    ]
    header = (
        "studies", "posi-\ntions", "experi-\nments", "runs", "least\nstd", "mean\nstd",
        "largest\nstd", "verdict",
    )  # fmt: skip
    lines = columns.table(header, rows, right=(1, 2, 3, 4, 5, 6))
    return "\n".join([*lines, f"  report   {path}"])


def comparison_json(studies: Studies, path: Path) -> dict[str, Any]:
    """Return the comparison for scripts."""
    return {
        "studies": {name: study_json(r, []) for name, r in studies.items()},
        "files": [str(path)],
    }


def _section(id: str, title: str, **contents: object) -> Section:
    return Section(id, title, filled(f"comparison_{id}.html.j2", **contents))


def _aligned(studies: Studies, results: StudyResults, values: Array) -> Array:
    """Return values of a study's parameters in the order of all, NaN where it has none."""
    value_of = dict(zip(results.fits.result.parameters.names, values, strict=True))
    return np.array([value_of.get(name, np.nan) for name in all_names(studies)])


def _offsets(studies: Studies) -> list[Array]:
    """Return ln theta of every study less the first's."""
    logs = [_aligned(studies, r, np.log(r.fits.result.parameters.values)) for r in studies.values()]
    return [one - logs[0] for one in logs]


def settings_of(content: Any, prefix: str = "") -> dict[str, str]:
    """Return the settings of a study in words, by keys such as ``fit.starts``."""
    if not isinstance(content, dict):
        return {prefix: "–" if content is None else str(content)}
    settings: dict[str, str] = {}
    for key, value in content.items():
        settings |= settings_of(value, f"{prefix}.{key}" if prefix else key)
    return settings


def _count(value: int) -> Number:
    return Number(text.count(value), value)
