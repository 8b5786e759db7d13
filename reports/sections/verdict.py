"""The verdict of a study in words: what holds, why, which numbers to quote, what to do next."""

import numpy as np
from markupsafe import Markup

from estimators.trust.intervals import Interval
from estimators.trust.trust import Trust
from estimators.validation.cross_check import WIDTH, CrossCheck
from oed.study.next_step import next_step
from oed.study.results import FittedStudy, PlannedStudy, StudyResults
from reports import text
from reports.page_elements import Number, number_cell, page_banner
from reports.sections.plan_labels import cost

KINDS = {
    "trustworthy": "sound",
    "noise correlated": "sound",
    "noise understated": "doubtful",
    "too few blocks": "doubtful",
}
"""How a verdict looks on a page; all others are refused."""


def banner(results: PlannedStudy) -> Markup:
    """Return the banner of a page: verdict, reason, which numbers to quote, what to do next."""
    step = text.sentence(next_step(results).sentence)
    if not isinstance(results, FittedStudy):
        return page_banner(*_of_plan(results), next_step=f"{step} ({cost(results)})")
    check = results.uncertainty.cross_check if isinstance(results, StudyResults) else None
    return fit_banner(results.trust, check, step)


def fit_banner(trust: Trust, check: CrossCheck | None, step: str) -> Markup:
    """Return the banner of a fit; `step` is what to do next."""
    return page_banner(
        headline(trust),
        KINDS.get(trust.verdict, "refused"),
        text.typeset(text.sentence(trust.verdict.reason)),
        quote=quote(trust, check),
        next_step=step,
    )


def _of_plan(results: PlannedStudy) -> tuple[str, str, str]:
    """Return headline, kind and reason of a plan without data."""
    summary = results.plan_summary
    ends = [f"{text.percent(one.std)} ({one.name})" for one in (summary.best, summary.worst)]
    if not np.isfinite(summary.worst.std):
        ends[1] = f"undetermined ({summary.worst.name})"
    reason = (
        f"Expected relative standard deviations: {' to '.join(ends)}, if the robot is as its file "
        f"says. The plan’s efficiency is at least {text.efficiency(summary.efficiency)}"
    )
    if summary.weak:
        return "This plan leaves parameters undetermined", "doubtful", reason
    return "This plan determines every parameter", "sound", reason


def headline(trust: Trust) -> str:
    """Return the verdict, and whether the numbers may be quoted."""
    return f"{text.sentence(str(trust.verdict))}: {answer(trust)}"


def answer(trust: Trust) -> str:
    """Return whether the numbers may be quoted."""
    count, p = len(usable(trust)), len(trust.names)
    if 0 < count < p:
        return f"quote {count} of {text.plural(p, 'parameter')} only"
    reserve = " with reservations" if KINDS.get(trust.verdict) == "doubtful" else ""
    return f"these numbers may be quoted{reserve}" if count else "do not quote these numbers"


def discredited(interval: Interval) -> str:
    """Return why a number must not be quoted, nothing if it may."""
    if interval.verdict.gives_interval:
        return ""
    return f"{interval.verdict}: {interval.verdict.reason}"


def usable(trust: Trust) -> list[int]:
    """Return the parameters that have an interval with two ends."""
    return [i for i, one in enumerate(trust.intervals) if not discredited(one)]


def quote(trust: Trust, check: CrossCheck | None) -> str:
    """Return which standard deviations to quote, and which methods come to the same."""
    count, p = len(usable(trust)), len(trust.names)
    if not count:
        return "Quote no standard deviation of this study."
    whose = "" if count == p else f" of {count} of {text.plural(p, 'parameter')}"
    reserve = ", with this reserve," if trust.verdict == "too few blocks" else ""
    words = f"Quote the recommended standard deviations{whose}{reserve} ({trust.method})."
    return f"{words} {agreement(check)}".strip()


def agreement(check: CrossCheck | None) -> str:
    """Return the ratios of other standard deviations to those that may be quoted."""
    shown = [] if check is None else usable(check.trust)
    if check is None or not shown:
        return ""
    widths, agree = [], {}
    for method, label in (("Theorem 1", "Theorem 1"), ("posterior", "emcee")):
        ratio = check.ratio(method, "recommended")[shown]
        if np.isfinite(ratio).any():
            widths.append(f"{label} {text.span(ratio[np.isfinite(ratio)])}")
            agree[label] = not bool((np.abs(ratio - 1) > WIDTH).any())
    if not agree:
        return ""
    words = ", ".join(
        f"{label} {'agrees' if alike else 'does not agree'}" for label, alike in agree.items()
    )
    if len(agree) == 2 and len(set(agree.values())) == 1:
        words = "both agree" if agree["emcee"] else "neither agrees"
    return f"Ratio to them: {', '.join(widths)} ({words})."


def interval_cells(one: Interval, factor: float, decimals: int) -> tuple[Number, Number]:
    """Return the ends of an interval; a dash where there is none."""
    ends = (float("nan") if end is None else end / factor for end in (one.low, one.high))
    two_sided = one.low is not None and one.high is not None
    words, digits = (text.fixed, decimals) if two_sided else (text.significant, 2)
    low, high = (number_cell(end, words, digits) for end in ends)
    return low, high


def interval_words(one: Interval, factor: float = 1.0) -> str:
    """Return ``1.21 to 1.30``, ``< 0.013`` or ``> 2e4``; a dash where there is no interval."""
    if one.low is not None and one.high is not None:
        return " to ".join(text.significant(end / factor, 4) for end in (one.low, one.high))
    if one.high is not None:
        return f"< {text.significant(one.high / factor, 2)}"
    if one.low is not None:
        return f"> {text.significant(one.low / factor, 2)}"
    return "–"


def bands_banner(coverage: float, trust: Trust | None) -> Markup:
    """Return the verdict on the fit, or on what the bands rest if there is none."""
    level = f"Quote values with their {text.level(coverage)} bands"
    if trust is None:
        reason = "The bands rest on the standard deviations of the robot file"
        return page_banner("As certain as the robot file", "sound", reason, quote=f"{level}.")
    kind, reason = KINDS.get(trust.verdict, "refused"), text.sentence(trust.verdict.reason)
    words = f"{level}." if kind != "refused" else "Quote no band: they do not allow for this."
    return page_banner(headline(trust), kind, text.typeset(reason), quote=words)
