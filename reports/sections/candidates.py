"""The candidate positions: their ranges, and reasons for rejection."""

import numpy as np

from oed.candidates.screening import ScreenedCandidates
from oed.study.parts import DesignedPlan
from oed.study.results import PlannedStudy
from reports import text
from reports.page_elements import (
    Column,
    Number,
    Row,
    Section,
    Table,
    filled,
    in_shared_unit,
    numbers,
    table,
)
from reports.sections.plan_labels import position_cells, position_units


def section(results: PlannedStudy) -> Section | None:
    """Return the section; None if the positions were not designed."""
    plan = results.plan
    if not isinstance(plan, DesignedPlan):
        return None
    screened = plan.candidates
    body = filled(
        "candidates.html.j2",
        results=results,
        screened=screened,
        ranges=range_table(results),
        removals=removal_table(screened) if screened.removals else None,
    )
    return Section("candidates", "Candidates", body)


def range_table(results: PlannedStudy) -> Table:
    """Return the table of joints: limits, and the range of the candidates."""
    robot, positions = results.robot, results.plan.information.positions
    sides = [
        position_cells(results, side)
        for side in (*robot.position_limits.T, positions.min(axis=0), positions.max(axis=0))
    ]
    rows: list[Row] = []
    units = position_units(results)
    for i, joint in enumerate(robot.motor_joints):
        values = len(np.unique(positions[:, i]))
        rows.append(
            (joint, *(side[i] for side in sides), units[i], Number(text.count(values), values))
        )
    columns = [
        Column("joint"),
        *numbers("lower limit", "upper limit", "candidates from", "to"),
        Column("unit", "u"),
        *numbers("distinct values"),
    ]
    caption = "Limits of the joints, and the candidates within them."
    return in_shared_unit(table("ranges", caption, columns, rows))


def removal_table(screened: ScreenedCandidates) -> Table:
    """Return the reasons for rejection, the most frequent first."""
    rows = [
        (removal.reason, removal.what, Number(text.count(removal.count), removal.count))
        for removal in screened.removals
    ]
    columns = [Column("reason"), Column("of", "words"), *numbers("positions")]
    caption = "Reasons for rejection; a position can be counted under several."
    return table("removals", caption, columns, rows)
