"""``oed init``: the files of a new study."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

from reports.commands.options import AsJson, robot_names, say, warn


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(init)


def init(
    robot: Annotated[
        str,
        typer.Argument(
            help="A URDF, xacro or MJCF file, a robot file, or a built-in robot.",
            autocompletion=robot_names,
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Folder; by default the robot's name."),
    ] = None,
    argument: Annotated[
        list[str] | None,
        typer.Option(help="Argument of a xacro file, NAME=VALUE; repeatable."),
    ] = None,
    packages: Annotated[
        list[Path] | None,
        typer.Option(help="Folder with packages that a xacro file or meshes need; repeatable."),
    ] = None,
    lock: Annotated[
        list[str] | None,
        typer.Option(help="Joint locked, JOINT or JOINT=ANGLE in rad (m); repeatable."),
    ] = None,
    base: Annotated[str | None, typer.Option(help="Link: only joints beyond it move.")] = None,
    tip: Annotated[str | None, typer.Option(help="Link: only joints before it move.")] = None,
    as_json: AsJson = False,
) -> None:
    """Write a commented study, and for a model file a robot file with initial guesses.

    Nothing is overwritten.

    Example: oed init my_robot.urdf -o my_study
    """
    from reports.commands.init_files import default_folder, starter_files, write_starter_files
    from reports.commands.init_options import model_options
    from reports.summaries.progress import progress_bars

    folder = default_folder(robot) if output is None else output
    options = model_options(argument, packages, lock, base, tip)
    with progress_bars() as bars:
        if bars is not None:  # hulls of fine meshes take a minute
            bars("collisions", 0, 0)
        starter = starter_files(robot, folder, options)
    paths = write_starter_files(starter, folder)
    robot_file = next((path for path in paths if path.name == "robot.yaml"), None)
    lines = [starter.robot, *(f"  written  {path}" for path in paths)]
    if robot_file is not None:
        checked = shlex.quote(str(robot_file))
        lines.append(f"  next     oed check {checked}, once its guesses are replaced")
    run = shlex.quote(str(folder / "study.yaml"))
    lines.append(f"  {'then' if robot_file else 'next'}     oed run {run}")
    warn(starter.notes)
    say(
        lambda: "\n".join(lines),
        lambda: {
            "robot": starter.robot,
            "files": [str(path) for path in paths],
            "notes": list(starter.notes),
        },
        as_json,
    )
