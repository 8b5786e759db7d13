"""The parameters: estimates with standard deviations, against the truth if there is one."""

import numpy as np

from oed.study.results import StudyResults
from reports import text
from reports.figures import uncertainty_figures
from reports.page_elements import (
    Cell,
    Column,
    Number,
    Section,
    Table,
    figure,
    filled,
    in_shared_unit,
    in_unit,
    number_cell,
    numbers,
    percent_cell,
)
from reports.sections.verdict import discredited, interval_cells
from robotmodels.common.arrays import Array

_KINDS = {"stiffness": "Springs", "damping": "Dampers"}


def section(results: StudyResults) -> Section:
    """Return the section."""
    z = results.z_scores[np.isfinite(results.z_scores)]
    body = filled(
        "parameters.html.j2",
        results=results,
        parameters=parameter_table(results),
        forest=figure(
            "forest",
            uncertainty_figures.intervals(
                results.fits.result.parameters.names,
                _offsets(results),
                (_quotable(results), results.uncertainty.std, results.uncertainty.sampled_std),
                ("recommended", "Theorem 1", "emcee"),
                "the truth" if z.size else "the fit",
            ),
            "Parameters with one recommended standard deviation, and by Theorem 1 and emcee",
        ),
        ratio=_ratio_words(results.uncertainty.std / results.uncertainty.sampled_std),
        refused=len(results.trust.names) - len(results.fit_summary.usable),
        z_rms=text.fixed(float(np.sqrt(np.mean(z**2))), 2) if z.size else "",
    )
    return Section("parameters", "Parameters", body)


def kind_of(name: str) -> str:
    """Return the group a parameter is listed under."""
    return _KINDS.get(name.rsplit(".", 1)[-1], "Others")


def parameter_table(results: StudyResults) -> Table:
    """Return the table of parameters: one recommended interval each, other methods beside it."""
    has_truth = np.isfinite(results.truth)
    columns = [
        Column("parameter", code=True),
        *(numbers("truth") if has_truth.any() else []),
        *numbers("estimate", "±"),
        Column("unit", "u"),
        *numbers("std [%]", "95 % from", "to", "dof"),
        Column("verdict"),
        *in_unit("%", "Theorem 1", "emcee"),
        *(numbers("z") if has_truth.any() else []),
    ]
    groups: dict[str, list[tuple[Cell, ...]]] = {}
    for i, name in enumerate(results.fits.result.parameters.names):
        groups.setdefault(kind_of(name), []).append(tuple(_row(results, i, bool(has_truth.any()))))
    caption = (
        "Recommended: estimate with one standard deviation, absolute and relative, and 95 % "
        f"interval, by {results.trust.method}; for comparison the relative standard deviations by "
        "Theorem 1 and emcee. Numbers not to be quoted are struck out."
    )
    row_groups = tuple((kind, tuple(rows)) for kind, rows in groups.items())
    estimates = Table("estimates", caption, tuple(columns), row_groups)
    return in_shared_unit(estimates, "95 % from", "to")


def _row(results: StudyResults, i: int, with_truth: bool) -> list[Cell]:
    fitted, z = results.fits.result.parameters, float(results.z_scores[i])
    one = results.trust.intervals[i]
    value, relative, struck = one.value, float(results.trust.std[i]), discredited(one)
    theorem1, sampled = float(results.uncertainty.std[i]), float(results.uncertainty.sampled_std[i])
    truth = float(results.truth[i])
    factor, unit = text.scaled_unit(value, fitted.units[i])
    shown = relative if np.isfinite(relative) else 0.01
    decimals = text.decimals_for(shown * value / factor)
    row: list[Cell] = [fitted.names[i]]
    if with_truth:
        row.append(Number(text.significant(truth / factor, 4), truth / factor))
    row += [
        Number(text.fixed(value / factor, decimals), value / factor, struck),
        number_cell(relative * value / factor, text.fixed, decimals, struck=struck),
        unit,
        percent_cell(relative, struck=struck),
        *interval_cells(one, factor, decimals),
        Number(dof_words(one.dof), one.dof),
        str(one.verdict),
        percent_cell(theorem1, struck=struck),
        percent_cell(sampled, struck=struck),
    ]
    return [*row, number_cell(z, text.fixed, 1)] if with_truth else row


def dof_words(dof: float) -> str:
    """Return degrees of freedom; there are infinitely many where the noise is declared."""
    if not np.isfinite(dof):
        return "unknown" if np.isnan(dof) else "∞"
    return text.significant(dof, 2) if dof < 100 else text.count(round(dof))


def _quotable(results: StudyResults) -> Array:
    """Return the recommended standard deviations that may be quoted, (p,); NaN for the others."""
    why = [discredited(one) for one in results.trust.intervals]
    return np.where([not words for words in why], results.trust.std, np.nan)


def _ratio_words(ratio: Array) -> str:
    finite = ratio[np.isfinite(ratio)]
    return text.span(finite) if finite.size else ""


def _offsets(results: StudyResults) -> tuple[Array, Array, Array]:
    """Return ln theta by the fit (twice) and by emcee, less the truth or else less the fit."""
    has_truth = np.isfinite(results.truth).all()
    reference = np.log(results.truth if has_truth else results.fits.result.parameters.values)
    fitted = np.log(results.fits.result.parameters.values)
    sampled = (
        np.nan * fitted
        if results.uncertainty.posterior is None
        else results.uncertainty.posterior.draws.mean(axis=0)
    )
    return fitted - reference, fitted - reference, sampled - reference
