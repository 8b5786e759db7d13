"""Where the model fails: the parts of the robot whose score tests are significant."""

import re
from collections.abc import Iterable

import numpy as np

from estimators.trust.rule import LEVEL
from oed.study.results import FittedStudy, StudyResults
from reports import text
from reports.figures.robot_bodies import robot_drawings
from reports.page_elements import Figure
from robotmodels.elastic.rigid_pose import part_origins

MARKED = 4
"""Parts with the strongest evidence, which the picture marks."""


def picture(results: StudyResults) -> Figure | None:
    """Return the robot with the parts marked whose tests are significant; None if none are.

    It is drawn in the position that fits worst.
    """
    tests, robot, positions = results.trust.tests, results.robot, results.plan.positions
    fired, number = tests.significant(LEVEL), worst_position(results)
    position = positions[number]
    points, marked = part_origins(robot, position), dict[str, str]()
    for i in fired:
        name, value = tests.names[i], float(tests.probabilities[i])
        if (part := part_of(name, points)) is not None and len(marked) < MARKED:
            marked.setdefault(part, f"{name} (p-value {text.probability(value)})")
    if not marked:
        return None
    named = text.listed([f"{k} {words}" for k, words in enumerate(marked.values(), start=1)])
    caption = f"Where the model fails, drawn in position {number + 1}: {named}."
    marks = np.array([points[part] for part in marked])
    alt = f"The robot. {caption}"
    (drawing,) = robot_drawings(robot, position[None], [alt], marks=[marks]).drawings
    return Figure("model-errors", drawing, caption)


def worst_position(results: FittedStudy) -> int:
    """Return the position of the plan that fits worst, counted from 0."""
    misfits = results.fits.residuals.by_position
    return int(np.argmax(misfits)) if len(misfits) == len(results.plan.positions) else 0


def part_of(test: str, parts: Iterable[str]) -> str | None:
    """Return the spring, motor or payload that a test such as ``gain of m1`` is of."""
    name = re.sub(r"^(gain|gear ratio) of ", "", test).split(" ")[0]
    named = [one for one in parts if name == one or name.startswith(f"{one}.")]
    return max(named, key=len, default=None)
