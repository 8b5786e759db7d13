"""What could not be computed or shown, and why."""

from collections.abc import Sequence

from oed.study.stage_cache import Failure
from reports import text
from reports.page_elements import Column, Section, filled, table


def section(failures: Sequence[Failure]) -> Section:
    """Return the section."""
    rows = [(one.name, text.sentence(one.reason)) for one in failures]
    columns = [Column("stage"), Column("reason", "words")]
    body = filled(
        "failures.html.j2", failures=table("failures-table", "What failed.", columns, rows)
    )
    return Section("failures", "What failed", body)
