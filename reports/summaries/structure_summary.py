"""Which springs data ask for: what the terminal says, and the same as JSON."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from estimators.structure.score_table import Score
from oed.study.parts import Structure
from reports.summaries.columns import number, plural, table, wrapped
from reports.text import sentence

SHOWN = 12
"""Score tests that are listed."""


def structure_summary(structure: Structure, files: Sequence[Path]) -> str:
    """Return the chosen springs, the steps that led to them, and the strongest score tests."""
    choice = structure.choice
    lines = [f"{plural(len(choice.springs), 'spring')} added: {choice.stopped}"]
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
    if any(choice.twins.values()):
        lines.append("  Springs in one row are indistinguishable: tie them, or fix all but one.")
    if choice.caution:
        lines += wrapped(f"{sentence(choice.caution)}.")
    lines += _steps(structure)
    lines += [f"  {power}" for power in structure.powers]
    scores = [score_words(score) for score in structure.scores[:SHOWN]]
    lines += table(("score test", "p", "size", "95 % interval", "unit"), scores, right=(1, 2))
    return "\n".join([*lines, *(f"  {file}" for file in files)])


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
    return table(("step", "expected", "fall of\nthe cost", "BIC", "held out"), rows, (1, 2, 3, 4))


def score_words(score: Score) -> tuple[str, str, str, str, str]:
    """Return name, probability, size, interval and unit of a score test."""
    low, high = score.interval
    size, least, most = score.estimate, low, high
    unit = score.unit
    if score.spring is not None and score.estimate > 0:
        size, least, most = score.stiffness
        unit = {"rad/(N m)": "N m/rad", "m/N": "N/m"}[unit]
    ends = f"{number(least)} to {number(most) if np.isfinite(most) else 'rigid'}"
    return score.name, number(score.probability, 2), number(size), ends, unit


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
