"""``oed run``: a whole study."""

from pathlib import Path
from typing import Annotated

import typer

from reports.commands.options import WORKERS, AsJson, Workers, about, say
from reports.workers import one_thread_each, process_pool


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(run)


def run(
    study: Annotated[Path, typer.Argument(help="Study file, such as studies/ur10.yaml.")],
    workers: Workers = WORKERS,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Compute all stages again, also those that still fit.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Compute a study and write its report: where to measure, what comes out, how certain it is.

    Stages that an earlier run finished are kept while nothing they rest on changes.

    Example: oed run studies/ur10.yaml
    """
    one_thread_each()
    # Imported here: `oed --help` need not wait for the numerics.
    from oed.published_output import write_published_json
    from oed.study import run_study
    from oed.study_file import load_study
    from oed.study_output import staged_folder, write_results
    from reports.page import write_report
    from reports.progress import progress_bars
    from reports.published_page import write_published
    from reports.summary import study_json, study_summary

    content = load_study(study)
    with about(study), progress_bars() as progress, process_pool(workers) as executor:
        results = run_study(content, progress, executor=executor, fresh=fresh)
        with staged_folder(content.output) as folder:
            write_results(results, folder)
            write_report(results, folder / "report.html", progress)
            if results.published is not None:
                write_published_json(results.published, folder / "published.json")
                write_published(results, results.published, folder / "published.html")
    report = content.output / "report.html"
    say(lambda: study_summary(results, report), lambda: study_json(results, report), as_json)
