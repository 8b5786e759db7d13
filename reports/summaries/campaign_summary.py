"""Campaigns in words: what to do next, what is known how well, which visits to run."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from oed import CampaignStatus, Visit
from oed.campaign.estimate import Estimate
from oed.campaign.outlook import Outlook
from reports import text
from reports.summaries.columns import hung, number, plain, table, vector
from reports.summaries.friction_levels import level_words, levels_json

PURPOSES = {
    "check": "low level",
    "first": "before any fit",
    "accuracy": "for the accuracies",
    "repeat": "the first one again",
}


def headline(status: CampaignStatus) -> str:
    """Return what to do next, or how the campaign ended."""
    if status.open:
        return f"Run {visit_range(status.open)}"
    if not status.ended:
        return "Ask for the next visits" if status.visits else "Ask for the first visit"
    return {
        "reached": "Every accuracy is reached",
        "in doubt": "Every accuracy is reached, but in doubt",
    }.get(status.state, "The minutes are used; not every accuracy is reached")


def visit_range(visits: Sequence[Visit]) -> str:
    """Return ``visit 4`` or ``visits 4 to 9``."""
    noun = "visit" if len(visits) == 1 else "visits"
    return f"{noun} {text.ranges([visit.number for visit in visits])}"


def next_command(status: CampaignStatus, campaign: str) -> str:
    """Return the command to type next; nothing where the campaign has ended."""
    if status.open:
        return f"oed campaign tell {campaign} {status.open[0].number} RECORDS"
    return "" if status.ended else f"oed campaign ask {campaign}"


def remarks(status: CampaignStatus) -> list[str]:
    """Return what speaks against the numbers, and what cannot be reached, each in a sentence."""
    estimate = status.estimate
    doubts = [] if estimate is None else _about_estimate(status, estimate)
    out_of_reach = status.state in ("out of reach", "minutes used")
    if out_of_reach and status.outlook is not None:
        doubts.append(_outlook_words(status, status.outlook))
    return doubts


def _about_estimate(status: CampaignStatus, estimate: Estimate) -> list[str]:
    verdict, shift = estimate.trust.verdict, estimate.trust.model_error
    remarks = [*estimate.doubts(status.targets), *estimate.warnings]
    if verdict == "model error" and estimate.bears(status.targets):
        worst = int(np.argmax(shift / status.targets))
        remarks.append(
            f"{verdict}: {verdict.reason}; left out, it moves {status.names[worst]} by "
            f"{number(100 * float(shift[worst]), 2)} %, so every accuracy is reached all the same"
        )
    return remarks


def _outlook_words(status: CampaignStatus, outlook: Outlook) -> str:
    ratio = outlook.std / status.targets
    worst = int(np.argmax(ratio))
    total = status.minutes + outlook.needed
    guesses = ", by the guesses" if status.estimate is None else ""
    return (
        f"out of reach{guesses}: {minutes(outlook.needed)} more are needed at least, "
        f"{minutes(outlook.remaining)} are left, in which targets {number(float(ratio[worst]), 2)} "
        f"times as wide can be reached at best ({status.names[worst]}); allow minutes: "
        f"{number(1.1 * total, 2)}, or relax the targets"
    )


def minutes(value: float) -> str:
    """Return ``3.4 min``."""
    return f"{plain(text.fixed(value, 1)) if value < 1000 else number(value, 2)} min"


def visits_text(visits: Sequence[Visit], status: CampaignStatus, campaign: str) -> str:
    """Return the visits to run as a table, and what to type after the first."""
    rows = [
        (
            str(visit.number),
            PURPOSES[visit.purpose],
            vector(visit.plan.positions[0], 3),
            str(visit.plan.periods),
            f"{visit.plan.duration:.0f} s",
        )
        for visit in visits
    ]
    header = ("visit", "purpose", "position [rad; m]", "periods", "time")
    folder = visits[0].folder
    return "\n".join(
        [
            *table(header, rows, right=(3, 4)),
            f"{minutes(status.expected)} for these, {minutes(status.remaining)} of "
            f"{status.budget:g} are left",
            *_remark_lines(status),
            f"files for the controller: {folder / 'controller'}, and so of each visit",
            f"next  {next_command(status, campaign)}",
        ]
    )


def status_text(status: CampaignStatus, campaign: str) -> str:
    """Return how far a campaign is, for a terminal."""
    measured = sum(visit.state == "measured" for visit in status.visits)
    lines = [
        f"{status.state}: {plain(text.plural(measured, 'visit'))} in {status.minutes:.1f} of "
        f"{status.budget:g} min"
        + (f", {status.expected:.1f} min requested" if status.expected else ""),
        *_remark_lines(status),
    ]
    if status.estimate is not None:
        lines += _parameters(status)
    step = next_command(status, campaign)
    return "\n".join([*lines, f"next  {step}" if step else headline(status).lower()])


def _remark_lines(status: CampaignStatus) -> list[str]:
    return [line for words in remarks(status) for line in hung("! ", words, 2)]


def _parameters(status: CampaignStatus) -> list[str]:
    """Return the table of parameters, the verdict and the test of drift."""
    estimate = status.estimate
    assert estimate is not None
    rows = [
        (
            name,
            number(float(value), 5),
            f"{100 * float(std):.2g} %",
            f"{100 * float(target):.2g} %" if np.isfinite(target) else "",
            "" if std <= target else "not yet",
        )
        for name, value, std, target in zip(
            status.names, estimate.values, estimate.std, status.targets, strict=True
        )
    ]
    header = ("parameter", "value", "std", "target", "")
    verdict = f"{estimate.trust.verdict}: {estimate.trust.verdict.reason}"
    lines = table(header, rows, right=(1, 2, 3))
    for one in estimate.friction:
        lines += hung(f"friction of {one.motor}: ", level_words(one), 2)
    if not any(words.startswith(verdict) for words in remarks(status)):
        lines += hung("verdict: ", verdict, 2)
    if np.isfinite(estimate.drift):
        lines.append(f"first visit repeated: p-value of no drift {estimate.drift:.2g}")
    return lines


def visit_json(visit: Visit) -> dict[str, Any]:
    """Return a visit for scripts."""
    return {
        "visit": visit.number,
        "purpose": visit.purpose,
        "position": visit.plan.positions[0].tolist(),
        "periods": visit.plan.periods,
        "duration": visit.plan.duration,
        "folder": str(visit.folder),
    }


def status_json(status: CampaignStatus, report: Path) -> dict[str, Any]:
    """Return how far a campaign is, for scripts."""
    estimate, outlook = status.estimate, status.outlook
    document: dict[str, Any] = {
        "schema": "campaign_status/1",
        "state": status.state,
        "ended": status.ended,
        "minutes": status.minutes,
        "expected_minutes": status.expected,
        "budget": status.budget,
        "remarks": remarks(status),
        "visits": [{**visit_json(visit), "state": visit.state} for visit in status.visits],
        "report": str(report),
    }
    if outlook is not None:
        document |= {
            "needed_minutes": outlook.needed,
            "reachable_std": dict(zip(status.names, outlook.std.tolist(), strict=True)),
        }
    if estimate is not None:
        intervals = zip(estimate.trust.intervals, estimate.std, status.targets, strict=True)
        document |= {
            "verdict": str(estimate.trust.verdict),
            "reason": estimate.trust.verdict.reason,
            "drift": estimate.drift,
            "friction": levels_json(estimate.friction),
            "parameters": [
                {
                    "name": one.name,
                    "value": one.value,
                    "low": one.low,
                    "high": one.high,
                    "relative_std": float(std),
                    "target": float(target),
                }
                for one, std, target in intervals
            ],
        }
    return document
