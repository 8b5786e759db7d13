"""How positions are written."""

from oed.study import StudyResults
from reports import text


def prismatic(results: StudyResults) -> list[bool]:
    """Return whether each motor's joint is prismatic."""
    robot = results.robot
    return [joint in robot.elements.prismatic for joint in robot.motor_joints]


def labels(results: StudyResults) -> list[str]:
    """Return a label for each position of the plan: number, angles, experiments."""
    straight = prismatic(results)
    found = []
    for number, i in enumerate(results.used, start=1):
        angles = ", ".join(text.places(results.information.positions[i], straight))
        experiments = text.plural(int(results.exact.repetitions[i]), "experiment")
        found.append(f"Position {number}: {angles}; {experiments}")
    return found
