"""Words for the positions of a plan, its experiments and its runs."""

import numpy as np

from estimators.frf.repeated_visits import visits_of
from oed.study.results import PlannedStudy, StudyResults
from oed.study.robot_time import robot_time
from reports import text
from reports.page_elements import Number
from robotmodels.common.arrays import Array


def counts(results: PlannedStudy) -> dict[str, int]:
    """Return the numbers of experiments and runs; of measured data, of averaged blocks."""
    summary = results.plan_summary
    return {experiment_noun(results): summary.experiments, "run": summary.runs}


def cost(results: PlannedStudy) -> str:
    """Return ``15 visits, 90 runs, 12 min``; a lower bound of the time is called so."""
    words = [text.plural(count, noun) for noun, count in counts(results).items()]
    return ", ".join([*words, *filter(None, [time_words(results)])])


def time_words(results: PlannedStudy) -> str:
    """Return ``12 min`` or ``at least 12 min`` of robot time; nothing if it is unknown."""
    time = robot_time(results)
    if time is None:
        return ""
    return f"{'at least ' if time.bound else ''}{text.duration(time.seconds)}"


def experiments(results: PlannedStudy, candidate: int) -> str:
    """Return the number of experiments in one candidate position, ``2 visits``."""
    return text.plural(int(results.plan.exact.repetitions[candidate]), experiment_noun(results))


def experiment_noun(results: PlannedStudy) -> str:
    """Return the noun of what is counted in a position: measured FRFs tell only blocks."""
    return "block" if results.measured and not results.study.fits_runs else "visit"


def data_words(results: PlannedStudy) -> str:
    """Return what the data are."""
    return "outputs of runs" if results.study.fits_runs else "frequency responses"


def prismatic(results: PlannedStudy) -> list[bool]:
    """Return whether each motor's joint is prismatic."""
    robot = results.robot
    return [joint in robot.elements.prismatic for joint in robot.motor_joints]


def position_cells(results: PlannedStudy, position: Array) -> list[Number]:
    """Return the entries of a table for a position (n,) [rad or m], in degrees or m."""
    straight = prismatic(results)
    shown = np.where(straight, position, np.degrees(position))
    return [
        Number(text.fixed(float(value), 3 if sliding else 0), float(value))
        for value, sliding in zip(shown, straight, strict=True)
    ]


def position_units(results: PlannedStudy) -> list[str]:
    """Return the unit of each coordinate in tables."""
    return ["m" if straight else "°" for straight in prismatic(results)]


def visit_labels(results: StudyResults) -> list[str]:
    """Return a label for each visit of runs: the position's, and which visit to it."""
    return _of_visits(results, labels(results))


def visit_numbers(results: StudyResults) -> list[str]:
    """Return ``1``, or ``1, visit 2`` where there are several, for each visit of runs."""
    return _of_visits(results, [str(q + 1) for q in range(len(results.plan.used))])


def _of_visits(results: StudyResults, of_positions: list[str]) -> list[str]:
    if results.measured:
        return of_positions
    visits = visits_of(results.data.estimate.positions)
    words = [""] * len(results.data.estimate.positions)
    for label, several in zip(of_positions, visits, strict=True):
        for count, visit in enumerate(several, start=1):
            words[visit] = f"{label}, visit {count}" if len(several) > 1 else label
    return words


def labels(results: PlannedStudy) -> list[str]:
    """Return a label for each position of the plan: number, angles, experiments."""
    straight = prismatic(results)
    position_labels = []
    for number, i in enumerate(results.plan.used, start=1):
        angles = ", ".join(text.format_position(results.plan.information.positions[i], straight))
        position_labels.append(f"Position {number}: {angles}; {experiments(results, int(i))}")
    return position_labels
