"""Levels of Coulomb friction of motors on a page."""

from collections.abc import Sequence

from estimators.fitting.run_fit import FrictionLevel
from reports import text
from reports.page_elements import Column, Number, Row, Table, in_unit, number_cell, table


def friction_table(levels: Sequence[FrictionLevel]) -> Table | None:
    """Return the level of each motor beside that of the robot file; None without any."""
    if not levels:
        return None
    columns = [
        Column("motor", code=True),
        *in_unit("N m", "level", "std", "lowest", "highest", "file"),
    ]
    caption = (
        "Levels of the motors' Coulomb friction: means over positions with their standard "
        "deviations, the lowest and highest of a position, and those of the robot file."
    )
    return table("friction", caption, columns, [_row(one) for one in levels])


def _row(one: FrictionLevel) -> Row:
    decimals = text.decimals_for(one.std)
    cells = [
        number_cell(value, text.fixed, decimals)
        for value in (one.level, one.std, one.lowest, one.highest)
    ]
    if one.in_file is None:
        return (one.motor, *cells, "–")
    return (one.motor, *cells, Number(text.significant(one.in_file, 4), one.in_file))
