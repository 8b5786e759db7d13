"""The page of ``oed check``: a robot at a position, and what looks wrong with it."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from markupsafe import Markup

from reports import text
from reports.figures.robot_bodies import robot_drawings
from reports.page_elements import (
    Column,
    Number,
    Row,
    Section,
    Table,
    filled,
    in_shared_unit,
    number_cell,
    numbers,
    page,
    page_banner,
    percent_cell,
    table,
)
from reports.summaries.robot_summary import mode_remarks
from robotmodels import ElasticRobot
from robotmodels.checks.diagnosis import Diagnosis
from robotmodels.checks.warnings import Suspicion
from robotmodels.common.arrays import Array
from robotmodels.common.atomic_files import write_text

_DEGREE = np.pi / 180
_ROUNDING = 1e-6  # torques and deflections below this are rounding


def write_check_page(
    robot: ElasticRobot,
    position: Array,
    diagnosis: Diagnosis,
    warnings: Sequence[Suspicion],
    path: Path,
) -> None:
    """Write a robot at a position (n,) [rad or m] as one HTML file that needs nothing else."""
    tables = {
        "Motors": motor_table(diagnosis),
        "Springs": spring_table(diagnosis),
        "Modes": mode_table(diagnosis),
        "Anti-resonances": anti_resonance_table(diagnosis),
        "Parameters": parameter_table(diagnosis),
    }
    if warnings:
        tables = {"Warnings": warning_table(warnings)} | tables
    source = diagnosis.source and f" Source of the numbers: {text.sentence(diagnosis.source)}"
    drawn = robot_drawings(robot, position[None], [f"The robot {robot.name}"])
    content = page(
        title=diagnosis.robot,
        kind="robot check",
        kicker="An elastic robot as its file describes it",
        lead=f"Motors, springs, equilibrium under gravity and modes in one position.{source}",
        sections=[
            Section(title.lower(), title, filled("check.html.j2", shown=shown, drawn=drawn))
            for title, shown in tables.items()
        ],
        banner=_banner(diagnosis, warnings),
    )
    write_text(path, content)


def _banner(diagnosis: Diagnosis, warnings: Sequence[Suspicion]) -> Markup:
    free = sum(one.state == "free" for one in diagnosis.parameters)
    size = f"{text.plural(len(diagnosis.motors), 'motor')}, {text.plural(free, 'free parameter')}"
    if not warnings:
        step = "oed init, then oed design: where to measure this robot"
        return page_banner("Nothing looks wrong", "sound", size, next_step=step)
    step = "correct or confirm the numbers of the robot file that the warnings name"
    verdict = text.plural(len(warnings), "warning")
    return page_banner(verdict, "doubtful", size, next_step=step)


def warning_table(warnings: Sequence[Suspicion]) -> Table:
    """Return what looks wrong, a rule each."""
    rows = [(one.rule, one.message) for one in warnings]
    return table(
        "warning-table",
        "What looks wrong, by rule.",
        [Column("rule"), Column("warning", "words")],
        rows,
    )


def motor_table(diagnosis: Diagnosis) -> Table:
    """Return motors with their position, load and drive."""
    rows: list[Row] = []
    for one in diagnosis.motors:
        scale, unit = (1.0, "m") if one.prismatic else (_DEGREE, "°")
        cells = (_cell(v) for v in (one.gear_ratio, one.inertia, one.load, one.torque))
        rows.append(
            (one.name, one.joint, _cell(one.angle / scale), unit, *cells, one.spring or "rigid")
        )
    load = _unit([one.prismatic for one in diagnosis.motors], "kg m²", "kg")
    columns = [
        Column("motor", code=True),
        Column("joint", code=True),
        *numbers("position"),
        Column("unit", "u"),
        *numbers("gear ratio", "inertia [kg m²]"),
        *numbers(f"load [{load}]", "holding torque [N m]"),
        Column("drive spring", code=True),
    ]
    caption = "Motors; inertia and holding torque on the motor shaft, load on the arm side."
    return in_shared_unit(table("motor-table", caption, columns, rows))


def spring_table(diagnosis: Diagnosis) -> Table:
    """Return springs with their deflection under gravity."""
    rows: list[Row] = []
    for one in diagnosis.springs:
        deflection = _cell(one.deflection / (1e-3 if one.linear else _DEGREE))
        stiffness, load = (_cell(v) for v in (one.stiffness, one.torque))
        rows.append((one.name, one.attached_to, one.axis, stiffness, deflection, load))
    linear = [one.linear for one in diagnosis.springs]
    stiffness_unit = _unit(linear, "N m/rad", "N/m")
    deflection_unit, load_unit = _unit(linear, "°", "mm"), _unit(linear, "N m", "N")
    columns = [
        Column("spring", code=True),
        Column("joint or link", code=True),
        Column("axis"),
        *numbers(f"stiffness [{stiffness_unit}]", f"static deflection [{deflection_unit}]"),
        *numbers(f"load [{load_unit}]"),
    ]
    return table("spring-table", "Springs in equilibrium under gravity.", columns, rows)


def parameter_table(diagnosis: Diagnosis) -> Table:
    """Return the parameters with their state and their effect on the responses."""
    rows: list[Row] = [
        (
            one.name,
            _cell(one.value),
            text.pretty_unit(one.unit),
            one.state if one.tied_to is None else f"tied to {one.tied_to}",
            percent_cell(one.sensitivity),
        )
        for one in diagnosis.parameters
    ]
    columns = [
        Column("parameter", code=True),
        *numbers("value"),
        Column("unit", "u"),
        Column("state"),
        *numbers("sensitivity [%]"),
    ]
    caption = (
        "Parameters; the sensitivity is the largest relative change of any frequency response in "
        "the band per relative change of the parameter."
    )
    return in_shared_unit(table("parameter-table", caption, columns, rows))


def mode_table(diagnosis: Diagnosis) -> Table:
    """Return flexible modes, with the springs that hold their energy."""
    names = [one.name for one in diagnosis.springs]
    rows: list[Row] = []
    for one in diagnosis.modes:
        order = np.argsort(-np.asarray(one.energy), kind="stable")[:3]
        energy = ", ".join(f"{names[i]} {text.percent(one.energy[i])}" for i in order)
        damping = number_cell(100 * one.damping_ratio, text.significant)
        rows.append((_cell(one.frequency / (2 * np.pi)), damping, energy))
    columns = [*numbers("frequency [Hz]", "damping ratio [%]"), Column("elastic energy", "words")]
    remarks = "; ".join(mode_remarks(diagnosis))
    return table("mode-table", f"Damped flexible modes, motors free; {remarks}.", columns, rows)


def anti_resonance_table(diagnosis: Diagnosis) -> Table:
    """Return the undamped zeros of each motor's own response, up to the end of the band."""
    high, rows = diagnosis.band[1], list[Row]()
    for one in diagnosis.motors:
        below = [w / (2 * np.pi) for w in one.anti_resonances if w <= high]
        above = len(one.anti_resonances) - len(below)
        words = ", ".join(text.significant(w) for w in below) or "–"
        rows.append((one.name, words, Number(text.count(above), above)))
    hertz = f"{high / (2 * np.pi):g} Hz"
    columns = [
        Column("motor", code=True),
        Column("anti-resonances [Hz]", "words"),
        *numbers(f"number above {hertz}"),
    ]
    caption = f"Undamped anti-resonances up to {hertz}: zeros of a motor's own frequency response."
    return table("anti-resonance-table", caption, columns, rows)


def _unit(linear: Sequence[bool], rotary: str, straight: str) -> str:
    """Return the unit of a column, both of them where there are joints of both kinds."""
    units = {rotary: not all(linear), straight: any(linear)}
    return " or ".join(unit for unit, used in units.items() if used)


def _cell(value: float) -> Number:
    return number_cell(value if abs(value) >= _ROUNDING else 0.0, text.significant)
