"""The sections of a study's report, one module each; what a study has not is left out."""

from collections.abc import Callable

from oed.study.pipeline import Progress, StudyResults
from reports.parts import Section
from reports.sections import (
    candidates,
    comparison,
    cross_check,
    design,
    experiment,
    fit,
    identifiability,
    parameters,
    positions,
    provenance,
    residuals,
    responses,
    robot,
    summary,
    uncertainty,
    validation,
)


def study_sections(
    results: StudyResults, progress: Progress | None = None, command: str = ""
) -> list[Section]:
    """Return the sections of a report, in order; `command` is what made it."""
    found = []
    for number, make in enumerate(_IN_ORDER, start=1):
        section = make(results)
        if section is not None:
            found.append(section)
        if progress is not None:
            progress("report", number, len(_IN_ORDER))
    return [*found, provenance.section(results, command)]


def _residuals(results: StudyResults) -> Section:
    robot_ = results.robot
    return residuals.section(results.residuals, robot_.output_names, robot_.motor_names)


def _cross_check(results: StudyResults) -> Section:
    return cross_check.section(results.cross_check)


def _identifiability(results: StudyResults) -> Section:
    return identifiability.section(results.identifiability)


_IN_ORDER: tuple[Callable[[StudyResults], Section | None], ...] = (
    summary.section,
    robot.section,
    candidates.section,
    design.section,
    positions.section,
    comparison.section,
    experiment.section,
    responses.section,
    fit.section,
    _residuals,
    parameters.section,
    _cross_check,
    uncertainty.section,
    _identifiability,
    validation.section,
)
