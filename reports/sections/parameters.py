"""The parameters: estimates with their standard deviations, against the truth where known."""

from collections.abc import Callable

import numpy as np

from oed.study.pipeline import StudyResults
from reports import text
from reports.drawing import uncertainty_figures
from reports.parts import Cell, Column, Number, Section, Table, figure, numbers
from reports.template import filled

_KINDS = {"stiffness": "Springs", "damping": "Dampers"}


def section(results: StudyResults) -> Section:
    """Return the section."""
    ratio = results.std / results.sampled_std
    z = results.z_scores[np.isfinite(results.z_scores)]
    body = filled(
        "parameters.html.j2",
        results=results,
        parameters=parameter_table(results),
        forest=figure(
            "forest",
            uncertainty_figures.intervals(
                results.fit.parameters.names,
                _offsets(results),
                (results.std, results.sampled_std),
                ("Theorem 1", "emcee"),
                "the truth" if z.size else "the fit",
            ),
            "Parameters with one standard deviation by Theorem 1 and by emcee",
        ),
        ratio=tuple(text.fixed(float(v), 2) for v in (ratio.min(), ratio.max()) if np.isfinite(v)),
        z_rms=text.fixed(float(np.sqrt(np.mean(z**2))), 2) if z.size else "",
    )
    return Section("parameters", "Parameters", body)


def kind_of(name: str) -> str:
    """Return the group a parameter is listed under."""
    return _KINDS.get(name.rsplit(".", 1)[-1], "Others")


def parameter_table(results: StudyResults) -> Table:
    """Return the table of parameters: estimate and standard deviations; truth where known."""
    known = np.isfinite(results.truth)
    columns = [
        Column("parameter", code=True),
        *(numbers("truth") if known.any() else []),
        *numbers("estimate", "±"),
        Column("unit", "u"),
        *numbers("Theorem 1", "emcee", "ratio"),
        *(numbers("z") if known.any() else []),
    ]
    groups: dict[str, list[tuple[Cell, ...]]] = {}
    for i, name in enumerate(results.fit.parameters.names):
        groups.setdefault(kind_of(name), []).append(tuple(_row(results, i, bool(known.any()))))
    caption = "Estimates with one standard deviation, and relative standard deviations."
    found = tuple((kind, tuple(rows)) for kind, rows in groups.items())
    return Table("estimates", caption, tuple(columns), found)


def _row(results: StudyResults, i: int, with_truth: bool) -> list[Cell]:
    fitted, z = results.fit.parameters, float(results.z_scores[i])
    value, relative = float(fitted.values[i]), float(results.std[i])
    sampled, truth = float(results.sampled_std[i]), float(results.truth[i])
    factor, unit = text.scaled_unit(value, fitted.units[i])
    shown = relative if np.isfinite(relative) else 0.01
    decimals = text.decimals_for(shown * value / factor)
    row: list[Cell] = [fitted.names[i]]
    if with_truth:
        row.append(Number(text.significant(truth / factor, 4), truth / factor))
    row += [
        Number(text.fixed(value / factor, decimals), value / factor),
        _number(relative * value / factor, text.fixed, decimals),
        unit,
        _number(relative, text.percent),
        _number(sampled, text.percent),
        _number(relative / sampled, text.fixed, 2),
    ]
    return [*row, _number(z, text.fixed, 1)] if with_truth else row


def _number(value: float, words: Callable[..., str], *options: int) -> Number:
    """Return a number, a dash where there is none."""
    return Number(words(value, *options) if np.isfinite(value) else "–", value)


def _offsets(results: StudyResults) -> tuple[np.ndarray, np.ndarray]:
    """Return ln theta by the fit and by emcee, less the truth, or less the fit where unknown."""
    known = np.isfinite(results.truth).all()
    reference = np.log(results.truth if known else results.fit.parameters.values)
    fitted = np.log(results.fit.parameters.values)
    sampled = np.nan * fitted if results.posterior is None else results.posterior.draws.mean(axis=0)
    return fitted - reference, sampled - reference
