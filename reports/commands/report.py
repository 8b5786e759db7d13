"""``oed report``: the page of a study, or of several side by side."""

import shlex
from pathlib import Path
from typing import Annotated, Any

import typer

from reports.commands.options import WORKERS, AsJson, Workers, about, say
from reports.commands.studies import answer_study, compute_study, end_with_failures
from robotmodels.common.errors import InvalidInput


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(report)


def report(
    studies: Annotated[list[Path], typer.Argument(help="Study files; several are compared.")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Page of a comparison; default: comparison.html."),
    ] = None,
    workers: Workers = WORKERS,
    as_json: AsJson = False,
) -> None:
    """Write the report of a study, or one page that compares several.

    Results of earlier commands are reused; missing ones are computed.

    Example: oed report studies/ur10.yaml more_positions.yaml -o comparison.html
    """
    from oed.study.pipeline import run_study
    from oed.study.stage_cache import Failure
    from reports.pages.comparison import comparison_json, comparison_summary, write_comparison
    from reports.pages.study_page import write_report

    def page(results: Any, folder: Path, progress: Any) -> tuple[Failure, ...]:
        return write_report(
            results, folder / "report.html", progress, f"oed report {shlex.quote(str(studies[0]))}"
        )

    if len(studies) == 1:
        if output is not None:
            raise InvalidInput("--output: belongs to a comparison; a study's file says where")
        one = compute_study(studies[0], run_study, workers, False, page)
        answer_study(studies[0], one, ["report.html"], as_json)
        return
    results_by_name = {
        name: compute_study(path, run_study, workers, False)
        for name, path in zip(study_names(studies), studies, strict=True)
    }
    target = Path("comparison.html") if output is None else output
    with about(target):
        write_comparison(results_by_name, target)
    say(
        lambda: comparison_summary(results_by_name, target),
        lambda: comparison_json(results_by_name, target),
        as_json,
    )
    for path, results in zip(studies, results_by_name.values(), strict=True):
        end_with_failures(path, results)


def study_names(studies: list[Path]) -> list[str]:
    """Return distinct names of the studies: those of their files, with their folders if needed."""
    if len(set(studies)) < len(studies):
        raise InvalidInput(f"studies: {studies[0]} is given twice; give each study once")
    # `oed init` calls every study study.yaml: the name is that of its folder.
    short = [path.resolve().parent.name if path.stem == "study" else path.stem for path in studies]
    return (
        short if len(set(short)) == len(short) else [str(path.with_suffix("")) for path in studies]
    )
