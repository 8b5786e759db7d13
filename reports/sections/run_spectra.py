"""Spectra of runs: measured, and predicted from the torques of the same run by the fit."""

from collections.abc import Iterable, Sequence

import numpy as np
from markupsafe import Markup

import robotmodels
from estimators.fitting.run_fit import RunFit
from oed.study.results import StudyResults
from reports import text
from reports.figures import response_panels
from reports.figures.response_data import ElementView, ResponseData
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
    shown = _first_runs(fit)
    drawn = panels(results, fit, shown)
    content = body(results.robot, fit, drawn, friction_table(levels), embedded(results, shown))
    return Section("run-spectra", "Runs", content)


def body(
    robot: ElasticRobot,
    fit: RunFit,
    drawn: list[Figure],
    friction: Table | None = None,
    enlarged: Markup | None = None,
) -> Markup:
    """Return the section's text with `drawn`, the spectra of a fit, and levels of `friction`.

    `enlarged` holds the data of single elements, for the page's script.
    """
    visits, runs, lines = fit.data.inputs.shape[:3]
    return filled(
        "run_spectra.html.j2",
        panels=drawn,
        friction=friction,
        embedded=enlarged,
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


def _first_runs(fit: RunFit) -> ResponseData:
    """Return the spectra of each visit's first runs, a column for each."""
    outputs, fitted, std = (np.moveaxis(s[:, :MOST_RUNS], 1, 3) for s in compared_spectra(fit))
    lines = lines_drawn(outputs.shape)
    omega, once = fit.data.omega[lines], np.ones(len(outputs), dtype=np.int64)
    return ResponseData(omega, outputs[:, lines], std[:, lines].real, once, omega, fitted[:, lines])


def panels(results: StudyResults, fit: RunFit, shown: ResponseData) -> list[Figure]:
    """Return the panels of every visit, a row for each output and a column for each run."""
    names = _run_names(shown)
    figures = []
    for q, label in enumerate(visit_labels(results)):
        compared = (s[q] for s in (shown.measured, shown.model, shown.std) if s is not None)
        drawing = drawn_spectra(results.robot, shown.omega, compared, names)
        alt = f"Magnitudes and phases of the spectra of outputs, measured and predicted, in {label}"
        figures.append(figure(f"spectra-{q + 1}", drawing, alt, label=label, wide=True))
    return figures


def embedded(results: StudyResults, shown: ResponseData) -> Markup:
    """Return the data with which the page's script enlarges single elements."""
    robot, count = results.robot, len(shown.measured)
    ids = [f"spectra-{q + 1}" for q in range(count)]
    names = [("measured", "predicted")] * count
    element = ElementView("visit", "of", "", names, views=2)
    return shown.embedded(ids, _run_names(shown), robot.output_names, robot.output_units, element)


def _run_names(shown: ResponseData) -> list[str]:
    return [f"run {e + 1}" for e in range(shown.measured.shape[3])]


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
