"""What the command line says at the end: one screen, plain characters."""

from pathlib import Path
from typing import Any

import numpy as np

from oed.study.pipeline import FittedStudy, PlannedStudy, StudyResults
from reports.sections.fit import reached, reached_words
from reports.terminal.columns import hung, plain, plural
from reports.text import duration, efficiency, percent

Lines = list[tuple[str, str]]


def study_summary(results: PlannedStudy, written: list[Path]) -> str:
    """Return the summary of a study, as far as it was computed."""
    lines = _design_lines(results)
    if isinstance(results, FittedStudy):
        lines += _fit_lines(results)
    if isinstance(results, StudyResults):
        lines += _uncertainty_lines(results)
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
        "experiments": int(r.exact.repetitions.sum()),
        "gap": float(r.design.gap),
        "efficiency": float(r.exact.efficiency),
    }
    if isinstance(r, FittedStudy):
        document |= {
            "cost": float(r.fit.cost),
            "fit_converged": r.fit.converged,
            "at_bounds": r.fit.at_bounds,
            "failures": {one.name: one.reason for one in r.failures},
            "verdict": str(r.trust.verdict),
            "reason": r.trust.verdict.reason,
        }
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
            found = r.cross_check
            document["verdicts"] = dict(zip(found.names, found.verdicts, strict=True))
        if r.comparison is not None:
            document["rivals_beaten"] = list(r.comparison.beaten)
    files = [str(path) for path in written]
    return document | {"seconds": r.seconds, "kept": list(r.kept), "files": files}


def _design_lines(r: PlannedStudy) -> Lines:
    count = int(r.exact.repetitions.sum())
    if r.study.data.measured:
        return [("data", f"{plural(len(r.used), 'position')}, {plural(count, 'experiment')}")]
    return [
        (
            "design",
            f"{plural(len(r.information.positions), 'candidate')}, "
            f"{plural(len(r.used), 'position')} used, {plural(count, 'experiment')}",
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
    promised = f"worst {names[worst]} {_percent(std[worst])}" if np.isfinite(std[worst]) else ""
    lines = [("promised", f"std best {_percent(std.min())}{', ' + promised if promised else ''}")]
    return [*lines, *(("", f"WEAK: {combination}") for combination in r.promise.weak()[:3])]


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
    lines.append(("", f"starts that reached the best cost: {reached_words(reached(r))}"))
    return [*lines, ("verdict", f"{r.trust.verdict}: {r.trust.verdict.reason}")]


def _uncertainty_lines(r: StudyResults) -> Lines:
    names, std, posterior = r.fit.parameters.names, r.std, r.posterior
    lines: Lines = []
    if r.theorem1 is not None:
        best, worst = int(np.argmin(std)), int(np.argmax(std))
        lines.append(
            (
                "std",
                f"best {names[best]} {_percent(std[best])}, "
                f"worst {names[worst]} {_percent(std[worst])}",
            )
        )
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
    if r.cross_check is not None:
        verdicts = r.cross_check.verdicts
        counts = ", ".join(f"{verdicts.count(v)} x {v}" for v in dict.fromkeys(verdicts))
        lines.append(("methods", counts))
    return lines


def _gap(gap: float) -> str:
    return f"{gap:.1e}" if gap > 0 else "0"


def _percent(fraction: float) -> str:
    return plain(percent(float(fraction)))


def _time(r: PlannedStudy) -> str:
    slowest = sorted(r.seconds.items(), key=lambda item: -item[1])[:3]
    parts = ", ".join(f"{stage} {s:.1f}" for stage, s in slowest)
    return f"{plain(duration(sum(r.seconds.values())))} ({parts})"
