"""The cross-check: the recommended standard deviations beside every other method's."""

from estimators.validation.cross_check import CrossCheck
from reports import text
from reports.page_elements import (
    Cell,
    Column,
    Section,
    Table,
    filled,
    in_unit,
    number_cell,
    numbers,
    percent_cell,
    table,
)
from reports.sections.verdict import discredited


def section(check: CrossCheck) -> Section:
    """Return the section."""
    verdicts = {v: check.verdicts.count(v) for v in dict.fromkeys(check.verdicts)}
    body = filled(
        "cross_check.html.j2",
        check=check,
        verdicts=verdicts,
        agreeing=text.listed(list(check.agreeing())),
        stds=verdict_table(check),
    )
    return Section("cross-check", "Cross-check", body)


def verdict_table(check: CrossCheck) -> Table:
    """Return standard deviations by every method, Theorem 1 over emcee, and the verdict."""
    rows = []
    ratio = check.ratio()
    for i, name in enumerate(check.names):
        row: list[Cell] = [name]
        struck = discredited(check.trust.intervals[i])
        row += [percent_cell(float(std), struck) for std in check.stds[:, i]]
        row.append(number_cell(ratio[i], text.fixed, 2))
        rows.append([*row, check.verdicts[i]])
    columns = [
        Column("parameter", code=True),
        *in_unit("%", *check.methods),
        *numbers("Theorem 1 / posterior"),
        Column("verdict"),
    ]
    return table("cross-check-table", "Relative standard deviations by method.", columns, rows)
