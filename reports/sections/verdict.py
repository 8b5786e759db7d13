"""The verdict of a study in words: what holds, why, and which numbers to quote."""

import numpy as np
from markupsafe import Markup

from estimators.trust.intervals import Interval
from estimators.trust.trust import Trust
from estimators.validation.cross_check import WIDTH, CrossCheck
from oed.study.results import StudyResults
from reports import text
from reports.page_elements import filled

KINDS = {
    "trustworthy": "sound",
    "noise correlated": "sound",
    "noise understated": "doubtful",
    "too few blocks": "doubtful",
}
"""How a verdict looks on a page; all others are refused."""


def banner(results: StudyResults) -> Markup:
    """Return the banner of a page: verdict, reason, and which standard deviations to quote."""
    trust = results.trust
    return filled(
        "banner.html.j2",
        verdict=text.sentence(str(trust.verdict)),
        kind=KINDS.get(trust.verdict, "refused"),
        reason=text.typeset(text.sentence(trust.verdict.reason)),
        quote=quote(trust, results.uncertainty.cross_check),
    )


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
    """Return how wide Theorem 1 and the posterior are beside what may be quoted."""
    shown = [] if check is None else usable(check.trust)
    if check is None or not shown:
        return ""
    widths, agree = [], {}
    for method, label in (("Theorem 1", "Theorem 1"), ("posterior", "emcee")):
        ratio = check.ratio(method, "recommended")[shown]
        if np.isfinite(ratio).any():
            widths.append(f"{label} is {text.span(ratio[np.isfinite(ratio)])} times as wide")
            agree[label] = not bool((np.abs(ratio - 1) > WIDTH).any())
    if not agree:
        return ""
    words = ", ".join(
        f"{label} {'agrees' if alike else 'does not agree'}" for label, alike in agree.items()
    )
    if len(agree) == 2 and len(set(agree.values())) == 1:
        words = "both agree" if agree["emcee"] else "neither agrees"
    return f"Beside them {text.listed(widths)}: {words}."


def interval_words(one: Interval, factor: float = 1.0, decimals: int | None = None) -> str:
    """Return ``1.21 to 1.30``, ``< 0.013`` or ``> 2e4``; a dash where there is no interval."""

    def end(value: float) -> str:
        if decimals is None:
            return text.significant(value / factor, 4)
        return text.fixed(value / factor, decimals)

    if one.low is not None and one.high is not None:
        return f"{end(one.low)} to {end(one.high)}"
    if one.high is not None:
        return f"< {text.significant(one.high / factor, 2)}"
    if one.low is not None:
        return f"> {text.significant(one.low / factor, 2)}"
    return "–"
