"""``oed margins``: what the identified model means for the controller."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from reports.commands.export import stated_schema
from reports.commands.identified import (
    Answer,
    Identified,
    Map,
    Output,
    Position,
    Seed,
    Source,
    read_source,
)
from reports.commands.options import WORKERS, AsJson, Workers
from robotmodels.common.errors import InvalidInput

if TYPE_CHECKING:
    from estimators.validation.controller_margins import ControllerMargins
    from oed.experiment.experiment_file import Experiment
    from robotmodels import ElasticRobot
    from robotmodels.simulation.linear_feedback import LinearFeedback


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(margins)


def margins(
    source: Source,
    controller: Annotated[
        Path | None,
        typer.Option(
            help="File of a controller (controller/1: matrices or transfer functions), or of an "
            "experiment, whose gains are taken; by default gains that keep the robot stable."
        ),
    ] = None,
    sample_time: Annotated[
        float, typer.Option(min=1e-6, max=1.0, help="Sample time of the default controller, in s.")
    ] = 1e-3,
    position: Position = None,
    spread: Map = 0,
    draws: Annotated[
        int,
        typer.Option(min=2, max=100_000, help="Parameter samples from the uncertainty."),
    ] = 100,
    seed: Seed = 0,
    output: Output = None,
    workers: Workers = WORKERS,
    as_json: AsJson = False,
) -> None:
    """Compute gain and phase margins, sensitivity and bandwidth of each motor's loop, with bands.

    Example: oed margins studies/ur10.yaml --controller controller.json --map 20
    """
    described = None if controller is None else _read_controller(controller)
    model = read_source(source, position, spread, workers)
    from reports.pages.margins_page import write_margins_page
    from reports.summaries.margins_summary import margins_csv, margins_document, margins_summary

    loop = _feedback(described, model.robot, sample_time, controller)
    computed, rests_on = _computed(model, loop, draws, seed), model.spread
    answer = Answer(
        "margins",
        {"margins.csv": margins_csv(computed)},
        margins_document(computed, rests_on),
        lambda path: write_margins_page(computed, model.robot.name, rests_on, path, model.trust),
        lambda files: margins_summary(computed, rests_on, files),
    )
    model.answer(answer, output, as_json)


def _computed(
    model: Identified, loop: "LinearFeedback", draws: int, seed: int
) -> "ControllerMargins":
    from estimators.validation.controller_margins import controller_margins
    from reports.summaries.progress import progress_of

    drawn = model.draws(draws, seed)
    with progress_of("draws") as progress:
        return controller_margins(model.source, loop, model.positions, drawn, progress)


def _read_controller(path: Path) -> "LinearFeedback | Experiment":
    """Read a controller, or an experiment for its gains, before a study is computed."""
    from oed.experiment.experiment_file import load_experiment
    from robotmodels import linear_feedback

    if path.is_file() and stated_schema(path).startswith("experiment/"):
        return load_experiment(path)
    return linear_feedback(path)


def _feedback(
    controller: "LinearFeedback | Experiment | None",
    robot: "ElasticRobot",
    sample_time: float,
    path: Path | None,
) -> "LinearFeedback":
    """Return the controller of a file, with an experiment's gains, or the default one."""
    from oed.experiment.experiment_file import Experiment
    from oed.experiment.prepare import controller_of
    from robotmodels import default_controller, linear_feedback

    if controller is None:
        return linear_feedback(default_controller(robot, sample_time))
    if isinstance(controller, Experiment):
        return linear_feedback(controller_of(controller, robot))
    if len(controller.D) != len(robot.motor_names):
        raise InvalidInput(
            f"{path}: {len(controller.D)} motors, the robot has {len(robot.motor_names)}"
        )
    return controller
