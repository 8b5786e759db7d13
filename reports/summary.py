"""What the command line says at the end: one screen, plain characters."""

from pathlib import Path

import numpy as np

from oed.study import StudyResults
from reports import tables, text
from robotmodels import ElasticRobot, linearize
from robotmodels.arrays import Array
from robotmodels.modes import resonances


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


def robot_summary(robot: ElasticRobot, position: Array) -> str:
    """Return a robot's parameters, coordinates and resonances at `position` (n,) [rad]."""
    rows = tables.nominal_rows(robot.parameters)
    width = max(len(name) for name, _, _ in rows)
    flexible = resonances(linearize(robot, position)).frequencies / (2 * np.pi)
    place = ", ".join(f"{a:.4g}" for a in np.degrees(position))
    lines = [
        f"{robot.name}: {len(robot.motor_names)} motors, "
        f"{len(robot.coordinate_names)} coordinates, {len(rows)} free parameters",
        *(
            f"  {name:<{width}}  {value.replace(text.THIN, ' '):>8} {unit}"
            for name, value, unit in rows
        ),
        "coordinates, base to tool, then motors",
        f"  {', '.join(robot.coordinate_names)}",
        f"resonances [Hz] at [{place}] degrees",
        f"  {', '.join(f'{hertz:.4g}' for hertz in flexible)}",
    ]
    return "\n".join(lines)
