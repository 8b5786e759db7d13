"""Frequency responses: measured and fitted, Bode panels of one position at a time."""

import numpy as np
from markupsafe import Markup

import robotmodels
from oed.study.results import StudyResults
from reports import text
from reports.figures import response_panels
from reports.figures.response_data import ResponseData, between
from reports.figures.response_panels import lines_drawn
from reports.page_elements import Figure, Section, figure, filled
from reports.sections.plan_labels import labels
from robotmodels.common.arrays import IntArray


def section(results: StudyResults) -> Section:
    """Return the section."""
    estimate = results.data.frf
    lines = lines_drawn(estimate.response.shape)
    shown = response_data(results, lines)
    body = filled(
        "responses.html.j2",
        results=results,
        frequencies=len(estimate.omega),
        panels=panels(results, shown),
        embedded=embedded(results, shown),
        lines=len(lines),
        predicted=shown.predictive and text.percent(shown.share_predicted),
        units=dict.fromkeys(unit.replace("^2", "²") for unit in results.robot.output_units),
    )
    return Section("responses", "Frequency responses", body)


def response_data(results: StudyResults, lines: IntArray) -> ResponseData:
    """Return measured FRFs and the fitted model's, also between the lines."""
    estimate, certain = results.data.frf, results.responses
    values = results.fits.result.parameters.values
    omega = estimate.omega[lines]
    fine = between(omega)
    band = None if certain is None else certain.predictive
    return ResponseData(
        omega,
        estimate.response[:, lines],
        np.sqrt(estimate.variance[:, lines]),
        estimate.repetitions,
        fine,
        robotmodels.frequency_response(results.robot, estimate.positions, fine, values),
        None if certain is None else certain.std[:, lines],
        None if band is None else (band[0][:, lines], band[1][:, lines]),
    )


def panels(results: StudyResults, shown: ResponseData) -> list[Figure]:
    """Return the Bode panels of every position."""
    robot, figures = results.robot, []
    for q, label in enumerate(labels(results)):
        drawing = response_panels.response_panels(
            shown.omega,
            shown.measured[q],
            shown.std[q],
            None if shown.model is None else shown.model[q],
            robot.motor_names,
            outputs=robot.output_names,
            fitted_omega=shown.model_omega,
        )
        alt = (
            f"Magnitudes and phases of the measured and fitted frequency responses, "
            f"{len(robot.output_names)} by {len(robot.motor_names)}, in {label}"
        )
        figures.append(figure(f"frf-{q + 1}", drawing, alt, label=label, wide=True))
    return figures


def embedded(results: StudyResults, shown: ResponseData) -> Markup:
    """Return the data with which the page's script enlarges single elements."""
    robot = results.robot
    ids = [f"frf-{q + 1}" for q in range(len(shown.measured))]
    return shown.embedded(ids, robot.motor_names, robot.output_names, robot.output_units)
