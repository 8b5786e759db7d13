"""What ``oed import`` says, and the mapping that it proposes, as text."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from estimators.logs.proposal import Proposal
from reports.summaries.columns import hung
from robotmodels.logs.importer import Import
from robotmodels.logs.mapping_file import Mapping

_MOST_NAMED = 8


def mapping_text(
    mapping: Mapping, evidence: Sequence[str], source: str, unmapped: Sequence[str] = ()
) -> str:
    """Return a mapping file with what each of its entries rests on.

    Parameters
    ----------
    evidence : sequence of str
        One for each signal.
    source : str
        Name of the log.
    unmapped : sequence of str
        Channels that no entry is about.
    """
    content = mapping.model_dump(mode="json", by_alias=True, exclude_defaults=True)
    signals = content.pop("signals")
    lines = [f"# Proposed from {source}: correct what is wrong, then import with --mapping."]
    lines += [f"{key}: {json.dumps(value, ensure_ascii=False)}" for key, value in content.items()]
    lines.append("signals:")
    for signal, reason in zip(signals, evidence, strict=True):
        entries = ", ".join(f"{k}: {json.dumps(v, ensure_ascii=False)}" for k, v in signal.items())
        lines += [f"  # {reason}", f"  - {{{entries}}}"]
    lines += [f"# not mapped: {json.dumps(name, ensure_ascii=False)}" for name in unmapped]
    return "\n".join(lines) + "\n"


def proposal_summary(proposal: Proposal, files: Sequence[Path]) -> str:
    """Return what was proposed, entry by entry, one screen."""
    lines = ["proposed mapping; nothing was converted"]
    for entry in proposal.entries:
        signal = entry.signal
        meaning = "left out" if signal is None else f"{signal.role} [{signal.unit}]"
        side = f", {signal.side} side" if signal is not None and signal.side else ""
        lines += hung("  ", f"{entry.family.pattern}: {meaning}{side}; {entry.evidence}")
    for finding in proposal.findings:
        lines += hung("  - ", finding)
    if proposal.unmapped:
        names, more = proposal.unmapped[:_MOST_NAMED], len(proposal.unmapped) - _MOST_NAMED
        end = f" and {more} more, listed in import.yaml" if more > 0 else ""
        lines += hung("  - ", f"not mapped: {', '.join(names)}{end}")
    lines += [f"  written  {path}" for path in files]
    return "\n".join(lines)


def import_summary(source: Import, derived: Sequence[str], files: Sequence[Path]) -> str:
    """Return what was imported."""
    lines = [source.log.where]
    for number, run in enumerate(source.runs):
        seconds = len(run) * run.sample_time
        lines.append(
            f"  run {number + 1}: {len(run)} samples every {1e3 * run.sample_time:.6g} ms, "
            f"{seconds:.4g} s, from {run.start:.6g} s"
        )
    lines.append(f"  signals  {', '.join([*source.roles, *source.others])}")
    for note in (*derived, *source.notes):
        lines += hung("  - ", note)
    lines += [f"  written  {path}" for path in files]
    return "\n".join(lines)


def proposal_json(proposal: Proposal, files: Sequence[Path]) -> dict[str, Any]:
    """Return the proposal for scripts."""
    return {
        "mapping": proposal.mapping.model_dump(mode="json", by_alias=True, exclude_defaults=True),
        "entries": [
            {
                "channels": list(entry.family.channels),
                "role": entry.family.role,
                "used": entry.signal is not None,
                "evidence": entry.evidence,
                "relations": [
                    None
                    if relation is None or not relation.determined
                    else {
                        "factor": 1 / relation.factor,
                        "lag": relation.lag,
                        "lag_std": relation.lag_std,
                        "unexplained": relation.unexplained,
                    }
                    for relation in entry.relations
                ],
            }
            for entry in proposal.entries
        ],
        "findings": list(proposal.findings),
        "unmapped": list(proposal.unmapped),
        "files": [str(path) for path in files],
    }


def import_json(source: Import, derived: Sequence[str], files: Sequence[Path]) -> dict[str, Any]:
    """Return what was imported for scripts, in SI units."""
    return {
        "runs": [
            {"samples": len(run), "sample_time": run.sample_time, "start": run.start}
            for run in source.runs
        ],
        "joints": list(source.binding.joints),
        "signals": [*source.roles, *source.others],
        "derived": list(derived),
        "notes": list(source.notes),
        "files": [str(path) for path in files],
    }
