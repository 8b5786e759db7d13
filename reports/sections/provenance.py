"""Provenance: from what the results were computed, with what, and how to do it again."""

from oed.study import StudyResults
from reports import text
from reports.parts import Column, Number, Section, numbers, table
from reports.template import filled


def section(results: StudyResults) -> Section:
    """Return the section."""
    seconds = [(stage, Number(text.duration(s), s)) for stage, s in results.seconds.items()]
    versions = list(results.versions.items())
    body = filled(
        "provenance.html.j2",
        results=results,
        stages=table("stages", "Time per stage.", [Column("stage"), *numbers("time")], seconds),
        versions=table("versions", "Versions.", [Column("of"), *numbers("version")], versions),
    )
    return Section("provenance", "Provenance", body)
