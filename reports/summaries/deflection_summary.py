"""What a fit of deflections says at the end: one screen, and the same as JSON."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from estimators.deflection.fit_deflection import DeflectionFit
from estimators.trust.intervals import Interval, interval_document
from reports import text
from reports.sections.verdict import interval_words
from reports.summaries.columns import described, plain
from robotmodels.common.plain_data import json_data


def deflection_summary(
    fit: DeflectionFit, shares: Sequence[Mapping[str, float]], written: Sequence[Path]
) -> str:
    """Return intervals, systematic terms, what is missing and what is explained, for people."""
    lines = [
        (one.name, plain(f"{_value(one)} {unit_of(one.name)}. {one.verdict.reason}"))
        for one in fit.intervals()
    ]
    for term, shifts in fit.systematic_shifts().items():
        sizes = ", ".join(f"{name} {shift:+.1%}" for name, shift in shifts.items())
        lines.append(("if otherwise", f"{term}: {sizes}"))
    lines += [("MISSING", flag.sentence) for flag in fit.flags]
    for i, share in enumerate(shares, start=1):
        words = ", ".join(f"{name} {value:.0%}" for name, value in share.items())
        lines.append(("explained", f"of other movement {i}: {words}"))
    lines += [("written", str(path)) for path in written]
    return "\n".join([fit.start.name, *described(lines)])


def _value(one: Interval) -> str:
    """Return estimate and interval, or the verdict."""
    if not one.verdict.gives_interval:
        return f"{one.verdict}, –"
    return f"{text.significant(one.value, 4)}, 95 %: {interval_words(one)}"


def unit_of(name: str) -> str:
    """Return the unit of a parameter of such a fit."""
    units = {"stiffness": "N m/rad", "delay": "s", "mass": "kg", "coulomb": "N m"}
    entry = name.split(".")[1].split(" ")[0]
    return units.get(entry, "N m s/rad")


def deflection_json(fit: DeflectionFit, shares: Sequence[Mapping[str, float]]) -> dict[str, object]:
    """Return the same for programs, SI units."""
    return {
        "schema": "deflection/1",
        "verdict": str(fit.verdict),
        "reason": fit.verdict.reason,
        "intervals": [interval_document(one) for one in fit.intervals()],
        "systematic": fit.systematic_shifts(),
        "missing": [json_data(term) for term in fit.missing],
        "explained": list(shares),
    }
