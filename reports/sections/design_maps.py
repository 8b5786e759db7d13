"""The design map: what candidates would add, the plan, and refusals, over two coordinates."""

import numpy as np
from markupsafe import Markup

from oed.study.parts import DesignedPlan
from oed.study.results import PlannedStudy
from oed.study.stages.candidates import refusals
from reports import text
from reports.figures.design_map import design_map
from reports.figures.map_data import MapData
from reports.page_elements import Figure, figure
from reports.sections.plan_labels import experiments, prismatic
from robotmodels.common.arrays import Array
from robotmodels.elastic.elastic_pose import frame_points, joint_placements
from robotmodels.elastic.rigid_pose import unloaded
from robotmodels.elastic.tool_response import tool_frame

_MOST = 3000  # candidates on a page; refusals are looked for among ten times as many


def drawn_map(results: PlannedStudy, plan: DesignedPlan) -> tuple[Figure, Markup]:
    """Return the map over the two joints with most values, and the data of all of them."""
    positions = plan.information.positions
    sensitivity = plan.design.sensitivity * plan.design.weights.sum()
    shown = np.union1d(plan.used, np.arange(0, len(positions), -(-len(positions) // _MOST)))
    settings = results.study.candidates
    refused, reasons = np.zeros((0, positions.shape[1])), list[str]()
    if settings is not None and plan.candidates.proposed <= 10 * _MOST:
        refused, reasons = refusals(settings, results.robot, plan.candidates)
    weights = plan.design.weights / plan.design.weights.sum()
    data = MapData(
        names=coordinate_names(results),
        candidates=coordinates(results, positions[shown]),
        sensitivity=sensitivity[shown],
        weights=weights[shown],
        plan=coordinates(results, plan.positions),
        visits=[f"{experiments(results, int(i))}, weight {weights[i]:.3g}" for i in plan.used],
        refused=coordinates(results, refused),
        reasons=[rejection_words(one) for one in reasons],
        obstacles=() if settings is None else settings.things,
    )
    values = [len(np.unique(column)) for column in positions.T]
    across, up = sorted(np.argsort(values, kind="stable")[::-1][:2].tolist())
    drawing = design_map(
        data.candidates[:, [across, up]],
        data.sensitivity,
        plan.exact.repetitions[shown],
        [data.names[across], data.names[up]],
    )
    alt = "What candidates would add to the information, and the plan, over two coordinates"
    return figure("design-map", drawing, alt, caption=f"{across} {up}"), data.embedded()


def rejection_words(reasons: str) -> str:
    """Return reasons without quotes, what touches the same thing together.

    ``obstacle, 'a' and 'table'; obstacle, 'b' and 'table'`` becomes
    ``obstacle, a and b with table``.
    """
    together: dict[tuple[str, str], list[str]] = {}
    for one in reasons.replace("'", "").split("; "):
        reason, _, what = one.partition(", ")
        first, _, second = what.rpartition(" and ")
        together.setdefault((reason, second), []).append(first)
    return "; ".join(
        f"{reason}, {text.listed(firsts)} with {second}" if any(firsts) else f"{reason}, {second}"
        for (reason, second), firsts in together.items()
    )


def coordinate_names(results: PlannedStudy) -> list[str]:
    """Return the coordinates with their units: joints, then the tool's."""
    units = ["m" if slides else "°" for slides in prismatic(results)]
    joints = [f"{m} [{u}]" for m, u in zip(results.robot.motor_names, units, strict=True)]
    return [*joints, *(f"tool {axis} [m]" for axis in "xyz")]


def coordinates(results: PlannedStudy, positions: Array) -> Array:
    """Return joints [° or m] and tool [m] of positions (Q, n), (Q, n + 3)."""
    robot, scale = results.robot, np.where(prismatic(results), 1.0, 180 / np.pi)
    placements = joint_placements(robot, unloaded(robot, positions))
    return np.hstack([positions * scale, frame_points(robot, tool_frame(robot), placements)])
