"""The report of a study: one HTML page that needs nothing else."""

from pathlib import Path

from oed.study.results import StudyResults
from oed.study.stage_cache import Failure
from reports.page_elements import Section, page
from reports.sections import study_sections
from reports.sections.verdict import banner
from robotmodels.common.atomic_files import write_text
from robotmodels.common.progress import StageProgress


def write_report(
    results: StudyResults,
    path: Path | str,
    progress: StageProgress | None = None,
    command: str = "",
) -> tuple[Failure, ...]:
    """Write the report of a study as one HTML file; return the parts that failed.

    Parameters
    ----------
    results : StudyResults
        As of `oed.study.pipeline.run_study`.
    path : Path or str
        The file.
    progress : StageProgress, optional
        Told how many sections are done.
    command : str
        What made the report.
    """
    sections, failed = study_sections(results, progress, command)
    write_text(Path(path), _page(results, sections))
    return failed


def show(results: StudyResults, path: Path | str | None = None) -> Path:
    """Open the report of a study in the browser; return its file.

    Parameters
    ----------
    results : StudyResults
        As of `oed.study.pipeline.run_study`.
    path : Path or str, optional
        Where to write it; a new temporary folder by default.
    """
    import tempfile
    import webbrowser

    file = Path(path or Path(tempfile.mkdtemp(prefix="oed-")) / "report.html").resolve()
    write_report(results, file)
    webbrowser.open(file.as_uri())
    return file


def _page(results: StudyResults, sections: list[Section]) -> str:
    """Return the report of a study as HTML."""
    return page(
        title=results.robot.name,
        kind="experiments, parameters, uncertainty",
        kicker="Experiment design and uncertainty for an elastic robot",
        lead=("Optimal positions, identified stiffness and damping, and their uncertainty."),
        sections=sections,
        banner=banner(results),
    )
