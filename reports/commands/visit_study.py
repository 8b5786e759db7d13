"""``oed design``, ``oed run`` and ``oed simulate`` on a study of visits."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from reports.commands.options import about, say
from reports.commands.stopping import stoppable
from reports.commands.studies import working
from reports.commands.workers import one_thread_each

if TYPE_CHECKING:
    from oed.visit_study.run_visit_study import VisitStudyResults


def compute_visit_study(study: Path, as_json: bool, with_page: bool = True) -> None:
    """Plan the visits of a study; write them, their numbers and the page."""
    one_thread_each()  # before anything loads the numerics
    from oed.visit_study.run_visit_study import run_visit_study
    from oed.visit_study.study_file import load_visit_study
    from oed.visit_study.written_visits import write_visits
    from reports.summaries.visit_study_summary import visit_study_json, visit_study_summary
    from robotmodels.common.atomic_files import exclusive_folder, staged_folder

    content = load_visit_study(study)
    command = f"oed run {shlex.quote(str(study))}" if with_page else ""
    with working(study, 1, None) as (progress, _), exclusive_folder(content.output):
        results = run_visit_study(content, progress)
        write_visits(content, [one.plan for one in results.visits], results.robot)
        with staged_folder(content.output) as folder:
            names = [*_write(results, folder, command), "visits"]
    files = [content.output / name for name in names]
    say(
        lambda: visit_study_summary(results, files),
        lambda: visit_study_json(results) | {"files": [str(file) for file in files]},
        as_json,
    )


def _write(results: "VisitStudyResults", folder: Path, command: str) -> list[str]:
    """Write numbers, and the page if a `command` made it; return the names of the files."""
    from reports.pages.visit_study_page import write_visit_study_page
    from reports.summaries.visit_study_summary import visit_study_json
    from robotmodels.common.plain_data import write_json

    write_json(folder / "visits.json", visit_study_json(results))
    if not command:
        return ["visits.json"]
    write_visit_study_page(results, folder / "report.html", command)
    return ["visits.json", "report.html"]


def simulate_visit_study(study: Path, as_json: bool) -> None:
    """Simulate the planned visits of a study, and keep their records."""
    one_thread_each()
    from oed.visit_study.study_file import load_visit_study
    from oed.visit_study.written_visits import simulate_study_visits
    from reports.summaries.progress import progress_bars
    from robotmodels.common.atomic_files import exclusive_folder

    content = load_visit_study(study)
    with (
        stoppable(),
        about(study),
        exclusive_folder(content.output),
        progress_bars() as bars,
    ):
        report = None if bars is None else (lambda done, total: bars("simulation", done, total))
        visits = simulate_study_visits(content, report)
    files = [str(visit.records_file) for visit in visits]
    say(
        lambda: "\n".join(f"records  {file}" for file in files),
        lambda: {"schema": "simulated_visits/1", "files": files},
        as_json,
    )
