"""The candidates: where the robot might be put."""

import numpy as np

from oed.study import StudyResults
from reports import text
from reports.parts import Column, Number, Section, Table, numbers, table
from reports.sections.places import prismatic
from reports.template import filled


def section(results: StudyResults) -> Section | None:
    """Return the section; none where positions were not chosen."""
    if results.study.candidates is None:
        return None
    count = len(results.information.positions)
    body = filled("candidates.html.j2", results=results, count=count, grid=grid_table(results))
    return Section("candidates", "Candidates", body)


def grid_table(results: StudyResults) -> Table:
    """Return the table of joints: limits, and the range of the candidates."""
    robot, positions, straight = results.robot, results.information.positions, prismatic(results)
    limits = [_row(side, straight) for side in robot.position_limits.T]
    ends = [_row(side, straight) for side in (positions.min(axis=0), positions.max(axis=0))]
    rows = [
        (
            joint,
            limits[0][i],
            limits[1][i],
            ends[0][i],
            ends[1][i],
            Number(str(points), points),
        )
        for i, joint in enumerate(robot.motor_joints)
        if (points := len(np.unique(positions[:, i])))
    ]
    columns = [
        Column("joint"),
        *numbers("lower limit", "upper limit", "candidates from", "to", "points"),
    ]
    caption = "Limits of the joints, and the candidates within them."
    return table("grid", caption, columns, rows)


def _row(values: np.ndarray, straight: list[bool]) -> list[Number]:
    words = text.places(values, straight)
    return [Number(word, float(value)) for word, value in zip(words, values, strict=True)]
