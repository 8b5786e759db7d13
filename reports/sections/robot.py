"""The robot: its motors and springs, as its file gives them."""

from oed.study.results import PlannedStudy
from reports import text
from reports.page_elements import Column, Number, Row, Section, Table, filled, numbers, table
from robotmodels.description.friction import friction_sentences
from robotmodels.description.robot_file import Hardening, Spring


def section(results: PlannedStudy) -> Section:
    """Return the section."""
    body = filled(
        "robot.html.j2",
        results=results,
        motors=motor_table(results),
        springs=spring_table(results),
        friction=friction_sentences(results.robot.file),
        unit={"acceleration": "rad/s²", "velocity": "rad/s", "position": "rad"},
    )
    return Section("robot", "Robot", body)


def motor_table(results: PlannedStudy) -> Table:
    """Return the table of motors."""
    rows: list[Row] = []
    for motor in results.robot.file.motors:
        values = (motor.gear_ratio, motor.inertia, motor.viscous, motor.coulomb)
        rows.append((motor.name, motor.joint, *(_number(value) for value in values)))
    columns = [
        Column("motor"),
        Column("joint"),
        *numbers("gear ratio", "inertia [kg m²]", "viscous [N m s/rad]", "Coulomb [N m]"),
    ]
    caption = (
        "Motors, in the order of rows and columns of the frequency responses; values on the "
        "motor shaft."
    )
    return table("motors", caption, columns, rows)


def spring_table(results: PlannedStudy) -> Table:
    """Return the table of springs and dampers, as the robot file has them."""
    robot = results.robot
    free = set(robot.parameters.names)
    rows = [
        (
            spring.name,
            spring.joint or f"link {spring.link}",
            spring.axis,
            _stiffness(spring),
            _number(spring.damping),
            text.listed(_states(spring, free)),
        )
        for spring in robot.file.springs
    ]
    linear = " (N/m and N s/m of sliding joints)" if robot.elements.prismatic else ""
    columns = [
        Column("spring"),
        Column("at"),
        Column("axis"),
        *numbers("stiffness [N m/rad]", "damping [N m s/rad]"),
        Column("estimated"),
    ]
    caption = f"Springs and dampers as the robot file has them, on the arm side{linear}."
    return table("springs", caption, columns, rows)


def _stiffness(spring: Spring) -> Number | str:
    value = spring.stiffness
    if isinstance(value, Hardening):
        low, high = (text.significant(v) for v in (value.low, value.high))
        return f"{low} to {high}"
    return _number(value)


def _states(spring: Spring, free: set[str]) -> list[str]:
    hardening = isinstance(spring.stiffness, Hardening)
    entries = ("stiffness.low", "stiffness.high") if hardening else ("stiffness",)
    free_entries = [entry for entry in (*entries, "damping") if f"{spring.name}.{entry}" in free]
    return free_entries or ["–"]


def _number(value: float) -> Number:
    return Number(text.significant(value), value)
