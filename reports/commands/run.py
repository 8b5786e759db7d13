"""``oed run``: a whole study."""

import shlex
from importlib import import_module
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Any

import typer

from reports.commands.chain_study import compute_chain_study
from reports.commands.deflection_study import compute_deflection_study
from reports.commands.options import WORKERS, AsJson, Workers, warn
from reports.commands.replicate import write_replication
from reports.commands.studies import (
    Cluster,
    Fresh,
    StudyFile,
    answer_study,
    compute_study,
    study_content,
    study_kind,
    warnings_to,
)
from reports.commands.visit_study import compute_visit_study
from robotmodels.common.printing import printable

if TYPE_CHECKING:
    from oed.study.last_run import Answer, LastRun
    from oed.study.results import StudyResults
    from oed.study.stage_cache import Failure


_WHOLE = {
    "chains": compute_chain_study,
    "movements": compute_deflection_study,
    "visits": compute_visit_study,
}
"""Studies without stages, by their kind."""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(run)


def run(
    study: StudyFile,
    workers: Workers = WORKERS,
    cluster: Cluster = None,
    fresh: Fresh = False,
    as_json: AsJson = False,
) -> None:
    """Compute a study and write its report: design, identified parameters, uncertainty.

    Stages of an earlier run are reused while their inputs are unchanged.

    Studies of coupled chains (schema chain_study/1), of movements (data.movements) and of visits
    (design.minutes or design.targets) are computed as a whole.

    Example: oed run studies/ur10.yaml
    """
    whole = _WHOLE.get(study_kind(study))
    if whole is not None:
        whole(study, as_json)
        return
    last = last_run(study)
    answer = None if fresh or last is None else last.recall()
    if answer is not None:
        warn(answer.warnings)
        typer.echo(printable(answer.document if as_json else answer.text))
        return
    warnings: list[str] = []
    with warnings_to(warnings.append):
        results = _computed(study, workers, cluster, fresh)
    written = answer_study(study, results, ["report.html"], as_json)
    if last is not None:
        last.remember(results, _next_answer(results, written, warnings))


def last_run(study: Path) -> "LastRun | None":
    """Return the last run of a study; None where its file does not say where that lies."""
    from oed.study.last_run import LastRun
    from robotmodels.common.file_paths import output_folder

    output = study_content(study).get("output")
    if not isinstance(output, str):
        return None
    return LastRun(_command(study), study, output_folder(study, Path(output)))


def _command(study: Path) -> str:
    return f"oed run {shlex.quote(str(study))}"


def _computed(study: Path, workers: int, cluster: str | None, fresh: bool) -> "StudyResults":
    """Return the results of a study, its files and pages written."""

    def run_study(*arguments: Any, **options: Any) -> "StudyResults":
        from oed.study import pipeline

        # What draws pages is loaded while other processes compute.
        Thread(target=import_module, args=("reports.pages.study_page",), daemon=True).start()
        return pipeline.run_study(*arguments, **options)

    def pages(results: Any, folder: Path, progress: Any) -> "tuple[Failure, ...]":
        from reports.pages.study_page import write_report

        return write_report(results, folder / "report.html", progress, _command(study))

    results = compute_study(study, run_study, workers, fresh, pages, cluster=cluster)
    if results.study.compare_with is not None:
        results = write_replication(study, results, workers, fresh, cluster)
    return results


def _next_answer(results: "StudyResults", written: list[Path], warnings: list[str]) -> "Answer":
    """Return what the same command says while nothing changes."""
    from oed.study.last_run import Answer
    from reports.summaries.study_summary import study_json, study_summary
    from robotmodels.common.plain_data import json_text

    loaded = results.as_loaded()
    document = json_text(study_json(loaded, written))
    return Answer(study_summary(loaded, written), document, tuple(warnings))
