"""What the commands on a study share."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from reports.commands.options import about
from reports.workers import one_thread_each, process_pool

if TYPE_CHECKING:
    from oed.study.results import PlannedStudy

StudyFile = Annotated[Path, typer.Argument(help="Study file, such as studies/ur10.yaml.")]
Fresh = Annotated[
    bool, typer.Option("--fresh", help="Compute all stages again, also those that still fit.")
]

_Step = TypeVar("_Step", bound="PlannedStudy")
Pages = Callable[[Any, Path, Any], None]
"""Writes pages of results into a folder, and tells its progress."""


def compute_study(
    study: Path,
    step: Callable[..., _Step],
    workers: int,
    fresh: bool,
    pages: Pages | None = None,
) -> _Step:
    """Return a study computed as far as `step` goes, its files written.

    Parameters
    ----------
    study : file.
    step : `oed.study.pipeline.design_study`, `fit_study` or `run_study`.
    workers, fresh : as the options say.
    pages : writes pages beside the files.
    """
    one_thread_each()
    from oed.study.file import load_study
    from oed.study.output import staged_folder, write_results
    from reports.progress import progress_bars

    content = load_study(study)
    with about(study), progress_bars() as progress, process_pool(workers) as executor:
        results = step(content, progress, executor=executor, fresh=fresh)
        with staged_folder(content.output) as folder:
            write_results(results, folder)
            if pages is not None:
                pages(results, folder, progress)
    return results
