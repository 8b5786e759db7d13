"""The sections of a study's report, one module each; sections without data are omitted."""

from collections.abc import Callable
from functools import partial

from estimators.fitting.run_fit import RunFit
from oed.study.results import StudyResults
from oed.study.stage_cache import Failure
from reports.page_elements import Section
from reports.sections import (
    candidates,
    comparison,
    controller,
    cross_check,
    design,
    experiment,
    failures,
    fit,
    identifiability,
    model_errors,
    parameters,
    positions,
    provenance,
    residuals,
    responses,
    robot,
    run_spectra,
    summary,
    tool,
    uncertainty,
    validation,
)
from reports.sections.plan_labels import visit_numbers
from robotmodels.common.progress import StageProgress, tell


def study_sections(
    results: StudyResults, progress: StageProgress | None = None, command: str = ""
) -> tuple[list[Section], tuple[Failure, ...]]:
    """Return the sections of a report, in order, and which of them could not be made.

    A section that cannot be made does not cost the others; a section lists the failures.

    Parameters
    ----------
    command : str
        What made the report.
    """
    sections: list[Section] = []
    failed: list[Failure] = []
    makers = _IN_ORDER | {"provenance": partial(provenance.section, command=command)}
    for number, (name, make) in enumerate(makers.items(), start=1):
        try:
            section = make(results)
        except Exception as error:
            failed.append(Failure.of(f"section {name}", error))
            section = None
        if section is not None:
            sections.append(section)
        tell(progress, "report", number, len(makers))
    if results.run.failures or failed:
        sections.insert(1, failures.section([*results.run.failures, *failed]))
    return sections, tuple(failed)


def _responses(results: StudyResults) -> Section:
    fit = results.fits.result
    if isinstance(fit, RunFit):
        return run_spectra.section(results, fit)
    return responses.section(results)


def _residuals(results: StudyResults) -> Section:
    analysis, robot_ = results.fits.residuals, results.robot
    held_out = None if results.validation is None else results.validation.theorem1
    more = results.fits, held_out, model_errors.picture(results)
    if results.study.fits_runs:
        runs = tuple(map(str, range(1, analysis.by_element.shape[1] + 1)))
        by_run = residuals.element_table(analysis.by_element.T, "run", runs, robot_.output_names)
        return residuals.section(
            analysis, results.trust, by_run, *more, visits=visit_numbers(results)
        )
    columns = tuple(f"from {motor}" for motor in robot_.motor_names)
    by_element = residuals.element_table(
        analysis.by_element, "output", robot_.output_names, columns
    )
    return residuals.section(analysis, results.trust, by_element, *more)


def _cross_check(results: StudyResults) -> Section | None:
    return (
        None
        if results.uncertainty.cross_check is None
        else cross_check.section(results.uncertainty.cross_check)
    )


def _uncertainty(results: StudyResults) -> Section | None:
    if results.uncertainty.theorem1 is None or results.uncertainty.posterior is None:
        return None
    return uncertainty.section(results, results.uncertainty.theorem1, results.uncertainty.posterior)


def _identifiability(results: StudyResults) -> Section:
    return identifiability.section(results.fits.identifiability)


_IN_ORDER: dict[str, Callable[[StudyResults], Section | None]] = {
    "summary": summary.section,
    "robot": robot.section,
    "candidates": candidates.section,
    "design": design.section,
    "positions": positions.section,
    "plans": comparison.section,
    "experiment": experiment.section,
    "responses": _responses,
    "fit": fit.section,
    "residuals": _residuals,
    "parameters": parameters.section,
    "cross-check": _cross_check,
    "uncertainty": _uncertainty,
    "weak directions": _identifiability,
    "tool": tool.section,
    "controller": controller.section,
    "validation": validation.section,
}
