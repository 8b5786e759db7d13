"""The sections of a study's report, one module each; what a study has not is left out."""

from collections.abc import Callable

from oed.study import Progress, StudyResults
from reports.parts import Section
from reports.sections import (
    candidates,
    design,
    experiment,
    fit,
    parameters,
    positions,
    provenance,
    responses,
    robot,
    summary,
    uncertainty,
)

_IN_ORDER: tuple[Callable[[StudyResults], Section | None], ...] = (
    summary.section,
    robot.section,
    candidates.section,
    design.section,
    positions.section,
    experiment.section,
    responses.section,
    fit.section,
    parameters.section,
    uncertainty.section,
    provenance.section,
)


def study_sections(results: StudyResults, progress: Progress | None = None) -> list[Section]:
    """Return the sections of a report, in order."""
    found = []
    for number, make in enumerate(_IN_ORDER, start=1):
        section = make(results)
        if section is not None:
            found.append(section)
        if progress is not None:
            progress("report", number, len(_IN_ORDER))
    return found
