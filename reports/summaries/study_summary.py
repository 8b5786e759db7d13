"""What the command line says at the end: one screen, plain characters."""

from pathlib import Path
from typing import Any

import numpy as np

from estimators.trust.trust import Trust
from oed.study.json_output import promised_document
from oed.study.results import FittedStudy, PlannedStudy, StudyResults
from reports.sections.fit import reached, reached_words
from reports.sections.plan_labels import cost
from reports.sections.verdict import discredited, interval_words, usable
from reports.summaries.columns import hung, plain, plural
from reports.text import duration, efficiency, percent

Lines = list[tuple[str, str]]
_WEAKEST = 3
SHOWN, _WORST = 6, 3  # parameters whose intervals are all shown; the widest that are of more


def study_summary(results: PlannedStudy, written: list[Path]) -> str:
    """Return the summary of a study, as far as it was computed."""
    lines = _design_lines(results)
    if isinstance(results, FittedStudy):
        lines += _fit_lines(results)
    if isinstance(results, StudyResults):
        lines += _uncertainty_lines(results)
    if isinstance(results, FittedStudy):
        lines += _trust_lines(results.trust)
    lines += [("FAILED", f"{one.name}: {one.reason}") for one in results.failures]
    lines.append(("time", _time(results)))
    if results.kept:
        lines.append(("kept", f"{', '.join(results.kept)} (nothing they rest on has changed)"))
    said = [results.robot.name]
    for key, value in lines:
        said += hung(f"  {key:<9}", value, 11)
    files = [("report" if p.suffix == ".html" else "written", str(p)) for p in written]
    return "\n".join([*said, *(f"  {key:<9}{path}" for key, path in files)])


def study_json(results: PlannedStudy, written: list[Path]) -> dict[str, Any]:
    """Return the summary for scripts, in SI units; the files that were written say more."""
    r = results
    document: dict[str, Any] = {
        "robot": r.robot.name,
        "seed": r.study.seed,
        "candidates": len(r.information.positions),
        "positions": len(r.used),
        "experiments": r.visits,
        "runs": r.visits * r.runs_per_visit,
        "gap": float(r.design.gap),
        "efficiency": float(r.exact.efficiency),
        "promised": promised_document(r),
    }
    if isinstance(r, FittedStudy):
        document |= {
            "cost": float(r.fit.cost),
            "fit_converged": r.fit.converged,
            "at_bounds": r.fit.at_bounds,
            "failures": {one.name: one.reason for one in r.failures},
        }
        trust = r.trust.document()
        document |= {key: trust[key] for key in ("verdict", "reason", "intervals")}
    if isinstance(r, StudyResults):
        document |= {
            "residuals_over_expected": r.trust.size.ratio,
            "residuals_p_value": r.trust.size.probability,
        }
        if r.posterior is not None:
            document["posterior_converged"] = r.posterior.converged
        if r.theorem1 is not None:
            std = map(float, r.theorem1.std)
            document["relative_std"] = dict(zip(r.theorem1.names, std, strict=True))
        if r.cross_check is not None:
            document["agreeing"] = list(r.cross_check.agreeing())
        if r.comparison is not None:
            document["rivals_beaten"] = list(r.comparison.beaten)
    files = [str(path) for path in written]
    return document | {"seconds": r.seconds, "kept": list(r.kept), "files": files}


def _design_lines(r: PlannedStudy) -> Lines:
    if r.study.data.measured:
        return [("data", f"{plural(len(r.used), 'position')}, {plain(cost(r))}")]
    return [
        (
            "design",
            f"{plural(len(r.information.positions), 'candidate')}, "
            f"{plural(len(r.used), 'position')} used, {plain(cost(r))}",
        ),
        (
            "",
            f"certified gap {_gap(r.design.gap)}, efficiency of the plan >= "
            f"{plain(efficiency(r.exact.efficiency))}",
        ),
        *_promise_lines(r),
    ]


def _promise_lines(r: PlannedStudy) -> Lines:
    """Return the standard deviations that the plan promises, and what it leaves open."""
    names, std = r.robot.parameters.names, r.promise.std
    worst = int(np.argmax(std))
    least = _percent(std[worst]) if np.isfinite(std[worst]) else "not at all"
    best = int(np.argmin(std))
    lines = [
        ("promised", f"std best {names[best]} {_percent(std[best])}, worst {names[worst]} {least}")
    ]
    weak = r.promise.weak()
    lines += [("", f"WEAK: {combination}") for combination in weak[:_WEAKEST]]
    if len(weak) > _WEAKEST:
        lines.append(("", f"and {len(weak) - _WEAKEST} more weak combinations, in design.json"))
    return lines


def _fit_lines(r: FittedStudy) -> Lines:
    lines = [("fit", f"{r.fit.residual.upper()} cost {r.fit.cost:.1f} from {r.fit_origin}")]
    if not r.fit.converged:
        lines.append(("", f"NOT converged: {r.fit.message}"))
    lines += [
        (
            "",
            f"AT A BOUND: {name}, the {side} one: its interval is one-sided",
        )
        for name, side in r.fit.at_bounds.items()
    ]
    return [*lines, ("", f"starts that reached the best cost: {reached_words(reached(r))}")]


def _uncertainty_lines(r: StudyResults) -> Lines:
    std, posterior = r.std, r.posterior
    lines: Lines = []
    if posterior is not None:
        ratio = std / r.sampled_std
        between = f", Theorem 1 / emcee {ratio.min():.2f} to {ratio.max():.2f}"
        lines.append(
            (
                "emcee",
                f"R-hat <= {np.max(posterior.r_hat):.3f}, ESS >= {np.min(posterior.ess):.0f}"
                f"{between if r.theorem1 is not None else ''}",
            )
        )
        if not posterior.converged:
            lines.append(("", posterior.message))
    if r.comparison is not None:
        lines.append(("plans", str(r.comparison).splitlines()[0]))
    return lines


def _trust_lines(trust: Trust) -> Lines:
    """Return the verdict, and the recommended intervals: all of few, else the best and worst."""
    lines = [("verdict", f"{trust.verdict}: {trust.verdict.reason}")]
    intervals = trust.intervals
    order = sorted(usable(trust), key=lambda i: trust.std[i])
    shown = order if len(intervals) <= SHOWN else order[:1] + order[1:][-_WORST:]
    width = max(len(one.name) for one in intervals)
    rows = [
        f"{intervals[i].name:<{width}}  {plain(interval_words(intervals[i]))} "
        f"(std {_percent(trust.std[i])})"
        for i in shown
    ]
    if len(shown) < len(order):
        rows.append(f"and {len(order) - len(shown)} between these, in fit.json")
    counts = {v: trust.verdicts.count(v) for v in dict.fromkeys(trust.verdicts)}
    for one in intervals:
        if discredited(one) and (one.low is not None or one.high is not None):
            rows.append(f"{one.name:<{width}}  {plain(interval_words(one))} ({one.verdict})")
    if not order:
        rows.append("no interval to quote")
    elif len(counts) > 1:
        rows.append(", ".join(f"{count} x {verdict}" for verdict, count in counts.items()))
    return [*lines, *(("95 %" if not k else "", row) for k, row in enumerate(rows))]


def _gap(gap: float) -> str:
    return f"{gap:.1e}" if gap > 0 else "0"


def _percent(fraction: float) -> str:
    return plain(percent(float(fraction)))


def _time(r: PlannedStudy) -> str:
    slowest = sorted(r.seconds.items(), key=lambda item: -item[1])[:3]
    parts = ", ".join(f"{stage} {s:.1f}" for stage, s in slowest)
    return f"{plain(duration(sum(r.seconds.values())))} ({parts})"
