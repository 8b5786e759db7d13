"""``oed simulate``: plan an experiment and simulate it."""

from pathlib import Path
from typing import Annotated

import typer

from reports.commands.options import WORKERS, AsJson, Workers, about, say
from reports.commands.stopping import stoppable, stopping_at_steps
from reports.commands.studies import study_kind
from reports.commands.visit_study import simulate_visit_study
from reports.commands.workers import one_thread_each, process_pool


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(simulate)


def simulate(
    experiment: Annotated[
        Path,
        typer.Argument(
            help="Experiment file, such as studies/manutec_r3_experiment.yaml, or a study of "
            "visits that oed design has planned."
        ),
    ],
    workers: Workers = WORKERS,
    as_json: AsJson = False,
) -> None:
    """Plan an experiment inside its limits and simulate it: multisines, closed loop, records.

    Example: oed simulate studies/manutec_r3_experiment.yaml
    """
    if study_kind(experiment) == "visits":
        simulate_visit_study(experiment, as_json)
        return
    one_thread_each()
    from oed.experiment.controller_files import write_controller_files
    from oed.experiment.experiment_file import load_experiment
    from oed.experiment.prepare import prepare
    from oed.experiment.run_experiment import run_experiment
    from reports.summaries.experiment_summary import experiment_json, experiment_summary
    from reports.summaries.progress import progress_bars
    from robotmodels.common.atomic_files import staged_folder

    content = load_experiment(experiment)
    with (
        stoppable(),
        about(experiment),
        staged_folder(content.output) as folder,
        progress_bars() as bars,
        process_pool(workers) as executor,
    ):
        progress = stopping_at_steps(bars)
        prepared = prepare(content, progress)
        files = content.output / "controller"
        if content.files:
            write_controller_files(prepared.plan, files, content.files, content, prepared.robot)
        outcome = run_experiment(prepared, folder, progress, executor)
    say(
        lambda: experiment_summary(prepared, outcome, content.output),
        lambda: experiment_json(prepared, outcome, content.output),
        as_json,
    )
