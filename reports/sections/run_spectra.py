"""Spectra of runs: measured, and predicted from the torques of the same run by the fit."""

import numpy as np

import robotmodels
from estimators.fitting.run_fit import RunFit
from oed.study.results import StudyResults
from reports import text
from reports.figures import response_panels
from reports.figures.response_panels import lines_drawn
from reports.page_elements import Figure, Section, figure, filled
from reports.sections.plan_labels import visit_labels

MOST_RUNS = 6
"""Runs of a visit that are drawn."""


def section(results: StudyResults, fit: RunFit) -> Section:
    """Return the section; `fit` is the result."""
    visits, runs, lines = fit.data.inputs.shape[:3]
    drawn = panels(results, fit)
    body = filled(
        "run_spectra.html.j2",
        panels=drawn,
        visits=visits,
        runs=runs,
        shown=min(runs, MOST_RUNS),
        noise=noise_words(fit),
        row_wise=fit.row_wise,
        data=fit.data,
        ratio=text.significant(fit.cost / fit.expected_cost, 4),
        units=dict.fromkeys(unit.replace("^2", "²") for unit in results.robot.output_units),
        lines=lines,
    )
    return Section("run-spectra", "Runs", body)


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
    data, values = fit.data, fit.parameters.values
    outputs, inputs = (
        np.moveaxis(spectra[:, :MOST_RUNS], 1, 3) for spectra in (data.outputs, data.inputs)
    )
    lines = lines_drawn(outputs.shape)
    G = robotmodels.frequency_response(results.robot, data.positions, data.omega, values)
    variance = np.diagonal(fit.problem.errors(values, G).covariance, axis1=-2, axis2=-1).real
    std, fitted = np.broadcast_to(np.sqrt(variance)[..., None], outputs.shape), G @ inputs
    names = [f"run {e + 1}" for e in range(outputs.shape[3])]
    figures = []
    for q, label in enumerate(visit_labels(results)):
        drawing = response_panels.response_panels(
            data.omega[lines],
            outputs[q, lines],
            std[q, lines],
            fitted[q, lines],
            names,
            noise=std[q, lines],
            distortion=np.abs(outputs - fitted)[q, lines],
            outputs=results.robot.output_names,
        )
        alt = f"Magnitudes and phases of the spectra of outputs, measured and predicted, in {label}"
        figures.append(figure(f"spectra-{q + 1}", drawing, alt, label=label, wide=True))
    return figures
