"""Several studies side by side: a page, one screen of text, JSON."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from estimators.uncertainty.estimate_differences import Differences, estimate_differences
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
    in_unit,
    number_cell,
    numbers,
    page,
    page_banner,
    percent_cell,
    table,
)
from reports.sections import shared_responses
from reports.sections.verdict import KINDS, discredited
from reports.summaries import columns
from reports.summaries.study_summary import study_json
from robotmodels.common.arrays import Array
from robotmodels.common.atomic_files import write_text
from robotmodels.common.plain_data import json_data

FALSE_ALARM = 0.05
"""Probability that any difference of a pair of studies is called significant by chance."""

_RANKS = ("sound", "doubtful", "refused")

Studies = Mapping[str, StudyResults]


def write_comparison(studies: Studies, path: Path) -> None:
    """Write a page that compares studies, by name."""
    differences = pairwise_differences(studies)
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
            *estimates(studies, differences),
            shared_responses.section(studies),
        ],
        banner=comparison_banner(studies, differences),
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, content)


def estimates(studies: Studies, differences: Mapping[str, Differences]) -> list[Section]:
    """Return the section that compares estimates; none of different robots."""
    if not differences:
        return []
    first = next(iter(studies))
    forest = figure(
        "forest",
        uncertainty_figures.intervals(
            all_names(studies), _offsets(studies), std_rows(studies), list(studies), first
        ),
        "Estimates of every study against those of the first",
    )
    tables = [
        difference_table(f"differences-{k}", f"{name} less those of {first}", one)
        for k, (name, one) in enumerate(differences.items(), start=1)
    ]
    return [_section("estimates", "Estimates", first=first, forest=forest, differences=tables)]


def pairwise_differences(studies: Studies) -> dict[str, Differences]:
    """Return the differences of every later study to the first, of studies of one robot."""
    if len({r.robot.name for r in studies.values()}) > 1:
        return {}
    (_, reference), *others = studies.items()
    fits = {name: r.fits.result for name, r in others}
    return {name: estimate_differences(reference.fits.result, fit) for name, fit in fits.items()}


def significant_names(differences: Differences) -> list[str]:
    """Return the parameters that differ, at 5 % over all of them together (Bonferroni)."""
    limit = FALSE_ALARM / max(len(differences.names), 1)
    pairs = zip(differences.names, differences.probabilities, strict=True)
    return [name for name, probability in pairs if probability < limit]


def comparison_banner(studies: Studies, differences: Mapping[str, Differences]) -> Markup:
    """Return which study to quote, and whether the estimates agree."""
    best, reason = recommended(studies)
    if not differences:
        return page_banner("Studies of different robots", "sound", reason)
    differing = {name: significant_names(one) for name, one in differences.items()}
    words = [f"{name}: {text.listed(names)}" for name, names in differing.items() if names]
    if words:
        verdict = f"The estimates differ significantly from those of {next(iter(studies))}"
        step = f"find out why these differ before quoting them: {'; '.join(words)}"
        return page_banner(verdict, "doubtful", reason, next_step=step)
    kind = _kind(studies[best]) if best else "refused"
    step = f"quote {best}" if best else ""
    return page_banner("The estimates agree", kind, reason, next_step=step)


def recommended(studies: Studies) -> tuple[str, str]:
    """Return the study to quote, none if none may be, and why.

    The verdict goes before the standard deviations, which are small too where noise is understated.
    """
    spread = {name: r.fit_summary.spread[1] for name, r in studies.items()}
    quotable = [name for name, value in spread.items() if np.isfinite(value)]
    if not quotable:
        return "", "No study has a standard deviation to quote"
    rank = {name: _RANKS.index(_kind(studies[name])) for name in quotable}
    best = min(quotable, key=lambda name: (rank[name], spread[name]))
    words = f"{best} ({studies[best].trust.verdict}) has a mean standard deviation of "
    words += text.percent(spread[best])
    smaller = [name for name in quotable if spread[name] < spread[best]]
    if not smaller:
        return best, f"{words}, the smallest"
    doubted = [f"{name} ({studies[name].trust.verdict})" for name in smaller]
    return best, f"{words}; smaller ones, of {text.listed(doubted)}, are less trustworthy"


def _kind(results: StudyResults) -> str:
    return KINDS.get(results.trust.verdict, "refused")


def difference_table(id: str, whose: str, one: Differences) -> Table:
    """Return the differences of a study to the first, with their significance."""
    rows: list[Row] = []
    values = zip(one.names, one.values, one.std, one.correlation, one.probabilities, strict=True)
    for parameter, difference, std, correlation, probability in values:
        rows.append(
            (
                parameter,
                percent_cell(float(difference)),
                percent_cell(float(std)),
                number_cell(float(correlation), text.fixed, 2),
                number_cell(float(probability), text.probability),
            )
        )
    columns_ = [
        Column("parameter", code=True),
        *in_unit("%", "difference", "±"),
        *numbers("correlation", "p-value"),
    ]
    caption = (
        f"Logarithms of the estimates of {whose}. Where both use the same "
        "measured frequency responses their errors are correlated, which the standard deviation "
        "allows for; the p-value is two-sided, of one parameter alone."
    )
    return table(id, caption, columns_, rows)


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
            number_cell(100 * plan.efficiency, text.fixed, 2),
            Number(text.significant(fit.residual_ratio, 3), fit.residual_ratio),
            *(percent_cell(v) for v in fit.spread),
        ]
        rows.append([name, r.robot.name, str(r.trust.verdict), *values])
    titles = [
        "candidates",
        "positions",
        "visits",
        "runs",
        "efficiency [%]",
        "residuals over expected",
    ]
    columns_ = [
        Column("study"),
        Column("robot"),
        Column("verdict"),
        *numbers(*titles, "smallest std [%]", "mean std [%]", "largest std [%]"),
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
                percent_cell(float(s[i]), why.get(name, ""))
                for s, why in zip(stds, struck, strict=True)
            ),
        ]
        row += [number_cell(float(std[i] / stds[0][i]), text.significant) for std in stds[1:]]
        rows.append(row)
    first, *others = studies
    header = [
        Column("parameter", code=True),
        *numbers(
            *(f"{study} [%]" for study in studies), *(f"{other} / {first}" for other in others)
        ),
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
            *(columns.plain(text.percent(v)).replace("–", "-") for v in r.fit_summary.spread),
            str(r.trust.verdict),
        )
        for name, r in studies.items()
    ]
    header = (
        "studies", "posi-\ntions", "visits", "runs", "smallest\nstd", "mean\nstd",
        "largest\nstd", "verdict",
    )  # fmt: skip
    lines = columns.table(header, rows, right=(1, 2, 3, 4, 5, 6))
    for name, one in pairwise_differences(studies).items():
        differing = significant_names(one)
        words = f"differs significantly in {text.listed(differing)}" if differing else "agrees"
        lines += columns.wrapped(f"{name} {words} (with {next(iter(studies))})")
    return "\n".join([*lines, f"  report   {path}"])


def comparison_json(studies: Studies, path: Path) -> dict[str, Any]:
    """Return the comparison for scripts."""
    return {
        "studies": {name: study_json(r, []) for name, r in studies.items()},
        "differences": {
            name: json_data(one) for name, one in pairwise_differences(studies).items()
        },
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
