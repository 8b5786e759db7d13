"""``oed deflection``: springs from encoders on both sides of the gears."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from reports.commands.options import AsJson, robot_names, say
from robotmodels.common.errors import check_word

Movements = Annotated[
    Path, typer.Argument(help="Movements (HDF5, schema movements/1), such as `oed import` writes.")
]


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(deflection)


def deflection(
    robot: Annotated[
        str,
        typer.Argument(help="Built-in robot, or a robot file.", autocompletion=robot_names),
    ],
    movements: Movements,
    payload: Annotated[
        str, typer.Option(help="Source of the payload's mass: torques or robot-file.")
    ] = "torques",
    low_pass: Annotated[float, typer.Option(help="Cut-off frequency of all signals [Hz].")] = 5.0,
    delays: Annotated[
        bool, typer.Option(help="Estimate the delays of the encoders behind the gears.")
    ] = True,
    check: Annotated[
        Path | None,
        typer.Option(
            help="Other movements to validate with: share of their deflections explained."
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Folder; by default beside the movements."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Fit stiffnesses, delays, payload and friction to slow or ordinary movements.

    Needs encoders on both sides of some gears. Writes the identified robot as a robot file.

    Example: oed deflection kr300 movements.h5
    """
    from estimators import DeflectionAssumptions, fit_deflection
    from reports.summaries.deflection_summary import deflection_json, deflection_summary
    from robotmodels import iterate_movements, load_robot, save_robot

    sources: dict[str, Literal["estimated", "robot file"]] = {
        "torques": "estimated",
        "robot-file": "robot file",
    }
    check_word("--payload:", payload, sources)
    model = load_robot(robot)
    fit = fit_deflection(
        model,
        list(iterate_movements(movements)),
        payload=sources[payload],
        assumptions=DeflectionAssumptions(low_pass=low_pass, delays=delays),
    )
    others = [] if check is None else list(iterate_movements(check))
    shares = [fit.explained_share(movement) for movement in others]
    target = (movements.parent if output is None else output) / f"{model.name}_identified.yaml"
    save_robot(fit.robot(), target)
    say(
        lambda: deflection_summary(fit, shares, [target]),
        lambda: deflection_json(fit, shares) | {"file": str(target)},
        as_json,
    )
