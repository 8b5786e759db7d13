"""The cross-check: every method's standard deviations side by side, and a verdict for each."""

import numpy as np

from estimators.uncertainty.cross_check import CrossCheck
from reports import text
from reports.parts import Cell, Column, Number, Section, Table, numbers, table
from reports.template import filled


def section(found: CrossCheck) -> Section:
    """Return the section."""
    verdicts = {v: found.verdicts.count(v) for v in dict.fromkeys(found.verdicts)}
    body = filled("cross_check.html.j2", found=found, verdicts=verdicts, stds=verdict_table(found))
    return Section("cross-check", "Cross-check", body)


def verdict_table(found: CrossCheck) -> Table:
    """Return standard deviations by every method, the verdict and what led to it."""
    explained = any(found.evidence)
    rows = []
    for i, name in enumerate(found.names):
        row: list[Cell] = [name]
        row += [_number(float(std)) for std in found.stds[:, i]]
        row.append(found.verdicts[i])
        rows.append([*row, "; ".join(found.evidence[i])] if explained else row)
    columns = [
        Column("parameter", code=True),
        *numbers(*found.methods),
        Column("verdict"),
        *([Column("because", "words")] if explained else []),
    ]
    return table("cross-check-table", "Relative standard deviations by method.", columns, rows)


def _number(std: float) -> Number:
    return Number(text.percent(std) if np.isfinite(std) else "–", std)
