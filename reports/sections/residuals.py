"""What the fit leaves unexplained: is it noise, and if not, where is it."""

import numpy as np

from estimators.trust.residual_analysis import ResidualAnalysis
from reports import text
from reports.drawing import figures
from reports.parts import Column, Figure, Number, Row, Section, Table, figure, numbers, table
from reports.template import filled
from robotmodels.arrays import Array


def section(found: ResidualAnalysis, outputs: tuple[str, ...], motors: tuple[str, ...]) -> Section:
    """Return the section."""
    body = filled(
        "residuals.html.j2",
        found=found,
        ratio=text.significant(found.ratio, 4),
        p_value=text.probability(found.p_value),
        correlation=text.fixed(float(found.autocorrelation[0]), 3),
        whiteness=text.probability(found.whiteness_p_value),
        outlying=text.listed([str(q + 1) for q in found.outlying]),
        positions=by_position(found),
        elements=element_table(found.by_element, outputs, motors),
    )
    return Section("residuals", "Residuals", body)


def times_expected(found: ResidualAnalysis) -> str:
    """Return how many times the expected sum the squared residuals are."""
    return text.significant(found.ratio, 2)


def by_position(found: ResidualAnalysis) -> Figure | None:
    """Return squared residuals over their expectation by position; None where there is only one."""
    if len(found.by_position) < 2:
        return None
    return figure(
        "residuals-by-position",
        figures.over_expected(found.by_position, found.outlying),
        "Sum of squared residuals over its expectation, for every position",
    )


def element_table(ratio: Array, outputs: tuple[str, ...], motors: tuple[str, ...]) -> Table:
    """Return chi squared over its expectation, (m, n), for each element."""
    rows: list[Row] = [
        (output, *(_number(float(value)) for value in row))
        for output, row in zip(outputs, ratio, strict=True)
    ]
    caption = "Sum of squared residuals over its expectation, element by element; 1 for noise."
    columns = [Column("output"), *numbers(*(f"from {motor}" for motor in motors))]
    return table("residuals-by-element", caption, columns, rows)


def _number(value: float) -> Number:
    return Number(text.fixed(value, 2) if np.isfinite(value) else "–", value)
