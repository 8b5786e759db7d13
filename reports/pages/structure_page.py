"""The page of ``oed structure``: springs that data ask for, and the score tests that say so."""

from pathlib import Path

from markupsafe import Markup

from estimators.structure.score_table import Score
from oed.study.parts import Structure
from oed.study.results import FittedStudy
from reports import text
from reports.figures.robot_bodies import RobotDrawings, robot_drawings
from reports.page_elements import (
    Cell,
    Column,
    Number,
    Section,
    Table,
    filled,
    numbers,
    page,
    page_banner,
    table,
)
from reports.sections.model_errors import worst_position
from reports.summaries.structure_summary import score_size, structure_advice
from robotmodels.common.atomic_files import write_text
from robotmodels.elastic.rigid_pose import spring_origins

_UNITS = {"relative": "–", "standard deviations": "std"}

MARKED = 4
"""Springs with the strongest evidence, which the picture marks."""


def write_structure_page(results: FittedStudy, structure: Structure, path: Path) -> None:
    """Write the choice of springs as one HTML file that needs nothing else."""
    choice = structure.choice
    choice_body = filled(
        "structure.html.j2",
        stopped=choice.stopped,
        springs=spring_table(structure),
        twins=any(choice.twins.values()),
        steps=step_table(structure),
        powers=structure.powers,
    )
    drawing, caption = suspects(results, structure)
    scores_body = filled(
        "structure_scores.html.j2",
        count=len(structure.scores),
        picture=drawing,
        caption=caption,
        scores=score_table(structure),
    )
    content = page(
        title=results.robot.name,
        kind="structure from data",
        kicker="Structure identification",
        lead="Springs in addition to those of the robot file, selected by score tests and refits.",
        sections=[
            Section("springs", "Springs", choice_body),
            Section("scores", "Score tests", scores_body),
        ],
        banner=_banner(structure),
    )
    write_text(path, content)


def _banner(structure: Structure) -> Markup:
    """Return how many springs the data ask for, and what to do with them."""
    choice = structure.choice
    verdict, step = structure_advice(choice)
    kind = "doubtful" if choice.caution or choice.springs else "sound"
    return page_banner(verdict, kind, text.sentence(choice.stopped), next_step=step)


def spring_table(structure: Structure) -> Table:
    """Return the chosen springs, each with those that the data cannot tell from it."""
    choice = structure.choice
    rows = [
        (
            spring.name,
            _number(float(str(spring.stiffness))),
            _number(spring.damping),
            text.listed(list(choice.twins[spring.name])) if choice.twins[spring.name] else "–",
        )
        for spring in choice.springs
    ]
    columns = [
        Column("spring"),
        *numbers("stiffness [N m/rad]", "damping [N m s/rad]"),
        Column("indistinguishable from", "words"),
    ]
    return table("chosen", "Springs that were added, with fitted values.", columns, rows)


def step_table(structure: Structure) -> Table:
    """Return the steps of the choice."""
    choice, misfits = structure.choice, structure.held_out
    rows: list[tuple[Cell, ...]] = [("none", "", "", _number(choice.bic[0], 6))]
    for step in choice.steps:
        instead = f" instead of {step.instead_of}" if step.instead_of else ""
        what = f"{step.action} {step.spring}{instead}"
        falls = _number(step.expected), _number(step.fall)
        rows.append((what, *falls, _number(step.bic, 6)))
    columns = [Column("step", "words"), *numbers("expected decrease", "decrease in cost", "BIC")]
    if misfits is not None:
        columns += numbers("held out")
        rows = [(*row, _number(each)) for row, each in zip(rows, misfits, strict=True)]
    return table("steps", "Steps of the selection.", columns, rows)


def score_table(structure: Structure) -> Table:
    """Return the score tests."""
    rows = [
        (
            score.name,
            _number(score.probability, 2),
            _number(score_size(score)),
            " to ".join(text.significant(end, 3) for end in score.interval),
            _UNITS.get(score.unit, text.pretty_unit(score.unit)),
            _number(score.fall),
        )
        for score in structure.scores
    ]
    columns = [
        Column("test"),
        *numbers("p-value"),
        *numbers("size"),
        Column("95 % interval"),
        Column("unit", "u"),
        *numbers("expected decrease"),
    ]
    caption = (
        "Sizes by one linear step, relative where no unit is given; those of springs are "
        "compliances and non-negative."
    )
    return table("tests", caption, columns, rows)


def suspects(results: FittedStudy, structure: Structure) -> tuple[RobotDrawings | None, str]:
    """Return the robot with the strongest suspects marked, and what the marks are."""
    firing = [score for score in structure.scores.significant() if score.spring is not None]
    springs = [score.spring for score in firing[:MARKED] if score.spring is not None]
    if not springs:
        return None, ""
    number = worst_position(results)
    position = results.plan.positions[number]
    named = [f"{k} {_words(score)}" for k, score in enumerate(firing[:MARKED], start=1)]
    caption = f"Marked, in position {number + 1}: {text.listed(named)}."
    marks = spring_origins(results.robot, springs, position)
    alt = f"The robot. {caption}"
    return robot_drawings(results.robot, position[None], [alt], marks=[marks]), caption


def _words(score: Score) -> str:
    return f"{score.name} (p-value {text.probability(score.probability)})"


def _number(value: float, digits: int = 3) -> Number:
    return Number(text.significant(value, digits), value)
