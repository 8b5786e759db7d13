"""What the command line says at the end: one screen, plain characters."""

from pathlib import Path
from typing import Any

import numpy as np

from estimators.trust.trust import Trust
from oed.study.json_output import predicted_document
from oed.study.next_step import next_step
from oed.study.results import FittedStudy, PlannedStudy, StudyResults
from oed.study.robot_time import robot_time
from oed.study.summary import FitSummary, PlanSummary, UncertaintySummary
from reports.sections.fit import reached_words
from reports.sections.plan_labels import cost
from reports.sections.verdict import answer, discredited, interval_words
from reports.summaries.columns import hung, plain, plural
from reports.text import duration, efficiency, percent
from robotmodels.common.arrays import IMPROBABLE
from robotmodels.common.plain_data import json_data

Lines = list[tuple[str, str]]
_WEAKEST = 3
SHOWN, _WORST = 6, 3  # parameters whose intervals are all shown; the widest that are of more


def study_summary(results: PlannedStudy, written: list[Path]) -> str:
    """Return the summary of a study, as far as it was computed."""
    lines = _design_lines(results)
    if isinstance(results, FittedStudy):
        lines += [("CHECK", message) for message in results.data.warnings]
        lines += _fit_lines(results.fit_summary)
    if isinstance(results, StudyResults):
        lines += _uncertainty_lines(results)
    if isinstance(results, FittedStudy):
        lines += _trust_lines(results.trust, results.fit_summary)
    lines.append(("next", plain(next_step(results).sentence)))
    lines += [("FAILED", f"{one.name}: {one.reason}") for one in results.run.failures]
    lines.append(("stages", _time(results)))
    if results.run.loaded:
        lines.append(("reused", f"{', '.join(results.run.loaded)} (inputs unchanged)"))
    printed = [results.robot.name]
    for key, value in lines:
        printed += hung(f"  {key:<9}", value, 11)
    files = [("report" if p.suffix == ".html" else "written", str(p)) for p in written]
    return "\n".join([*printed, *(f"  {key:<9}{path}" for key, path in files)])


def study_json(results: PlannedStudy, written: list[Path]) -> dict[str, Any]:
    """Return the summary for scripts, in SI units; the files that were written say more."""
    r, plan = results, results.plan_summary
    document: dict[str, Any] = {
        "robot": r.robot.name,
        "seed": r.study.seed,
        "candidates": plan.candidates,
        "positions": plan.positions,
        "experiments": plan.experiments,
        "runs": plan.runs,
        "gap": plan.gap,
        "efficiency": plan.efficiency,
        "predicted": predicted_document(plan),
        "robot_time": json_data(robot_time(r)),
        "next_step": json_data(next_step(r)),
    }
    if r.purpose_std is not None:
        document["purpose_std"] = r.purpose_std
    if r.powers:
        document["springs"] = [vars(power) for power in r.powers]
    if isinstance(r, FittedStudy):
        fit, trust = r.fit_summary, r.trust.document()
        document |= {
            "cost": fit.cost,
            "fit_converged": fit.converged,
            "at_bounds": fit.at_bounds,
            "data_warnings": list(r.data.warnings),
            "residuals_over_expected": fit.residual_ratio,
            "residuals_p_value": fit.residual_probability,
            "failures": r.run.reasons,
            **{key: trust[key] for key in ("verdict", "reason", "intervals")},
        }
    if isinstance(r, StudyResults):
        document |= _uncertainty_document(r, r.fit_summary, r.uncertainty_summary)
    files = [str(path) for path in written]
    return document | {"seconds": r.run.seconds, "kept": r.run.loaded, "files": files}


def _uncertainty_document(
    r: StudyResults, fit: FitSummary, methods: UncertaintySummary
) -> dict[str, Any]:
    document: dict[str, Any] = {}
    if methods.posterior is not None:
        document["posterior_converged"] = methods.posterior.converged
    if methods.theorem1 is not None:
        document["relative_std"] = {one.name: one.std for one in methods.theorem1}
    if methods.agreeing is not None:
        document["agreeing"] = methods.agreeing
    if r.comparison is not None:
        document["worse_alternatives"] = r.comparison.worse
    return document


def _design_lines(r: PlannedStudy) -> Lines:
    plan = r.plan_summary
    if r.measured:
        return [("data", f"{plural(plan.positions, 'position')}, {plain(cost(r))}")]
    return [
        (
            "design",
            f"{plural(plan.candidates, 'candidate')}, "
            f"{plural(plan.positions, 'position')} used, {plain(cost(r))}",
        ),
        (
            "",
            f"certified gap {_gap(plan.gap)}, efficiency of the plan >= "
            f"{plain(efficiency(plan.efficiency))}",
        ),
        *_predicted_lines(plan),
        *([] if r.purpose_std is None else [("purpose", _purpose_words(r, r.purpose_std))]),
        *[("" if i else "springs", str(power)) for i, power in enumerate(r.powers)],
    ]


def _purpose_words(r: PlannedStudy, std: float) -> str:
    assert r.study.design.purpose is not None
    size = _percent(std) if np.isfinite(std) else "not at all"
    return f"{r.study.design.purpose.quantity}, std {size} (root mean square over its region)"


def _predicted_lines(plan: PlanSummary) -> Lines:
    """Return the standard deviations predicted for the plan, and undetermined combinations."""
    best, worst = plan.best, plan.worst
    largest = _percent(worst.std) if np.isfinite(worst.std) else "not at all"
    lines = [
        ("expected", f"std best {best.name} {_percent(best.std)}, worst {worst.name} {largest}")
    ]
    lines += [("", f"WEAK: {combination}") for combination in plan.weak[:_WEAKEST]]
    if len(plan.weak) > _WEAKEST:
        more = len(plan.weak) - _WEAKEST
        lines.append(("", f"and {more} more weak combinations, in design.json"))
    return lines


def _fit_lines(fit: FitSummary) -> Lines:
    lines = [("fit", f"{fit.residual.upper()} cost {fit.cost:.1f} from {fit.origin}")]
    if not fit.converged:
        lines.append(("", f"NOT converged: {fit.message}"))
    lines += [
        ("", f"AT A BOUND: {name}, the {side} one: its interval is one-sided")
        for name, side in fit.at_bounds.items()
    ]
    lines.append(("", f"searches that reached the lowest cost: {reached_words(fit.reached)}"))
    if fit.residual_probability < IMPROBABLE:
        lines.append(("", f"MISFIT: residuals {fit.residual_ratio:.3g} times what noise explains"))
    return lines


def _uncertainty_lines(r: StudyResults) -> Lines:
    methods = r.uncertainty_summary
    lines: Lines = []
    if (posterior := methods.posterior) is not None:
        between = ""
        if methods.ratio is not None:
            between = ", Theorem 1 / emcee {:.2f} to {:.2f}".format(*methods.ratio)
        lines.append(
            ("emcee", f"R-hat <= {posterior.r_hat:.3f}, ESS >= {posterior.ess:.0f}{between}")
        )
        if not posterior.converged:
            lines.append(("", posterior.message))
    if r.comparison is not None:
        lines.append(("plans", str(r.comparison).splitlines()[0]))
    return lines


def _trust_lines(trust: Trust, fit: FitSummary) -> Lines:
    """Return the verdict, and the recommended intervals: all of few, else the best and worst."""
    lines = [
        ("verdict", f"{trust.verdict}: {trust.verdict.reason}"),
        ("", f"{plain(answer(trust))} ({trust.method})"),
    ]
    intervals = trust.intervals
    order = fit.usable
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
    slowest = sorted(r.run.seconds.items(), key=lambda item: -item[1])[:3]
    parts = ", ".join(f"{stage} {s:.1f}" for stage, s in slowest)
    return f"{plain(duration(r.run.total_seconds))} in sum ({parts})"
