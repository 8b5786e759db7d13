"""What the command line says at the end: one screen, plain characters."""

from pathlib import Path

import numpy as np

from oed.study import StudyResults
from reports import tables


def study_summary(results: StudyResults, report: Path) -> str:
    """Return the summary of a study."""
    r, std, posterior = results, results.theorem1.std, results.posterior
    names, ratio = r.theorem1.names, std / posterior.uncertainty().std
    best, worst = int(np.argmin(std)), int(np.argmax(std))
    reached = ", ".join(f"{label} {n} of {of}" for label, n, of in tables.reached(r))
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
        ("", f"starts at the best cost: {reached}"),
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
    if not posterior.converged:
        lines.insert(-2, ("", posterior.message))
    if not r.fit.converged:
        lines.insert(3, ("", f"NOT converged: {r.fit.message}"))
    return "\n".join([f"{r.robot.name}", *(f"  {key:<8}{value}" for key, value in lines)])
