"""The page of ``oed import``: what was understood of a log, as a table and a picture."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from markupsafe import Markup

from estimators.logs.search import Entry
from reports import text
from reports.figures.import_figures import signal_panels
from reports.page_elements import (
    Cell,
    Column,
    Number,
    Section,
    Table,
    figure,
    filled,
    numbers,
    page,
    page_banner,
    table,
)
from robotmodels.common.arrays import Array
from robotmodels.common.atomic_files import write_text
from robotmodels.logs.importer import Import
from robotmodels.logs.units import SI

_POINTS = 800


def write_import_page(
    source: Import, entries: Sequence[Entry], findings: Sequence[str], path: Path
) -> None:
    """Write what was understood of a log as one HTML file that needs nothing else.

    Parameters
    ----------
    entries : sequence of Entry
        Of a proposal, with their evidence; empty where the user's mapping was taken.
    findings : sequence of str
        What else was seen.
    """
    summary = {"proposed": bool(entries), "findings": findings}
    signals = _proposed_table(entries) if entries else _mapped_table(source)
    sections = [
        Section("summary", "Signals", filled("import_summary.html.j2", signals=signals, **summary))
    ]
    if source.roles:
        drawing = figure(
            "signals",
            signal_panels(
                *_thinned(source),
                {role: SI[role][0] for role in source.roles},
                source.binding.joints,
            ),
            "Curves over time of every signal, a panel for each role",
            wide=True,
        )
        body = filled("import_signals.html.j2", drawing=drawing)
        sections.append(Section("curves", "Curves", body))
    write_text(
        path,
        page(
            title=", ".join(file.name for file in source.log.files),
            kind="imported log",
            kicker="A controller's log",
            lead="What its channels mean, in which unit, and what that rests on.",
            sections=sections,
            banner=_banner(bool(entries), findings),
        ),
    )


def _banner(proposed: bool, findings: Sequence[str]) -> Markup:
    """Return whether anything was converted, and what to do next."""
    if proposed:
        step = "correct import.yaml, then import with --mapping import.yaml"
        return page_banner("A proposal: nothing was converted", "doubtful", "", next_step=step)
    kind = "doubtful" if findings else "sound"
    reason = text.sentence(findings[0]) if findings else "SI units, on the joint side of the gears"
    return page_banner("Converted by the mapping", kind, reason)


def _proposed_table(entries: Sequence[Entry]) -> Table:
    columns = [Column(title) for title in ("channels", "role", "unit", "side")]
    rows: list[list[Cell]] = []
    for entry in entries:
        signal = entry.signal
        told = ["left out", "", ""] if signal is None else [signal.role, signal.unit, ""]
        if signal is not None and signal.side:
            told[2] = signal.side
        rows.append([entry.family.pattern, *told, entry.evidence])
    return table("mapping", "Proposed mapping.", [*columns, Column("evidence", "words")], rows)


def _mapped_table(source: Import) -> Table:
    columns = [Column(title) for title in ("channel", "role", "joint", "unit")]
    rows: list[list[Cell]] = [
        [
            signal.channel,
            signal.role,
            signal.name,
            signal.unit,
            Number(f"{signal.factor:.6g}", signal.factor),
        ]
        for signal in source.binding.signals
    ]
    return table("mapping", "Channels as mapped.", [*columns, *numbers("factor to SI")], rows)


def _thinned(source: Import) -> tuple[Array, dict[str, Array]]:
    """Return times and signals of the longest run, at most about `_POINTS` of each."""
    run = max(source.runs, key=len)
    stride = max(1, len(run) // _POINTS)
    signals = {}
    for role in source.roles:
        parts, offset = [], 0
        for piece in run.pieces(role):
            parts.append(piece[(-offset) % stride :: stride].copy())  # a view would keep it all
            offset += len(piece)
        signals[role] = np.concatenate(parts)
    time = run.start + run.sample_time * stride * np.arange(len(next(iter(signals.values()))))
    return np.asarray(time), signals
