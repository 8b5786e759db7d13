"""The design: efficiency of the positions, its certificate, and the limits on them."""

import numpy as np

from oed.design.design import Design
from oed.design.robust_design import RobustDesign
from oed.experiment.visiting_order import VisitingOrder
from oed.study.parts import DesignedPlan
from oed.study.results import FittedStudy, PlannedStudy
from oed.study.robot_time import growing_time, visit_seconds
from oed.study.settings.design_settings import DesignChoice
from oed.study.settings.study_file import Study
from reports import text
from reports.figures import plan_figures, study_figures
from reports.page_elements import (
    Column,
    Figure,
    Number,
    Section,
    Table,
    figure,
    filled,
    in_unit,
    numbers,
    percent_cell,
    table,
)
from reports.sections.design_maps import drawn_map
from reports.sections.plan_labels import cost
from reports.sections.verdict import discredited


def section(results: PlannedStudy) -> Section:
    """Return the section; of measured data, the expected standard deviations alone."""
    plan, summary = results.plan, results.plan_summary
    if not isinstance(plan, DesignedPlan):
        shown = filled(
            "design_measured.html.j2", summary=summary, predicted=predicted_table(results)
        )
        return Section("design", "Design", shown)
    design, robust = plan.design, plan.robust
    sensitivity = figure(
        "sensitivity",
        # Per share of all experiments, whether weights are shares or numbers of experiments.
        study_figures.sensitivity_function(
            design.sensitivity * design.weights.sum(), design.support
        ),
        "Sensitivity of every candidate position in falling order, those of the design marked",
    )
    least = () if robust is None else (robust.efficiency.min(), robust.nominal_efficiency.min())
    body = filled(
        "design.html.j2",
        study=results.study,
        design=design,
        summary=summary,
        parameters=len(design.names),
        cost=cost(results),
        predicted=predicted_table(results),
        purpose=None if results.purpose_std is None else text.percent(results.purpose_std),
        powers=results.powers,
        ends=[(one.name, text.percent(one.std)) for one in (summary.best, summary.worst)],
        gap=text.one_and(summary.gap),
        efficiency=text.efficiency(summary.efficiency),
        limits=text.listed(limits(results.study.design)),
        visiting=None if plan.order is None else visiting(plan, plan.order, results.study.design),
        robust=None if robust is None else robust_table(robust),
        samples=0 if robust is None else len(robust.efficiency),
        least=[text.percent(float(value)) for value in least],
        sensitivity=sensitivity,
        convergence=convergence(design),
        shared_moves=plan.order is not None and visit_seconds(results.study, plan) is not None,
        growth=growth(plan, results.study),
        map=drawn_map(results, plan),
    )
    return Section("design", "Design", body)


def convergence(design: Design) -> Figure | None:
    """Return the gap after each round of the solver; None where there was only one."""
    if design.rounds < 2:
        return None
    drawing = study_figures.convergence(design.gaps, design.gap)
    return figure("rounds", drawing, "Certified gap after each round of the solver")


def growth(plan: DesignedPlan, study: Study) -> Figure:
    """Return standard deviations after each visit, the most informative visits first."""
    nested = plan.nested
    first = text.listed([str(q + 1) for q in nested.positions])
    time = growing_time(study, plan, nested.order)
    cost, label = (
        (np.arange(1, len(nested.order) + 1), "visits")
        if time is None
        else (time / 60, "robot time [min]")
    )
    certified = plan.design.criterion == "D" and not study.design.limited and plan.robust is None
    bound = nested.efficiency(plan.design, plan.visit_share) if certified else None
    names = plan.information.names
    drawing = plan_figures.trade_off(cost, nested.std, names, bound=bound, label=label)
    alt = f"Largest and median standard deviation over {label}"
    return figure("growth", drawing, alt, caption=first)


def limits(choice: DesignChoice) -> list[str]:
    """Return in words the limits of the plan besides the number of experiments."""
    phrases = []
    if choice.most is not None:
        phrases.append(f"at most {text.plural(choice.most, 'visit')} in one position")
    if choice.time is not None:
        phrases.append(f"{text.duration(choice.time)} for visits and moves")
    if choice.mandatory:
        phrases.append(f"{text.plural(len(choice.mandatory), 'mandatory position')}")
    if choice.forbidden:
        phrases.append(f"{text.plural(len(choice.forbidden), 'forbidden range')}")
    for name, group in choice.groups.items():
        least = [f"at least {group.least}"] if group.least else []
        most = [] if group.most is None else [f"at most {group.most}"]
        phrases.append(f"{' and '.join(least + most)} in the group {name}")
    return phrases


def visiting(plan: DesignedPlan, order: VisitingOrder, choice: DesignChoice) -> dict[str, str]:
    """Return in words how the positions are visited, and how long that takes."""
    total = ""
    if choice.time is not None and choice.measuring is not None:
        total = text.duration(plan.visits * choice.measuring + order.duration)
    return {
        "duration": text.duration(order.duration),
        "given": text.duration(order.unordered_duration),
        "total": total,
        "budget": "" if choice.time is None else text.duration(choice.time),
        "optimal": "yes" if order.optimal else "",
    }


def predicted_table(results: PlannedStudy) -> Table:
    """Return predicted and recommended standard deviations of each parameter."""
    rows = []
    trust = results.trust if isinstance(results, FittedStudy) else None
    std = {} if trust is None else dict(zip(trust.names, trust.std, strict=True))
    why = {} if trust is None else {one.name: discredited(one) for one in trust.intervals}
    for one in results.plan_summary.predicted:
        came = _std(float(std.get(one.name, float("nan"))), why.get(one.name, ""))
        rows.append((one.name, _std(one.std), came))
    columns = [Column("parameter", code=True), *in_unit("%", "expected", "recommended")]
    caption = (
        "Relative standard deviations: expected by the plan’s information matrix at the values of "
        "the robot file, and recommended after the fit."
    )
    return table("predicted", caption, columns, rows)


def _std(value: float, struck: str = "") -> Number:
    return percent_cell(value, struck, unbounded="undetermined")


def robust_table(robust: RobustDesign) -> Table:
    """Return the efficiency of the robust and of the nominal design at each sample of theta."""
    rows = []
    pairs = zip(robust.efficiency, robust.nominal_efficiency, strict=True)
    for k, values in enumerate(pairs):
        row = [Number("file" if not k else str(k), k)]
        rows.append([*row, *(percent_cell(float(v)) for v in values)])
    caption = "Efficiency at each parameter sample, relative to the optimal design for that sample."
    return table(
        "robust", caption, numbers("sample", "robust design [%]", "nominal design [%]"), rows
    )
