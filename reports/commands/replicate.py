"""``oed replicate``: a study put beside the published one that it repeats."""

from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import typer

from reports.commands.options import WORKERS, AsJson, Workers
from reports.commands.studies import (
    Cluster,
    Fresh,
    StudyFile,
    answer_study,
    compute_study,
    read_study,
    working,
)
from robotmodels.common.errors import InvalidInput

if TYPE_CHECKING:
    from oed.study.results import FittedStudy

_Study = TypeVar("_Study", bound="FittedStudy")


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(replicate)


def replicate(
    study: StudyFile,
    workers: Workers = WORKERS,
    cluster: Cluster = None,
    fresh: Fresh = False,
    as_json: AsJson = False,
) -> None:
    """Compare a study with a published one; writes published.json and published.html.

    Results of earlier commands are reused while their inputs are unchanged.

    Example: oed replicate studies/published.yaml
    """
    if read_study(study).compare_with is None:
        raise InvalidInput(
            f"{study}: compare_with: missing; the published study to compare with is needed"
        )
    from oed.study.pipeline import fit_study

    results = compute_study(study, fit_study, workers, fresh, cluster=cluster)
    results = write_replication(study, results, workers, fresh, cluster)
    answer_study(study, results, ["published.html"], as_json)


def write_replication(
    study: Path, results: "_Study", workers: int, fresh: bool, cluster: str | None
) -> "_Study":
    """Write published.json and published.html; return the results with what failed of it."""
    from oed.replication.json_output import write_published_json
    from oed.replication.replicate import replicate
    from oed.study.stage_cache import Failure
    from reports.pages.replication_page import write_published
    from robotmodels.common.atomic_files import staged_folder

    def failing(what: str, error: Exception) -> "_Study":
        return results.with_failures(Failure.of(what, error))

    with working(study, workers, cluster) as (progress, executor):
        try:
            replication = replicate(results, progress, executor=executor, fresh=fresh)
        except Exception as error:  # the study is written, whatever comes of its repetition
            return failing("published", error)
        with staged_folder(results.study.output) as folder:
            write_published_json(replication, folder / "published.json")
            try:
                write_published(results, replication, folder / "published.html")
            except Exception as error:  # the numbers are written, whatever comes of the page
                return failing("published.html", error)
    return results
