"""``oed design``: a study as far as its design."""

import typer

from reports.commands.options import WORKERS, AsJson, Workers, say
from reports.commands.studies import Cluster, Fresh, StudyFile, compute_study


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(design)


def design(
    study: StudyFile,
    workers: Workers = WORKERS,
    cluster: Cluster = None,
    fresh: Fresh = False,
    as_json: AsJson = False,
) -> None:
    """Choose where to measure: candidates, optimal design, whole experiments; writes design.json.

    What an earlier command computed is kept while nothing it rests on changes.

    Example: oed design studies/ur10.yaml
    """
    from oed.study.pipeline import design_study
    from reports.terminal.study_summary import study_json, study_summary

    results = compute_study(study, design_study, workers, fresh, cluster=cluster)
    written = [results.study.output / "design.json"]
    say(lambda: study_summary(results, written), lambda: study_json(results, written), as_json)
