"""``oed fit``: a study as far as its fit."""

import typer

from reports.commands.options import WORKERS, AsJson, Workers, say
from reports.commands.studies import Cluster, Fresh, StudyFile, compute_study


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(fit)


def fit(
    study: StudyFile,
    workers: Workers = WORKERS,
    cluster: Cluster = None,
    fresh: Fresh = False,
    as_json: AsJson = False,
) -> None:
    """Take or simulate the data of a study and fit them; writes design.json and fit.json.

    What an earlier command computed is kept while nothing it rests on changes.

    Example: oed fit studies/ur10.yaml
    """
    from oed.study.pipeline import fit_study
    from reports.terminal.study_summary import study_json, study_summary

    results = compute_study(study, fit_study, workers, fresh, cluster=cluster)
    written = [results.study.output / "fit.json"]
    say(lambda: study_summary(results, written), lambda: study_json(results, written), as_json)
