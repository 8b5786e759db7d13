"""``oed check``: what a robot file means."""

from pathlib import Path
from typing import Annotated

import typer

from reports.commands.options import AsJson, about, robot_names


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(check)


def check(
    robot: Annotated[
        str,
        typer.Argument(
            help="A built-in robot, or the path of a robot file.", autocompletion=robot_names
        ),
    ],
    position: Annotated[
        str | None,
        typer.Option(
            help="One per motor, in degrees (m if prismatic): 0,-90,90,0,45,0; default: mid-range."
        ),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Page to write, such as robot.html.")
    ] = None,
    band: Annotated[str, typer.Option(help="Frequencies of interest, LOW,HIGH in Hz.")] = "2,80",
    as_json: AsJson = False,
) -> None:
    """Show bodies, motors, springs, equilibrium and modes of a robot, with warnings.

    Example: oed check ur10 --position 0,-90,90,0,45,0 -o ur10.html
    """
    from reports.commands.check_options import guesses, locked_followers, read_band, read_position
    from reports.summaries.robot_summary import robot_json, robot_summary
    from robotmodels import load_robot
    from robotmodels.checks.diagnosis import diagnose
    from robotmodels.checks.warnings import suspicions
    from robotmodels.common.printing import printable
    from robotmodels.description.unused_elements import unused_parts

    model = load_robot(robot)
    where = read_position(model, position)
    diagnosis = diagnose(model, where, read_band(band))
    show = robot_json if as_json else robot_summary
    warnings = (*guesses(robot), *locked_followers(model), *suspicions(diagnosis))
    unused = unused_parts(model.model_file, beside_robot_file=True)
    if output is not None:
        from reports.pages.check_page import write_check_page

        with about(output):
            write_check_page(model, where, diagnosis, warnings, output)
    typer.echo(printable(show(diagnosis, warnings, model.file, unused)))
