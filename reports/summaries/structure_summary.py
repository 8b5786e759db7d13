"""Which springs data ask for: what the terminal says, and the same as JSON."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from estimators.structure.choose_structure import StructureChoice
from estimators.structure.score_table import Score
from oed.study.parts import Structure
from reports.summaries.columns import hung, number, plural, table, wrapped

SHOWN = 12
"""Score tests that are listed."""


def structure_summary(structure: Structure, files: Sequence[Path]) -> str:
    """Return the chosen springs, the steps that led to them, and the strongest score tests."""
    choice = structure.choice
    verdict, step = structure_advice(choice)
    lines = [f"structure  {verdict}"]
    lines += wrapped(f"{plural(len(choice.springs), 'spring')} added: {choice.stopped}")
    springs = [
        (
            spring.name,
            number(float(str(spring.stiffness)), 4),
            number(spring.damping, 3),
            ", ".join(choice.twins[spring.name]),
        )
        for spring in choice.springs
    ]
    if springs:
        header = ("spring", "stiffness\n[N m/rad]", "damping\n[N m s/rad]", "indistinguishable")
        lines += table(header, springs, right=(1, 2))
    lines += _steps(structure)
    lines += [f"  {power}" for power in structure.powers]
    scores = [score_words(score) for score in structure.scores[:SHOWN]]
    lines += table(("score test", "p", "size", "95 % interval", "unit"), scores, right=(1, 2))
    lines += wrapped("sizes of springs are compliances")
    lines += hung("next     ", step, indent=9)
    return "\n".join([*lines, *(f"written  {file}" for file in files)])


def _steps(structure: Structure) -> list[str]:
    """Return the table of the steps."""
    choice = structure.choice
    misfits = structure.held_out or (np.nan,) * (len(choice.steps) + 1)
    rows = [("as it is", "", "", number(choice.bic[0], 6), number(misfits[0], 4))]
    for step, misfit in zip(choice.steps, misfits[1:], strict=True):
        instead = f" for {step.instead_of}" if step.instead_of else ""
        falls = number(step.expected, 3), number(step.fall, 3)
        what = f"{step.action} {step.spring}{instead}"
        rows.append((what, *falls, number(step.bic, 6), number(misfit, 4)))
    if structure.held_out is None:
        rows = [(*row[:4], "") for row in rows]
    return table(
        ("step", "expected\ndecrease", "decrease\nin cost", "BIC", "held out"), rows, (1, 2, 3, 4)
    )


def score_words(score: Score) -> tuple[str, str, str, str, str]:
    """Return name, probability, size, interval and unit of a score test."""
    low, high = score.interval
    ends = f"{number(low)} to {number(high)}"
    return score.name, number(score.probability, 2), number(score_size(score)), ends, score.unit


def score_size(score: Score) -> float:
    """Return the estimate of a score test; of a spring its compliance, which is not negative."""
    return score.estimate if score.spring is None else max(score.estimate, 0.0)


def structure_advice(choice: StructureChoice) -> tuple[str, str]:
    """Return what the choice of springs says of the robot file, and what to do next."""
    count = len(choice.springs)
    if choice.caution:
        return f"{plural(count, 'spring')} added, but the robot file is in doubt", choice.caution
    if not count:
        return "No spring is missing", "keep the springs of the robot file"
    step = "fit again with structure.yaml, the robot file with the springs"
    if any(choice.twins[one.name] for one in choice.springs):
        step += "; of springs in one row the data cannot tell which it is: tie or fix all but one"
    return f"{plural(count, 'spring')} missing in the robot file", step


def structure_json(structure: Structure, files: Sequence[Path]) -> dict[str, object]:
    """Return the same for scripts; numbers that are not finite are null."""
    choice = structure.choice
    return {
        "springs": [
            spring.model_dump(exclude_none=True) | {"twins": list(choice.twins[spring.name])}
            for spring in choice.springs
        ],
        "stopped": choice.stopped,
        "contradicted": list(choice.contradicted),
        "bic": list(choice.bic),
        "held_out": structure.held_out,
        "powers": [vars(power) for power in structure.powers],
        "steps": [
            {
                "action": step.action,
                "spring": step.spring,
                "instead_of": step.instead_of,
                "expected": step.expected,
                "fall": step.fall,
                "bic": step.bic,
            }
            for step in choice.steps
        ],
        "scores": [
            {
                "name": score.name,
                "spring": score.spring is not None,
                "probability": score.probability,
                "estimate": score.estimate,
                "std": score.std,
                "interval": list(score.interval),
                "unit": score.unit,
                "fall": score.fall,
                "twins": list(score.twins),
            }
            for score in structure.scores
        ],
        "files": [str(file) for file in files],
    }
