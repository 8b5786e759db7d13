"""The page of ``oed design``: where to measure, why, and the predicted accuracy."""

from pathlib import Path

from oed.study.results import PlannedStudy
from reports.page_elements import Section, page
from reports.sections import candidates, design, positions, provenance, robot
from reports.sections.verdict import banner
from robotmodels.common.atomic_files import write_text


def write_design_page(results: PlannedStudy, path: Path, command: str = "") -> None:
    """Write the design of a study as one HTML file that needs nothing else.

    Parameters
    ----------
    command : str
        What made the page.
    """
    sections: list[Section | None] = [
        design.section(results),
        positions.section(results),
        candidates.section(results),
        robot.section(results),
        provenance.section(results, command),
    ]
    content = page(
        title=results.robot.name,
        kind="experiment design",
        kicker="Optimal experiment design for an elastic robot",
        lead="Optimal positions and numbers of visits, with the expected standard deviations.",
        sections=[one for one in sections if one is not None],
        banner=banner(results),
    )
    write_text(path, content)
