"""Frequency responses: measured and fitted, Bode panels of one position at a time."""

import numpy as np

import robotmodels
from oed.study.results import StudyResults
from reports.figures import response_panels
from reports.figures.response_panels import lines_drawn
from reports.page_elements import Figure, Section, figure, filled
from reports.sections.plan_labels import labels
from robotmodels.common.arrays import IntArray


def section(results: StudyResults) -> Section:
    """Return the section."""
    estimate = results.data.frf
    shown = lines_drawn(estimate.response.shape)
    body = filled(
        "responses.html.j2",
        results=results,
        frequencies=len(estimate.omega),
        panels=panels(results, shown),
        lines=len(shown),
        units=dict.fromkeys(unit.replace("^2", "²") for unit in results.robot.output_units),
    )
    return Section("responses", "Frequency responses", body)


def panels(results: StudyResults, lines: IntArray) -> list[Figure]:
    """Return the Bode panels of every position."""
    r, estimate = results, results.data.frf
    omega = estimate.omega[lines]
    fitted = robotmodels.frequency_response(
        r.robot, estimate.positions, omega, r.fits.result.parameters.values
    )
    std = np.sqrt(estimate.variance)
    figures = []
    for q, label in enumerate(labels(r)):
        drawing = response_panels.response_panels(
            omega,
            estimate.response[q, lines],
            std[q, lines],
            fitted[q],
            r.robot.motor_names,
            outputs=r.robot.output_names,
        )
        alt = (
            f"Magnitudes and phases of the measured and fitted frequency responses, "
            f"{len(r.robot.output_names)} by {len(r.robot.motor_names)}, in {label}"
        )
        figures.append(figure(f"frf-{q + 1}", drawing, alt, label=label, wide=True))
    return figures
