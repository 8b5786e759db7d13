"""Plans compared: simulations of the optimal plan and of its alternatives."""

import numpy as np

from oed.plan_comparison.plan_comparison import PlanComparison, SimulatedPlan, UnidentifiedPlan
from oed.study.results import StudyResults
from oed.study.stages.comparison import OPTIMAL
from reports import text
from reports.figures import uncertainty_figures
from reports.page_elements import (
    Cell,
    Column,
    Figure,
    Number,
    Section,
    Table,
    figure,
    filled,
    numbers,
    percent_cell,
    table,
)
from reports.sections.plan_labels import cost
from robotmodels.common.arrays import Array


def section(results: StudyResults) -> Section | None:
    """Return the section; none where plans were not simulated."""
    comparison = results.comparison
    if comparison is None:
        return None
    optimal = comparison.optimal
    ratio, ends = optimal.std / optimal.predicted.std, optimal.std_interval()
    inside = (ends[:, 0] <= optimal.predicted.std) & (optimal.predicted.std <= ends[:, 1])
    body = filled(
        "comparison.html.j2",
        comparison=comparison,
        study=results.study,
        runs=len(optimal.simulation.estimates) + len(optimal.simulation.failures),
        failures=sum(
            len(plan.simulation.failures)
            for plan in comparison.plans
            if isinstance(plan, SimulatedPlan)
        ),
        cost=cost(results),
        grid=results.study.compare.grid,
        best=_best(comparison),
        ratios=(text.fixed(float(ratio.min()), 2), text.fixed(float(ratio.max()), 2)),
        inside=int(inside.sum()),
        plans=plan_table(comparison),
        stds=std_table(comparison),
        picture=picture(comparison),
    )
    return Section("comparison", "Plans compared", body)


def plan_table(comparison: PlanComparison) -> Table:
    """Return the relative efficiency of each plan, predicted and simulated."""
    rows: list[list[Cell]] = []
    p = len(comparison.names)
    for k, trial in enumerate(comparison.plans):
        row: list[Cell] = [trial.name, Number(str(len(trial.support)), len(trial.support))]
        efficiency = (comparison.predicted[k], comparison.simulated[k], *comparison.interval[k])
        row += [Number(text.fixed(float(v), 2), float(v)) for v in efficiency[:2]]
        if not k:
            rows.append([*row, "–", "–", "–"])
            continue
        _, clear, against = comparison.more_certain(k)
        between = f"{text.fixed(float(efficiency[2]), 2)} to {text.fixed(float(efficiency[3]), 2)}"
        if isinstance(trial, UnidentifiedPlan):
            between = f"does not identify {text.listed(list(trial.unidentified))}"
        row += [between, Number(f"{clear} of {p}", clear)]
        rows.append([*row, Number(str(against), against)])
    columns = [
        Column("plan"),
        *numbers("positions", "relative efficiency, predicted", "simulated"),
        Column("95 % interval [–]"),
        *numbers("smaller variance with the optimal plan", "larger variance"),
    ]
    caption = (
        "Relative efficiency of each plan against the optimal one, by its information matrix and "
        "by the scatter of repeated simulations; number of parameters whose variance is "
        "significantly smaller or larger with the optimal plan (F test, 5 %)."
    )
    return table("plans", caption, columns, rows)


def std_table(comparison: PlanComparison) -> Table:
    """Return standard deviations of every parameter, predicted and simulated, plan by plan."""
    groups = _groups(comparison)
    rows: list[list[Cell]] = []
    for i, name in enumerate(comparison.names):
        row: list[Cell] = [name]
        for _, trials in groups:
            predicted = _mean([t.predicted.std[i] for t in trials])
            std = _mean([t.std[i] for t in trials])
            row += [percent_cell(predicted), percent_cell(std)]
        rows.append(row)
    titles = [f"{name}: {what} [%]" for name, _ in groups for what in ("Theorem 1", "simulated")]
    caption = (
        "Relative standard deviations by Theorem 1 and over the repeated simulations; of "
        "random plans the geometric mean."
    )
    return table("plan-stds", caption, [Column("parameter", code=True), *numbers(*titles)], rows)


def picture(comparison: PlanComparison) -> Figure:
    """Return simulated standard deviations, with intervals of the plan and the designer's grid."""
    shown = [(name, plans) for name, plans in _groups(comparison) if plans]
    stds: list[Array] = [np.stack([t.std for t in trials]) for _, trials in shown]
    ends = [trials[0].std_interval() if len(trials) == 1 else None for _, trials in shown]
    drawing = uncertainty_figures.deviations(
        comparison.names, stds, [name for name, _ in shown], ends
    )
    return figure(
        "plan-deviations",
        drawing,
        "Standard deviations of every parameter over repeated simulations, by each plan",
    )


def _groups(comparison: PlanComparison) -> list[tuple[str, list[SimulatedPlan]]]:
    """Return the plan, the designer's, and all random ones together; none of those left open."""
    groups: dict[str, list[SimulatedPlan]] = {}
    for plan in comparison.plans:
        name = "random" if plan.name.startswith("random") else plan.name
        groups.setdefault(name, []).extend([plan] if isinstance(plan, SimulatedPlan) else [])
    return list(groups.items())


def _best(comparison: PlanComparison) -> dict[str, str]:
    """Return the best alternative: its name and relative efficiency."""
    k = 1 + int(np.argmax(comparison.simulated[1:])) if len(comparison.plans) > 1 else 0
    low, high = (text.fixed(float(v), 2) for v in comparison.interval[k])
    return {
        "name": comparison.plans[k].name if k else OPTIMAL,
        "relative_efficiency": text.fixed(float(comparison.simulated[k]), 2),
        "low": low,
        "high": high,
    }


def _mean(stds: list[float]) -> float:
    return float(np.exp(np.mean(np.log(stds)))) if stds else float("nan")
