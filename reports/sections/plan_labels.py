"""How the positions of a plan, its visits and its runs are written."""

from oed.study.results import PlannedStudy, StudyResults
from reports import text
from reports.page_elements import Number
from robotmodels.common.arrays import Array


def counts(results: PlannedStudy) -> dict[str, int]:
    """Return how many visits and runs; of measured data, how many blocks were averaged."""
    summary = results.plan_summary
    return {visit_noun(results): summary.experiments, "run": summary.runs}


def cost(results: PlannedStudy) -> str:
    """Return ``15 visits, 90 runs``."""
    return ", ".join(text.plural(count, noun) for noun, count in counts(results).items())


def visits(results: PlannedStudy, candidate: int) -> str:
    """Return how often one candidate is visited, ``2 visits``."""
    return text.plural(int(results.plan.exact.repetitions[candidate]), visit_noun(results))


def visit_noun(results: PlannedStudy) -> str:
    """Return what is counted in a position: of measured data only the blocks are known."""
    return "block" if results.measured else "visit"


def prismatic(results: StudyResults) -> list[bool]:
    """Return whether each motor's joint is prismatic."""
    robot = results.robot
    return [joint in robot.elements.prismatic for joint in robot.motor_joints]


def position_cells(results: StudyResults, position: Array) -> list[Number]:
    """Return the entries of a table for a position (n,) [rad or m]."""
    words = text.format_position(position, prismatic(results))
    return [Number(word, float(value)) for word, value in zip(words, position, strict=True)]


def labels(results: StudyResults) -> list[str]:
    """Return a label for each position of the plan: number, angles, visits."""
    straight = prismatic(results)
    position_labels = []
    for number, i in enumerate(results.plan.used, start=1):
        angles = ", ".join(text.format_position(results.plan.information.positions[i], straight))
        position_labels.append(f"Position {number}: {angles}; {visits(results, int(i))}")
    return position_labels
