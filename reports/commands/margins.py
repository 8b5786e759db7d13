"""``oed margins``: what the identified model means for the controller."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from reports.commands.export import stated_schema
from reports.commands.identified import Identified, Map, Output, Position, Seed, Source, read_source
from reports.commands.options import WORKERS, AsJson, Workers, say
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
        float, typer.Option(min=1e-6, max=1.0, help="Of the default controller, in s.")
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
    from reports.summaries.margins_summary import margins_document, margins_summary

    loop = _feedback(described, model.robot, sample_time, controller)
    computed = _computed(model, loop, draws, seed)
    files = _written(computed, model, (output or model.folder).resolve())
    say(
        lambda: model.with_caution(margins_summary(computed, model.spread, files)),
        lambda: (
            margins_document(computed, model.spread)
            | model.verdict
            | {"files": list(map(str, files))}
        ),
        as_json,
    )


def _computed(
    model: Identified, loop: "LinearFeedback", draws: int, seed: int
) -> "ControllerMargins":
    from functools import partial

    from estimators.validation.controller_margins import controller_margins
    from reports.summaries.progress import progress_bars

    drawn = model.draws(draws, seed)
    with progress_bars() as bars:
        progress = None if bars is None else partial(bars, "draws")
        return controller_margins(model.source, loop, model.positions, drawn, progress)


def _written(computed: "ControllerMargins", model: Identified, target: Path) -> list[Path]:
    """Write table, numbers and page into a folder, and return the files."""
    from reports.pages.margins_page import write_margins_page
    from reports.summaries.margins_summary import margins_csv, margins_document
    from robotmodels.common.atomic_files import staged_folder
    from robotmodels.common.plain_data import json_text

    with staged_folder(target) as staged:
        (staged / "margins.csv").write_text(margins_csv(computed), encoding="utf-8")
        document = json_text(margins_document(computed, model.spread) | model.verdict)
        (staged / "margins.json").write_text(document, encoding="utf-8")
        page = staged / "margins.html"
        write_margins_page(computed, model.robot.name, model.spread, page, model.trust)
    return [target / f"margins.{ending}" for ending in ("csv", "json", "html")]


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
