"""The parameters: estimates with their standard deviations, against the truth where known."""

import numpy as np

from oed.study.pipeline import StudyResults
from reports import text
from reports.drawing import uncertainty_figures
from reports.parts import Cell, Column, Number, Section, Table, figure, numbers
from reports.template import filled

_KINDS = {"stiffness": "Springs", "damping": "Dampers"}


def section(results: StudyResults) -> Section:
    """Return the section."""
    std = results.theorem1.std, results.posterior.uncertainty().std
    ratio = std[0] / std[1]
    z = results.z_scores[np.isfinite(results.z_scores)]
    body = filled(
        "parameters.html.j2",
        results=results,
        parameters=parameter_table(results),
        forest=figure(
            "forest",
            uncertainty_figures.intervals(
                results.theorem1.names,
                _offsets(results),
                std,
                ("Theorem 1", "emcee"),
                "the truth" if z.size else "the fit",
            ),
            "Parameters with one standard deviation by Theorem 1 and by emcee",
        ),
        ratio_low=text.fixed(float(ratio.min()), 2),
        ratio_high=text.fixed(float(ratio.max()), 2),
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
    value, relative = float(fitted.values[i]), float(results.theorem1.std[i])
    sampled, truth = float(results.posterior.uncertainty().std[i]), float(results.truth[i])
    factor, unit = text.scaled_unit(value, fitted.units[i])
    decimals = text.decimals_for(relative * value / factor)
    row: list[Cell] = [fitted.names[i]]
    if with_truth:
        row.append(Number(text.significant(truth / factor, 4), truth / factor))
    row += [
        Number(text.fixed(value / factor, decimals), value / factor),
        Number(text.fixed(relative * value / factor, decimals), relative * value / factor),
        unit,
        Number(text.percent(relative), relative),
        Number(text.percent(sampled), sampled),
        Number(text.fixed(relative / sampled, 2), relative / sampled),
    ]
    return [*row, Number(text.fixed(z, 1) if np.isfinite(z) else "–", z)] if with_truth else row


def _offsets(results: StudyResults) -> tuple[np.ndarray, np.ndarray]:
    """Return ln theta by the fit and by emcee, less the truth, or less the fit where unknown."""
    known = np.isfinite(results.truth).all()
    reference = np.log(results.truth if known else results.fit.parameters.values)
    chains = results.posterior.chains
    sampled = chains.reshape(-1, chains.shape[-1]).mean(axis=0)
    return np.log(results.fit.parameters.values) - reference, sampled - reference
