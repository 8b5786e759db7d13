"""The cross-check: every method's standard deviations side by side, and a verdict for each."""

import numpy as np

from estimators.uncertainty.cross_check import CrossCheck
from reports import text
from reports.parts import Cell, Column, Number, Section, Table, numbers, table
from reports.template import filled


def section(found: CrossCheck) -> Section:
    """Return the section."""
    verdicts = {v: found.verdicts.count(v) for v in dict.fromkeys(found.verdicts)}
    body = filled(
        "cross_check.html.j2",
        found=found,
        verdicts=verdicts,
        stds=verdict_table(found),
        shared=text.listed(shared(found)),
        reasons=reason_table(found),
    )
    return Section("cross-check", "Cross-check", body)


def verdict_table(found: CrossCheck) -> Table:
    """Return standard deviations by every method, and the verdict."""
    rows = []
    for i, name in enumerate(found.names):
        row: list[Cell] = [name]
        row += [_number(float(std)) for std in found.stds[:, i]]
        rows.append([*row, found.verdicts[i]])
    columns = [Column("parameter", code=True), *numbers(*found.methods), Column("verdict")]
    return table("cross-check-table", "Relative standard deviations by method.", columns, rows)


def shared(found: CrossCheck) -> list[str]:
    """Return what led to a verdict on every parameter alike."""
    return [why for why in found.evidence[0] if all(why in one for one in found.evidence)]


def reason_table(found: CrossCheck) -> Table | None:
    """Return what else led to each verdict; None where nothing did."""
    alike = shared(found)
    rows = [
        (name, verdict, "; ".join(why for why in evidence if why not in alike))
        for name, verdict, evidence in zip(found.names, found.verdicts, found.evidence, strict=True)
    ]
    if not any(row[-1] for row in rows):
        return None
    columns = [Column("parameter", code=True), Column("verdict"), Column("because", "words")]
    told = [row for row in rows if row[-1]]
    return table("cross-check-reasons", "What led to these verdicts.", columns, told)


def _number(std: float) -> Number:
    return Number(text.percent(std) if np.isfinite(std) else "–", std)
