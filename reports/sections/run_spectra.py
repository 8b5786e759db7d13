"""Spectra of runs: measured, and predicted from the torques of the same run by the fit."""

from collections.abc import Iterable, Sequence

import numpy as np
from markupsafe import Markup

import robotmodels
from estimators.fitting.run_fit import RunFit
from oed.study.results import StudyResults
from reports import text
from reports.figures import response_panels
from reports.figures.response_panels import lines_drawn
from reports.page_elements import Figure, Section, Table, figure, filled
from reports.sections.friction import friction_table
from reports.sections.plan_labels import visit_labels
from robotmodels import ElasticRobot
from robotmodels.common.arrays import Array, ComplexArray

MOST_RUNS = 6
"""Runs of a visit that are drawn."""


def section(results: StudyResults, fit: RunFit) -> Section:
    """Return the section; `fit` is the result."""
    theorem1 = results.uncertainty.theorem1
    levels = () if theorem1 is None else fit.friction_levels(theorem1.covariance)
    content = body(results.robot, fit, panels(results, fit), friction_table(levels))
    return Section("run-spectra", "Runs", content)


def body(
    robot: ElasticRobot, fit: RunFit, drawn: list[Figure], friction: Table | None = None
) -> Markup:
    """Return the section's text with `drawn`, the spectra of a fit, and levels of `friction`."""
    visits, runs, lines = fit.data.inputs.shape[:3]
    return filled(
        "run_spectra.html.j2",
        panels=drawn,
        friction=friction,
        visits=visits,
        runs=runs,
        shown=min(runs, MOST_RUNS),
        noise=noise_words(fit),
        row_wise=fit.row_wise,
        data=fit.data,
        ratio=text.significant(fit.cost / fit.expected_cost, 4),
        units=dict.fromkeys(unit.replace("^2", "²") for unit in robot.output_units),
        lines=lines,
    )


def noise_words(fit: RunFit) -> str:
    """Return where the covariance of the noise comes from, and how certain it is."""
    sources = {
        "blocks": "the scatter over blocks",
        "periods": "what differs between periods",
        "detection": "lines that were not excited",
        "declared": "the stated noise of samples",
    }
    freedom = fit.data.degrees_of_freedom
    if not np.isfinite(freedom).all():
        return f"{sources[fit.data.noise]}, which counts as known"
    count = text.count(round(float(freedom.min())))
    return f"{sources[fit.data.noise]}, with {count} degrees of freedom"


def panels(results: StudyResults, fit: RunFit) -> list[Figure]:
    """Return the panels of every visit, a row for each output and a column for each run."""
    outputs, fitted, std = compared_spectra(fit)
    outputs, fitted, std = (np.moveaxis(s[:, :MOST_RUNS], 1, 3) for s in (outputs, fitted, std))
    names = [f"run {e + 1}" for e in range(outputs.shape[3])]
    lines = lines_drawn(outputs.shape)
    figures = []
    for q, label in enumerate(visit_labels(results)):
        shown = (s[q, lines] for s in (outputs, fitted, std))
        drawing = drawn_spectra(results.robot, fit.data.omega[lines], shown, names)
        alt = f"Magnitudes and phases of the spectra of outputs, measured and predicted, in {label}"
        figures.append(figure(f"spectra-{q + 1}", drawing, alt, label=label, wide=True))
    return figures


def compared_spectra(fit: RunFit) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Return outputs, predictions and the standard deviations of both, (Q, E, F, m) each."""
    data, values = fit.data, fit.parameters.values
    G = robotmodels.frequency_response(fit.model, data.positions, data.omega, values)
    variance = np.diagonal(fit.problem.errors(values, G).covariance, axis1=-2, axis2=-1).real
    fitted = np.einsum("qfmn,qefn->qefm", G, data.inputs)
    std = np.broadcast_to(np.sqrt(variance)[:, None], fitted.shape).astype(complex)
    return data.outputs, fitted, std


def drawn_spectra(
    robot: ElasticRobot,
    omega: Array,
    compared: Iterable[ComplexArray],
    names: Sequence[str],
) -> response_panels.ResponsePanels:
    """Return the drawing of `compared_spectra`, (F, m, E) each, a column for each of `names`."""
    outputs, fitted, std = compared
    return response_panels.response_panels(
        omega,
        outputs,
        std.real,
        fitted,
        names,
        noise=std.real,
        distortion=np.abs(outputs - fitted),
        outputs=robot.output_names,
    )
