"""``oed sample``: a study as far as its uncertainty."""

import typer

from reports.commands.options import WORKERS, AsJson, Workers, say
from reports.commands.studies import Cluster, Fresh, StudyFile, compute_study


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(sample)


def sample(
    study: StudyFile,
    workers: Workers = WORKERS,
    cluster: Cluster = None,
    fresh: Fresh = False,
    as_json: AsJson = False,
) -> None:
    """Say how certain the fit of a study is, by Theorem 1 and emcee; writes uncertainty.json.

    What an earlier command computed is kept while nothing it rests on changes.

    Example: oed sample studies/ur10.yaml
    """
    from oed.study.pipeline import run_study
    from reports.terminal.study_summary import study_json, study_summary

    results = compute_study(study, run_study, workers, fresh, cluster=cluster)
    written = [results.study.output / "uncertainty.json"]
    say(lambda: study_summary(results, written), lambda: study_json(results, written), as_json)
