"""The positions of the plan: pictures of the robot and a table."""

from dataclasses import dataclass

from markupsafe import Markup

from oed.study.results import StudyResults
from reports import text
from reports.figures import robot_pictures
from reports.page_elements import Cell, Number, Section, Table, filled, numbers, table
from reports.sections.plan_labels import place_numbers, prismatic, visit_noun, visits
from robotmodels.elastic.rigid_pose import joint_origins


@dataclass(frozen=True)
class Pose:
    """A picture of the robot in a position."""

    number: int
    visits: str
    drawing: Markup


def section(results: StudyResults) -> Section:
    """Return the section."""
    body = filled(
        "positions.html.j2",
        results=results,
        poses=poses(results),
        positions=position_table(results),
    )
    return Section("positions", "Positions", body)


def poses(results: StudyResults) -> list[Pose]:
    """Return a picture of the robot in each position."""
    positions = results.information.positions[results.used]
    skeletons = [joint_origins(results.robot, position) for position in positions]
    scene = robot_pictures.scene_of(skeletons)
    straight, found = prismatic(results), []
    for number, (i, skeleton) in enumerate(zip(results.used, skeletons, strict=True), start=1):
        angles = ", ".join(text.places(results.information.positions[i], straight))
        alt = f"Stick figure of the robot in position {number}: {angles}"
        drawing = robot_pictures.stick_figure(skeleton, scene, alt)
        found.append(Pose(number, visits(results, int(i)), drawing))
    return found


def position_table(results: StudyResults) -> Table:
    """Return the table of positions; without shares where they were given with the data."""
    measured = results.study.data.measured
    rows = []
    for number, i in enumerate(results.used, start=1):
        position = results.information.positions[i]
        row: list[Cell] = [Number(str(number), number)]
        row += place_numbers(results, position)
        if not measured:
            share = float(results.design.weights[i] / results.design.weights.sum())
            row.append(Number(text.fixed(share, 4) if share else "–", share))
        count = int(results.exact.repetitions[i])
        rows.append([*row, Number(str(count), count)])
    titles = ["no.", *results.robot.motor_names, *([] if measured else ["share"])]
    titles.append(f"{visit_noun(results)}s")
    shares = "" if measured else f"; {_shares(results)}"
    order = "" if results.order is None else "; numbers and rows in the order of visits"
    caption = (
        f"Motor angles over gear ratios, in degrees here and in radians in files{shares}; "
        f"{visit_noun(results)}s, each of {text.plural(results.runs_per_visit, 'run')}{order}."
    )
    return table("plan", caption, numbers(*titles), rows)


def _shares(results: StudyResults) -> str:
    """Return what the column of shares holds, and what of it the plan leaves out."""
    weights = results.design.weights / results.design.weights.sum()
    left = len(set(results.design.support) - set(results.used))
    words = "share of the visits if they could be split at will (–: none)"
    if not left:
        return words
    rest = 1 - float(weights[results.used].sum())
    return (
        f"{words}, {text.fixed(rest, 4)} of which belongs to {text.plural(left, 'position')} "
        "where whole visits are better spent elsewhere"
    )
