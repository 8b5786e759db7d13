"""What the command line says at the end: one screen, plain characters."""

from pathlib import Path
from typing import Any

import numpy as np

from oed.study import StudyResults
from reports.sections.fit import reached


def study_summary(results: StudyResults, report: Path) -> str:
    """Return the summary of a study."""
    r, std, posterior = results, results.theorem1.std, results.posterior
    names, ratio = r.theorem1.names, std / posterior.uncertainty().std
    best, worst = int(np.argmin(std)), int(np.argmax(std))
    at_best = ", ".join(f"{label} {n} of {of}" for label, n, of in reached(r))
    slowest = sorted(r.seconds.items(), key=lambda item: -item[1])[:3]
    lines = [
        (
            "design",
            f"{len(r.information.positions)} candidates, {len(r.used)} positions used, "
            f"{int(r.exact.repetitions.sum())} experiments",
        ),
        (
            "",
            f"certified gap {r.design.gap:.1e}, efficiency of the plan >= {r.exact.efficiency:.4f}",
        ),
        ("fit", f"NLS cost {r.fit.cost:.1f} from {r.fit_origin}"),
        ("", f"starts at the best cost: {at_best}"),
        (
            "std",
            f"best {names[best]} {100 * std[best]:.2g} %, "
            f"worst {names[worst]} {100 * std[worst]:.2g} %",
        ),
        (
            "emcee",
            f"R-hat <= {np.max(posterior.r_hat):.3f}, ESS >= {np.min(posterior.ess):.0f}, "
            f"Theorem 1 / emcee {ratio.min():.2f} to {ratio.max():.2f}",
        ),
        (
            "time",
            f"{sum(r.seconds.values()):.1f} s ("
            + ", ".join(f"{stage} {s:.1f}" for stage, s in slowest)
            + ")",
        ),
        ("report", str(report)),
    ]
    if r.kept:
        lines.insert(-1, ("kept", f"{', '.join(r.kept)} (nothing they rest on has changed)"))
    if not posterior.converged:
        lines.insert(-2, ("", posterior.message))
    if not r.fit.converged:
        lines.insert(3, ("", f"NOT converged: {r.fit.message}"))
    return "\n".join([f"{r.robot.name}", *(f"  {key:<8}{value}" for key, value in lines)])


def study_json(results: StudyResults, report: Path) -> dict[str, Any]:
    """Return the summary for scripts, in SI units; the files beside the report say more."""
    r, posterior = results, results.posterior
    return {
        "robot": r.robot.name,
        "seed": r.study.seed,
        "candidates": len(r.information.positions),
        "positions": len(r.used),
        "experiments": int(r.exact.repetitions.sum()),
        "gap": float(r.design.gap),
        "efficiency": float(r.exact.efficiency),
        "cost": float(r.fit.cost),
        "converged": {"fit": r.fit.converged, "posterior": posterior.converged},
        "relative_std": dict(zip(r.theorem1.names, r.theorem1.std.tolist(), strict=True)),
        "seconds": r.seconds,
        "kept": list(r.kept),
        "report": str(report),
    }
