"""The report of a study: one HTML page that needs nothing else."""

from pathlib import Path

from oed.study.pipeline import Progress, StudyResults
from reports.sections import study_sections
from reports.template import page


def write_report(
    results: StudyResults, path: Path, progress: Progress | None = None, command: str = ""
) -> None:
    """Write the report of a study as one HTML file; `command` is what made it."""
    path.write_text(render(results, progress, command), encoding="utf-8")


def render(results: StudyResults, progress: Progress | None = None, command: str = "") -> str:
    """Return the report of a study as HTML."""
    return page(
        title=results.robot.name,
        kind="experiments, parameters, uncertainty",
        kicker="Experiment design and uncertainty for an elastic robot",
        lead=(
            "Where to measure, what the springs and dampers come out as, and how far to trust them."
        ),
        sections=study_sections(results, progress, command),
    )
