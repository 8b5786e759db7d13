"""The cross-check: the recommended standard deviations beside every other method's."""

import numpy as np

from estimators.validation.cross_check import CrossCheck
from reports import text
from reports.page_elements import Cell, Column, Number, Section, Table, filled, numbers, table
from reports.sections.verdict import discredited


def section(found: CrossCheck) -> Section:
    """Return the section."""
    verdicts = {v: found.verdicts.count(v) for v in dict.fromkeys(found.verdicts)}
    body = filled(
        "cross_check.html.j2",
        found=found,
        verdicts=verdicts,
        agreeing=text.listed(list(found.agreeing())),
        stds=verdict_table(found),
    )
    return Section("cross-check", "Cross-check", body)


def verdict_table(found: CrossCheck) -> Table:
    """Return standard deviations by every method, Theorem 1 over emcee, and the verdict."""
    rows = []
    ratio = found.ratio()
    for i, name in enumerate(found.names):
        row: list[Cell] = [name]
        struck = discredited(found.trust.intervals[i])
        row += [_number(float(std), struck) for std in found.stds[:, i]]
        row.append(Number(text.fixed(ratio[i], 2) if np.isfinite(ratio[i]) else "–", ratio[i]))
        rows.append([*row, found.verdicts[i]])
    columns = [
        Column("parameter", code=True),
        *numbers(*found.methods, "Theorem 1 / posterior"),
        Column("verdict"),
    ]
    return table("cross-check-table", "Relative standard deviations by method.", columns, rows)


def _number(std: float, struck: str) -> Number:
    return Number(text.percent(std) if np.isfinite(std) else "–", std, struck)
