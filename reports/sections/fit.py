"""The fit: costs over starts, and where the result came from."""

import numpy as np

from oed.study.results import FittedStudy, StudyResults
from oed.study.stages.fit_stages import start_number
from reports import text
from reports.figures import study_figures
from reports.page_elements import Column, Number, Section, Table, figure, filled, numbers, table


def section(results: StudyResults) -> Section:
    """Return the section."""
    costs = {
        name: [run.cost for run in search.runs if np.isfinite(run.cost)]
        for name, search in results.searches.items()
    }
    best = {name: best_cost(results, name) for name in costs}
    body = filled(
        "fit.html.j2",
        results=results,
        reached=reached_words(reached(results)),
        distances=distances(results),
        cost=text.significant(results.fit.cost, 6),
        costs=figure(
            "costs",
            study_figures.costs_over_starts(costs, best),
            "Final cost of every fit over the best cost of its estimator, a dot per start",
        ),
        runs=run_table(results),
    )
    return Section("fit", "Fit", body)


def best_cost(results: FittedStudy, name: str) -> float:
    """Return the best cost known of an estimator; the chosen fit's where that is the same."""
    search = results.searches[name]
    kind = search.estimator
    same = (kind.residual, kind.weights, kind.positions) == ("nls", "optimal", "all")
    chosen = results.fit.cost if same and results.fit.residual == "nls" else np.inf
    return min(search.runs[0].cost, chosen)


def reached(results: FittedStudy) -> list[tuple[str, int, int]]:
    """Return, per estimator, how many starts ended at its best cost, and of how many."""
    return [
        (text.residual_label(name), search.reached(best_cost(results, name)), len(search.runs))
        for name, search in results.searches.items()
    ]


def reached_words(found: list[tuple[str, int, int]]) -> str:
    """Return how many starts ended at the best cost, estimators that did alike together."""
    alike: dict[tuple[int, int], list[str]] = {}
    for label, count, of in found:
        alike.setdefault((count, of), []).append(label)
    parts = []
    for (count, of), labels in alike.items():
        many = f"{count} of {of}" if count < of or of == 1 else f"all {of}"
        parts.append(f"{many} with {text.listed(labels)}")
    return "; ".join(parts)


def distances(results: StudyResults) -> list[tuple[str, str]]:
    """Return, per other estimator, how far its estimate lies at most, in standard deviations."""
    if results.theorem1 is None:
        return []
    chosen, rows = results.fit.parameters.values, []
    for name, search in results.searches.items():
        if name != results.fit.residual:
            away = np.abs(np.log(search.result.parameters.values / chosen)) / results.std
            rows.append((text.residual_label(name), text.fixed(float(away.max()), 1)))
    return rows


def run_table(results: StudyResults) -> Table:
    """Return every fit from every start, in the order of estimators and costs."""
    rows = []
    for name, search in results.searches.items():
        best = best_cost(results, name)
        for run in search.runs:
            start = start_number(results.starts, run) + 1
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
