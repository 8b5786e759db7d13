"""The positions of the plan: pictures of the robot and a table."""

from dataclasses import dataclass, replace

import numpy as np
from markupsafe import Markup

from oed.study.parts import DesignedPlan, MeasuredPlan
from oed.study.results import FittedStudy, PlannedStudy, StudyResults
from reports import text
from reports.figures.robot_bodies import RobotDrawings, robot_drawings
from reports.page_elements import Cell, Number, Section, Table, filled, numbers, table
from reports.sections.plan_labels import (
    experiment_noun,
    experiments,
    position_cells,
    position_units,
    prismatic,
)
from robotmodels.common.arrays import Array
from robotmodels.elastic.mode_pictures import mode_movements


@dataclass(frozen=True)
class Pose:
    """A picture of the robot in a position."""

    number: int
    experiments: str
    drawing: Markup
    residuals: str = ""
    outlying: bool = False
    modes: tuple[str, ...] = ()


def section(results: PlannedStudy) -> Section:
    """Return the section."""
    drawn, modes = drawings(results), mode_words(results)
    body = filled(
        "positions.html.j2",
        results=results,
        tool=isinstance(results, StudyResults) and results.tool is not None,
        poses=poses(results, drawn.drawings, modes),
        told=modes,
        bodies=drawn.bodies,
        positions=position_table(results),
    )
    return Section("positions", "Positions", body)


def drawings(results: PlannedStudy) -> RobotDrawings:
    """Return pictures of the robot in each position, which its modes can move."""
    robot, positions = results.robot, results.plan.positions
    values = results.fits.result.parameters.values if isinstance(results, FittedStudy) else None
    straight = prismatic(results)
    alts = [
        f"The robot in position {number}: {', '.join(text.format_position(position, straight))}"
        for number, position in enumerate(positions, start=1)
    ]
    modes = [mode_movements(robot, position, values) for position in positions]
    return robot_drawings(robot, positions, alts, modes=modes)


def mode_words(results: PlannedStudy) -> list[tuple[str, ...]]:
    """Return what is said of the modes in each of the first positions, if anything."""
    modes = results.free_modes if isinstance(results, StudyResults) else None
    if modes is None:
        return []
    factors = np.array([1 / (2 * np.pi), 100.0])[:, None]
    ends = (factors * part for part in (modes.values.real, modes.lower, modes.upper))
    return [
        tuple(_mode_words(*position[:, k]) for k in range(position.shape[1]))
        for position in np.stack([*ends], axis=-1)
    ]


def _mode_words(frequency: Array, damping: Array) -> str:
    """Return the words of a mode: resonance [Hz] and damping [%] with the ends of their bands."""
    hertz, percent = (text.value_and_ends(*map(float, one)) for one in (frequency, damping))
    words = f"{hertz[0]} Hz ({hertz[1]})"
    return f"{words}, damping {percent[0]} % ({percent[1]})" if np.isfinite(damping[0]) else words


def poses(
    results: PlannedStudy, pictures: list[Markup], modes: list[tuple[str, ...]]
) -> list[Pose]:
    """Return the pictures of all positions with their numbers of experiments."""
    told = [*modes, *[()] * (len(pictures) - len(modes))]
    shown = [
        Pose(number, experiments(results, int(i)), drawing, modes=told[number - 1])
        for number, (i, drawing) in enumerate(
            zip(results.plan.used, pictures, strict=True), start=1
        )
    ]
    return _with_residuals(results, shown)


def _with_residuals(results: PlannedStudy, pictures: list[Pose]) -> list[Pose]:
    """Return the pictures with how well the model fits in each position, where data were fitted."""
    if not isinstance(results, FittedStudy):
        return pictures
    analysis = results.fits.residuals
    if len(analysis.by_position) != len(pictures):
        return pictures
    return [
        replace(pose, residuals=text.fixed(float(ratio), 2), outlying=q in analysis.outlying)
        for q, (pose, ratio) in enumerate(zip(pictures, analysis.by_position, strict=True))
    ]


def position_table(results: PlannedStudy) -> Table:
    """Return the table of positions; without shares if the positions come with the data."""
    plan, measured = results.plan, results.measured
    rows = []
    for number, i in enumerate(plan.used, start=1):
        position = plan.information.positions[i]
        row: list[Cell] = [Number(str(number), number)]
        row += position_cells(results, position)
        if not measured:
            share = float(plan.design.weights[i] / plan.design.weights.sum())
            row.append(Number(text.fixed(share, 4) if share else "–", share))
        count = int(plan.exact.repetitions[i])
        rows.append([*row, Number(str(count), count)])
    axes = zip(results.robot.motor_names, position_units(results), strict=True)
    titles = ["no.", *(f"{motor} [{unit}]" for motor, unit in axes)]
    titles += [] if measured else ["share"]
    titles.append(f"{experiment_noun(results)}s")
    shares = "" if measured else f"; {_shares(plan)}"
    order = (
        ""
        if not isinstance(plan, DesignedPlan) or plan.order is None
        else "; numbers and rows in the order of visits"
    )
    caption = (
        f"Motor angles over gear ratios; files have them in rad{shares}; "
        f"{experiment_noun(results)}s, each of {text.plural(plan.runs_per_visit, 'run')}{order}."
    )
    return table("plan", caption, numbers(*titles), rows)


def _shares(plan: DesignedPlan | MeasuredPlan) -> str:
    """Return what the column of shares holds, and what of it the plan leaves out."""
    weights = plan.design.weights / plan.design.weights.sum()
    omitted = len(set(plan.design.support) - set(plan.used))
    words = "share of the visits in the relaxed (continuous) design (–: none)"
    if not omitted:
        return words
    share = 1 - float(weights[plan.used].sum())
    return (
        f"{words}, {text.fixed(share, 4)} of which belongs to {text.plural(omitted, 'position')} "
        "without a visit in the integer plan"
    )
