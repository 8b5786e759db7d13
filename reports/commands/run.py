"""``oed run``: a whole study."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from reports.commands.chain_study import compute_chain_study
from reports.commands.deflection_study import compute_deflection_study
from reports.commands.options import WORKERS, AsJson, Workers, say
from reports.commands.replicate import write_replication
from reports.commands.studies import (
    Cluster,
    Fresh,
    StudyFile,
    compute_study,
    end_with_failures,
    study_kind,
)
from reports.commands.visit_study import compute_visit_study

if TYPE_CHECKING:
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
    """Compute a study and write its report: where to measure, what comes out, how certain it is.

    Stages that an earlier run finished are kept while nothing they rest on changes.

    Studies of coupled chains (schema chain_study/1), of movements (data.movements) and of visits
    (design.minutes or design.targets) are computed as a whole.

    Example: oed run studies/ur10.yaml
    """
    whole = _WHOLE.get(study_kind(study))
    if whole is not None:
        whole(study, as_json)
        return
    # Imported here: `oed --help` need not wait for the numerics.
    from oed.study.pipeline import run_study
    from reports.pages.study_page import write_report
    from reports.summaries.study_summary import study_json, study_summary

    def pages(results: Any, folder: Path, progress: Any) -> "tuple[Failure, ...]":
        return write_report(
            results, folder / "report.html", progress, f"oed run {shlex.quote(str(study))}"
        )

    results = compute_study(study, run_study, workers, fresh, pages, cluster=cluster)
    if results.study.compare_with is not None:
        results = write_replication(study, results, workers, fresh, cluster)
    written = [results.study.output / "report.html"]
    say(lambda: study_summary(results, written), lambda: study_json(results, written), as_json)
    end_with_failures(study, results)
