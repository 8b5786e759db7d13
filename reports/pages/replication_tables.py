"""Tables that put the numbers of [WM] beside a study's."""

import numpy as np

from oed.replication.local_minima import SEARCHED, LocalMinima
from oed.replication.paper import (
    ALL_SPRINGS,
    REASONABLE_BY_COST,
    REASONABLE_BY_SPRINGS,
    TABLE_1 as PAPER_TABLE,
)
from oed.replication.replicate import Replication
from oed.replication.time_domain_comparison import TimeDomainComparison
from oed.study.settings.study_file import ESTIMATORS
from reports import text
from reports.page_elements import Cell, Column, Number, Table, in_unit, numbers, percent_cell, table
from robotmodels.common.arrays import Array

_METHODS = {"frequency domain": "FRFs, LLS", "prediction error": "predictions"}
_STATISTICS = ("min", "median", "max", "mean", "std", "std_th")


def shares(replication: Replication) -> Table:
    """Return the percentages of reasonable models."""
    other = replication.as_published
    studies = [replication] if other is None else [replication, other]
    criteria: list[tuple[str, list[dict[str, float]], dict[str, float]]] = [
        ("cost < 1.5", [one.by_cost for one in studies], REASONABLE_BY_COST),
        ("springs but one", [one.by_springs for one in studies], REASONABLE_BY_SPRINGS),
        ("all springs", [one.by_all_springs for one in studies], {"LLS15U": ALL_SPRINGS}),
    ]
    rows = [
        (
            name,
            criterion,
            *(_share(parts[name]) for parts in ours),
            _share(paper[name]) if name in paper else "–",
        )
        for criterion, ours, paper in criteria
        for name in ESTIMATORS
    ]
    headings = ["this study", *([] if other is None else ["as published"]), "paper"]
    columns = [
        Column("estimator"),
        Column("reasonable by"),
        *in_unit("%", *headings),
    ]
    caption = (
        "Reasonable models: those with a normalised cost below 1.5, and those whose springs lie "
        f"within half and twice the best model's (without {replication.hardest}, and all)."
        + ("" if other is None else " As published: this robot with the paper's choices.")
    )
    return table("reasonable", caption, columns, rows)


def table_1(replication: Replication, z_scores: Array) -> Table:
    """Return the statistics of the best models."""
    t = replication.table
    rows: list[list[Cell]] = []
    statistics = (t.minimum, t.median, t.maximum, t.mean, t.std, t.theory)
    for i, name in enumerate(t.names):
        row: list[Cell] = [name, *(_number(float(values[i])) for values in statistics)]
        row += [_number(float(t.std[i] / t.theory[i])), _number(float(z_scores[i]))]
        rows.append(row)
    caption = (
        f"The best {t.count} LLS15U models over the very best; its standard deviations by Theorem "
        "1, std_th; their ratio; and the very best model's error over the standard deviation, "
        "where the truth is known."
    )
    columns = [Column("parameter", code=True), *numbers(*_STATISTICS, "ratio", "error")]
    return table("table-1", caption, columns, rows)


def paper_table_1() -> Table:
    """Return Table 1 as printed."""
    rows = [
        (name, *(_number(value) for value in values), _number(values[4] / values[5]))
        for name, values in PAPER_TABLE.items()
    ]
    caption = "Table 1 of the paper: springs k and dampers c of an ABB IRB6600, from measurements."
    columns = [Column("parameter"), *numbers(*_STATISTICS, "ratio")]
    return table("paper-table-1", caption, columns, rows)


def time_domain(comparison: TimeDomainComparison) -> Table:
    """Return what fits in time and fits of FRFs came to from the same starts."""
    rows = [
        (
            f"within {text.significant(10**way.decades, 2)} times",
            _METHODS.get(way.name, way.name),
            Number(f"{way.successes} of {way.starts}", way.successes / way.starts),
            _percentage(way.spring_error),
            _percentage(way.damper_error),
            Number(text.significant(way.seconds, 2), way.seconds),
            Number(str(way.unfinished), way.unfinished),
        )
        for way in comparison.ways
    ]
    columns = [
        Column("starts"),
        Column("fit"),
        *numbers("success", "springs [%]", "dampers [%]", "time [s]", "given up"),
    ]
    caption = (
        "Success: all springs within 5 % of the truth. Springs, dampers: median error of the "
        "successes, or of all fits where none succeeded. Time: per start."
    )
    return table("time-domain-table", caption, columns, rows)


def minima(minima: LocalMinima) -> Table:
    """Return how often searches of more or less excitation end in the best minimum."""
    most = max(one.seconds for one in minima.excitations)
    rows = [
        (
            Number(text.significant(one.amplitude, 2), one.amplitude),
            Number(str(one.blocks), one.blocks),
            _percentage(np.log1p(one.amplitude**2 * one.seconds / most)),
            Number(text.significant(one.seconds / 60, 2), one.seconds / 60),
            *(_share(search.reached) for search in one.searches),
            *(_percentage(search.error) for search in one.searches),
        )
        for one in minima.excitations
    ]
    headings = [f"{name[:3]} {what} [%]" for what in ("best", "error") for name in SEARCHED]
    columns = numbers("amplitude", "blocks", "energy [%]", "time [min]", *headings)
    caption = (
        "Best: starts that end in the best minimum. Error: median of its springs whose truth is "
        "known. LLS with user-defined, NLS with optimal weights."
    )
    return table("minima-table", caption, columns, rows)


def _percentage(error: float) -> Number:
    """Return exp(error) - 1 for people."""
    return percent_cell(float(np.expm1(error)))


def _share(value: float) -> Number:
    return Number(text.fixed(100 * value, 0), 100 * value)


def _number(value: float) -> Cell:
    return Number(text.significant(value, 3), value) if np.isfinite(value) else "–"
