"""How positions are written."""

from oed.study.results import StudyResults
from reports import text
from reports.page_elements import Number
from reports.sections.cost import visits
from robotmodels.common.arrays import Array


def prismatic(results: StudyResults) -> list[bool]:
    """Return whether each motor's joint is prismatic."""
    robot = results.robot
    return [joint in robot.elements.prismatic for joint in robot.motor_joints]


def place_numbers(results: StudyResults, position: Array) -> list[Number]:
    """Return the entries of a table for a position (n,) [rad or m]."""
    words = text.places(position, prismatic(results))
    return [Number(word, float(value)) for word, value in zip(words, position, strict=True)]


def labels(results: StudyResults) -> list[str]:
    """Return a label for each position of the plan: number, angles, visits."""
    straight = prismatic(results)
    found = []
    for number, i in enumerate(results.used, start=1):
        angles = ", ".join(text.places(results.information.positions[i], straight))
        found.append(f"Position {number}: {angles}; {visits(results, int(i))}")
    return found
