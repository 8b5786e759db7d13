"""What a study of visits says at the end: one screen, and the same as JSON."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from oed.visit_study.run_visit_study import VisitStudyResults
from reports.summaries.columns import hung, number, plain, plural, table, vector
from reports.text import efficiency, listed, percent


def visit_study_summary(results: VisitStudyResults, written: Sequence[Path]) -> str:
    """Return minutes, visits in order, predicted accuracy, and that of other times, for people."""
    minutes = float(results.seconds.sum()) / 60
    lines = [
        ("choice", f"{str(results.table).split(': ', 1)[1]}"),
        (
            "plan",
            f"{plural(len(results.visits), 'visit')} in {number(minutes)} min; efficiency >= "
            f"{plain(efficiency(results.plan.efficiency))}",
        ),
    ]
    if results.spectra is not None:
        lines.append(("spectra", spectra_words(results)))
    lines.append(("expected", predicted_words(results)))
    times = zip(results.curve.times, results.curve.plans, strict=True)
    lines += [
        ("minutes", f"{number(time / 60)}: {accuracy_words(results, one.std)}")
        for time, one in times
    ]
    printed = [results.robot.name]
    for key, value in lines:
        printed += hung(f"  {key:<9}", plain(value), 11)
    printed += table(
        ("visit", "position [rad; m]", "excitation", "runs", "periods", "time"),
        [
            (
                str(i + 1),
                vector(one.plan.positions[0], 2),
                one.excitation,
                str(one.plan.runs),
                str(one.plan.periods),
                f"{seconds:.0f} s",
            )
            for i, (one, seconds) in enumerate(zip(results.visits, results.seconds, strict=True))
        ],
        right=(3, 4, 5),
    )
    return "\n".join([*printed, *(f"  written  {path}" for path in written)])


def spectra_words(results: VisitStudyResults) -> str:
    """Return what designed spectra gain and lose."""
    spectra = results.spectra
    if spectra is None:
        return "flat"
    return (
        f"certified gap {spectra.gap:.1e}; flat ones keep {percent(spectra.flat_efficiency)} of "
        f"the efficiency, single runs {percent(spectra.run_efficiency)}"
    )


def predicted_words(results: VisitStudyResults) -> str:
    """Return the predicted accuracy of the visits, over samples of theta if there are more."""
    words, robust = accuracy_words(results, results.overall_std), results.study.design.robust
    if robust is None:
        return words
    how = "the worst" if robust.kind == "maximin" else "the mean"
    return f"{words}, {how} of {len(results.std)} samples of the parameters"


def accuracy_words(results: VisitStudyResults, std: np.ndarray) -> str:
    """Return the parameter that is worst off, by its target where there are targets."""
    ratio = std / results.targets
    if np.isnan(ratio).all():
        worst = int(np.argmax(std))
        return f"{results.names[worst]} within {percent(float(std[worst]))}, others better"
    worst = int(np.nanargmax(ratio))
    missed = [n for n, r in zip(results.names, ratio, strict=True) if r > 1]
    reached = f"{listed(missed)} above target" if missed else "all targets reached"
    return f"{reached}, {results.names[worst]} within {percent(float(std[worst]))}"


def visit_study_json(results: VisitStudyResults) -> dict[str, object]:
    """Return the same for programs, SI units."""
    spectra = results.spectra
    return {
        "schema": "visits/1",
        "robot": results.robot.name,
        "seed": results.study.seed,
        "seconds": float(results.seconds.sum()),
        "efficiency": results.plan.efficiency,
        "spectra": None
        if spectra is None
        else {
            "gap": spectra.gap,
            "flat_efficiency": spectra.flat_efficiency,
            "run_efficiency": spectra.run_efficiency,
        },
        "parameters": [
            {"name": name, "relative_std": std.tolist(), "target": None if np.isnan(t) else t}
            for name, std, t in zip(
                results.names, results.std.T, results.targets.tolist(), strict=True
            )
        ],
        "visits": [
            {
                "position": one.plan.positions[0].tolist(),
                "excitation": one.excitation,
                "runs": one.plan.runs,
                "periods": one.plan.periods,
                "seconds": float(seconds),
            }
            for one, seconds in zip(results.visits, results.seconds, strict=True)
        ],
        "curve": [
            {
                "seconds": float(time),
                "efficiency": plan.efficiency,
                "relative_std": dict(zip(results.names, plan.std.tolist(), strict=True)),
            }
            for time, plan in zip(results.curve.times, results.curve.plans, strict=True)
        ],
    }
