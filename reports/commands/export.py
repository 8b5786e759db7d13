"""``oed export``: a robot, or that of a study's fit, in the format of another program."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from reports.commands.options import WORKERS, AsJson, Workers, robot_names, say
from reports.commands.studies import compute_study, end_with_failures
from reports.commands.workers import one_thread_each
from robotmodels.common.errors import InvalidInput, nearest
from robotmodels.common.yaml_files import MOST_CHARACTERS, read_text, yaml_document

if TYPE_CHECKING:
    from oed.study.results import FittedStudy
    from robotmodels import ElasticRobot
    from robotmodels.common.arrays import Array

FORMATS = {
    name.replace("_", "-"): name for name in ("mjcf", "urdf", "state_space", "modes", "robot")
}


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(export)


def export(
    source: Annotated[
        str,
        typer.Argument(
            help="A study file, whose fit is taken; a robot file; or a built-in robot.",
            autocompletion=robot_names,
        ),
    ],
    to: Annotated[str, typer.Option(help=f"{', '.join(FORMATS)}.")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="File; by default named after the robot."),
    ] = None,
    position: Annotated[
        list[str] | None,
        typer.Option(
            help="One number per motor, in degrees (m if prismatic): 0,-90,90,0,45,0; repeat it for "
            "more. Default: all positions of a study's plan; mid-range of a robot."
        ),
    ] = None,
    workers: Workers = WORKERS,
    as_json: AsJson = False,
) -> None:
    """Write the identified model for MuJoCo, MATLAB, ROS, a controller, or the next study.

    Example: oed export studies/ur10.yaml --to mjcf -o ur10.xml
    """
    if to not in FORMATS:
        there = f"there are {', '.join(FORMATS)}"
        raise InvalidInput(f"--to: {to!r} is unknown{nearest(to, FORMATS)}; {there}")
    one_thread_each()
    import numpy as np

    from estimators.uncertainty.covariance import covariance
    from oed.study.pipeline import fit_study
    from reports.commands.check_options import read_position
    from robotmodels import export as write, load_robot
    from robotmodels.export.formats import ENDINGS

    format: Any = FORMATS[to]
    results: FittedStudy | None = None
    positions: Array | None
    certainty: Array | None = None
    if _is_study(source):
        results = compute_study(Path(source), fit_study, workers, False)
        fit, folder = results.fits.result, results.study.output
        robot, positions = fit.robot(results.trust), results.plan.positions
        certainty = covariance(fit).covariance if format == "state_space" else None
    else:
        robot, positions, folder = load_robot(source), None, Path()
    if position:
        positions = np.array([read_position(robot, words) for words in position])
    target = folder / f"{_file_name(robot)}{ENDINGS[format]}" if output is None else output
    left_out = write(robot, target, format, positions, certainty)
    say(
        lambda: "\n".join([f"written  {target}", *(f"left out {line}" for line in left_out)]),
        lambda: {"schema": "export/1", "files": [str(target)], "left_out": left_out},
        as_json,
    )
    if results is not None:
        end_with_failures(Path(source), results)


def _is_study(source: str) -> bool:
    """Whether a name is that of a study file, by what the file says of itself."""
    path = Path(source)
    if path.suffix not in (".yaml", ".yml") or not os.path.isfile(path):
        return os.path.isdir(path) and os.path.isfile(path / "study.yaml")
    text = read_text(path, MOST_CHARACTERS, "a study or a robot file")
    content = yaml_document(text, str(path), "a study or a robot file").content
    schema = content.get("schema") if isinstance(content, dict) else None
    return isinstance(schema, str) and schema.startswith("study/")


def _file_name(robot: "ElasticRobot") -> str:
    """Return a robot's name as that of a file."""
    return "".join(c if c.isalnum() or c in "-_" else "_" for c in robot.name)[:80] or "robot"
