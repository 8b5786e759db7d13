"""Residuals of the fit: whether noise explains them, and if not, where they are large."""

from collections.abc import Sequence

import numpy as np

from estimators.trust.rule import LEVEL
from estimators.trust.trust import Trust
from estimators.uncertainty.residual_analysis import ResidualAnalysis
from estimators.validation.held_out_positions import Validation
from oed.study.parts import Fits
from reports import text
from reports.figures import residual_figures, study_figures
from reports.page_elements import (
    Column,
    Figure,
    Number,
    Row,
    Section,
    Table,
    figure,
    filled,
    in_unit,
    number_cell,
    numbers,
    table,
)
from robotmodels.common.arrays import Array

MOST_CONSPICUOUS, MOST_RISKY = 40, 10


def section(
    analysis: ResidualAnalysis,
    trust: Trust,
    elements: Table,
    fits: Fits | None = None,
    held_out: Validation | None = None,
    marked: Figure | None = None,
    visits: Sequence[str] = (),
) -> Section:
    """Return the section, which ends with a table of `elements`; with `fits` residuals too.

    `marked` is a picture of where the model fails, `visits` names the rows of residuals of runs.
    """
    body = filled(
        "residuals.html.j2",
        analysis=analysis,
        size=size_words(analysis),
        tested=len(trust.tests.names),
        fired=len(trust.tests.significant(LEVEL)),
        directions=direction_table(trust),
        marked=marked,
        ratio=text.significant(analysis.ratio, 4),
        correlation=text.fixed(float(analysis.autocorrelation[0]), 3),
        whiteness=text.probability(analysis.whiteness_p_value),
        outlying=text.listed([str(q + 1) for q in analysis.outlying]),
        positions=by_position(analysis),
        pictures=[] if fits is None else pictures(fits, analysis, held_out, visits),
        held_out=held_out,
        visits=visits,
        elements=elements,
    )
    return Section("residuals", "Residuals", body)


def size_words(analysis: ResidualAnalysis) -> str:
    """Return the p-value of residuals of this size, in words."""
    first, second = (text.count(round(v)) if np.isfinite(v) else "∞" for v in analysis.dof)
    return (
        f"its p-value, if the model is right and the noise as stated, is "
        f"{text.probability(analysis.p_value)} "
        f"({first} degrees of freedom, {second} of the noise)"
    )


def direction_table(trust: Trust) -> Table | None:
    """Return the directions tested, the most conspicuous first and those that could move most."""
    tests = trust.tests
    if not tests.names:
        return None
    order = np.argsort(tests.probabilities, kind="stable")
    risky = set(np.argsort(-tests.shift, kind="stable")[:MOST_RISKY].tolist())
    rows: list[Row] = []
    for rank, i in enumerate(order):
        if rank >= MOST_CONSPICUOUS and int(i) not in risky:
            continue
        p, estimate, std, shift = (
            float(a[i]) for a in (tests.probabilities, tests.estimates, tests.std, tests.shift)
        )
        unit = "–" if tests.units[i] == "relative" else text.pretty_unit(tests.units[i])
        rows.append(
            (
                tests.names[i],
                Number(text.probability(p), p),
                Number(text.significant(estimate, 2), estimate),
                Number(text.significant(std, 2), std),
                unit,
                Number(text.significant(shift, 2), shift),
                trust.names[int(tests.moved[i])],
            )
        )
    columns = [
        Column("model error"),
        *numbers("p-value", "estimate", "±"),
        Column("unit", "u"),
        *numbers("undetected shift [std]"),
        Column("of parameter", code=True),
    ]
    caption = (
        "Model errors tested, one at a time: the estimate of each as an additional parameter, "
        "relative where no unit is given, and its p-value. Undetected shift: how far such an "
        "error, just too small to be detected, can move which parameter, in its standard "
        "deviations."
    )
    return table("directions-tested", caption, columns, rows)


def by_position(analysis: ResidualAnalysis) -> Figure | None:
    """Return squared residuals over their expectation by position; None where there is only one."""
    if len(analysis.by_position) < 2:
        return None
    return figure(
        "residuals-by-position",
        study_figures.over_expected(analysis.by_position, analysis.outlying),
        "Sum of squared residuals over its expectation, for every position",
    )


def pictures(
    fits: Fits,
    analysis: ResidualAnalysis,
    held_out: Validation | None,
    visits: Sequence[str] = (),
) -> list[Figure]:
    """Return maps and laws of the standardised residuals."""
    row = "visit" if visits else "position"
    return [
        figure(
            "residual-map",
            residual_figures.residual_map(
                fits.standardised,
                fits.result.problem.omega,
                None if held_out is None else held_out.mean_squares,
                visits,
            ),
            f"Mean squared standardised residuals, a row for each {row} along the frequencies",
        ),
        figure(
            "residual-laws",
            residual_figures.residual_laws(fits.standardised, analysis.autocorrelation),
            "Quantiles of residuals against normal quantiles, and their autocorrelation",
        ),
    ]


def element_table(
    ratio: Array, head: str, names: tuple[str, ...], columns: tuple[str, ...]
) -> Table:
    """Return chi squared over its expectation, a row for each of `names`, with their heading."""
    rows: list[Row] = [
        (name, *(number_cell(float(value), text.fixed, 2) for value in row))
        for name, row in zip(names, ratio, strict=True)
    ]
    caption = "Sum of squared residuals over its expectation, element by element; 1 for noise."
    return table("residuals-by-element", caption, [Column(head), *in_unit("–", *columns)], rows)
