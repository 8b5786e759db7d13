"""The fit: costs over starts, and the origin of the result."""

from collections.abc import Sequence

import numpy as np

from oed.study.results import StudyResults
from oed.study.stages.fit import start_number
from oed.study.summary import Reached
from reports import text
from reports.figures import study_figures
from reports.page_elements import Column, Number, Section, Table, figure, filled, numbers, table


def section(results: StudyResults) -> Section:
    """Return the section."""
    costs = {
        name: [run.cost for run in search.runs if np.isfinite(run.cost)]
        for name, search in results.fits.searches.items()
    }
    best = {name: results.fits.best_cost(name) for name in costs}
    body = filled(
        "fit.html.j2",
        results=results,
        reached=reached_words(results.fit_summary.reached),
        distances=distances(results),
        cost=text.significant(results.fit_summary.cost, 6),
        costs=figure(
            "costs",
            study_figures.costs_over_starts(costs, best),
            "Final cost of every fit over the best cost of its estimator, a dot per start",
        ),
        runs=run_table(results),
    )
    return Section("fit", "Fit", body)


def reached_words(reached: Sequence[Reached]) -> str:
    """Return how many starts ended at the best cost, estimators that did alike together."""
    alike: dict[tuple[int, int], list[str]] = {}
    for one in reached:
        label = text.residual_label(one.estimator)
        alike.setdefault((one.count, one.starts), []).append(label)
    parts = []
    for (count, of), labels in alike.items():
        many = f"{count} of {of}" if count < of or of == 1 else f"all {of}"
        parts.append(f"{many} with {text.listed(labels)}")
    return "; ".join(parts)


def distances(results: StudyResults) -> list[tuple[str, str]]:
    """Return, per other estimator, how far its estimate lies at most, in standard deviations."""
    if results.uncertainty.theorem1 is None:
        return []
    estimate, rows = results.fits.result.parameters.values, []
    for name, search in results.fits.searches.items():
        if name != results.fits.result.residual:
            away = (
                np.abs(np.log(search.result.parameters.values / estimate)) / results.uncertainty.std
            )
            rows.append((text.residual_label(name), text.fixed(float(away.max()), 1)))
    return rows


def run_table(results: StudyResults) -> Table:
    """Return every fit from every start, in the order of estimators and costs."""
    rows = []
    for name, search in results.fits.searches.items():
        best = results.fits.best_cost(name)
        for run in search.runs:
            start = start_number(results.fits.starts, run) + 1
            rows.append(
                (
                    text.residual_label(name),
                    Number(str(start), start),
                    Number(text.significant(run.cost, 6), run.cost),
                    Number(text.significant(run.cost / best, 5), run.cost / best),
                    Number(text.count(run.evaluations), run.evaluations),
                    "converged" if run.converged else run.message,
                )
            )
    columns = [
        Column("estimator"),
        *numbers("start", "cost", "over best", "evaluations"),
        Column("ended", "words"),
    ]
    return table("runs", "Fits from perturbed starts, best first.", columns, rows)
