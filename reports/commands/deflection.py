"""``oed deflection``: springs from encoders on both sides of the gears."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from reports.commands.options import AsJson, robot_names, say
from robotmodels.common.errors import InvalidInput

if TYPE_CHECKING:
    from estimators import DeflectionFit, Interval

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
        str, typer.Option(help="Where the payload's mass is from: torques or robot-file.")
    ] = "torques",
    low_pass: Annotated[float, typer.Option(help="Cut-off frequency of all signals [Hz].")] = 5.0,
    delays: Annotated[
        bool, typer.Option(help="Estimate the delays of the encoders behind the gears.")
    ] = True,
    check: Annotated[
        Path | None,
        typer.Option(help="Other movements: which share of their deflections is explained."),
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
    from robotmodels import iterate_movements, load_robot, save_robot

    sources: dict[str, Literal["estimated", "robot file"]] = {
        "torques": "estimated",
        "robot-file": "robot file",
    }
    if payload not in sources:
        raise InvalidInput(f"--payload: {payload!r}; {' or '.join(sources)} is needed")
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
    say(lambda: _summary(fit, shares, target), lambda: _json(fit, shares, target), as_json)


def _summary(fit: "DeflectionFit", shares: list[dict[str, float]], written: Path) -> str:
    from reports.summaries.columns import hung, plain

    lines = [
        (one.name, plain(f"{_value(one)} {_unit(one.name)}. {one.verdict.reason}"))
        for one in fit.intervals()
    ]
    for term, shifts in fit.systematic_shifts().items():
        sizes = ", ".join(f"{name} {shift:+.1%}" for name, shift in shifts.items())
        lines.append(("if otherwise", f"{term}: {sizes}"))
    lines += [("MISSING", flag.sentence) for flag in fit.flags]
    for i, share in enumerate(shares, start=1):
        words = ", ".join(f"{name} {value:.0%}" for name, value in share.items())
        lines.append(("explained", f"of other movement {i}: {words}"))
    lines.append(("written", str(written)))
    width = max(len(name) for name, _ in lines)
    printed = [fit.start.name]
    for name, words in lines:
        printed += hung(f"  {name:<{width}}  ", words, width + 4)
    return "\n".join(printed)


def _value(one: "Interval") -> str:
    """Return estimate and interval, or the verdict."""
    from reports import text
    from reports.sections.verdict import interval_words

    if not one.verdict.gives_interval:
        return f"{one.verdict}, –"
    return f"{text.significant(one.value, 4)}, 95 %: {interval_words(one)}"


def _unit(name: str) -> str:
    """Return the unit of a parameter of such a fit."""
    units = {"stiffness": "N m/rad", "delay": "s", "mass": "kg", "coulomb": "N m"}
    entry = name.split(".")[1].split(" ")[0]
    return units.get(entry, "N m s/rad")


def _json(fit: "DeflectionFit", shares: list[dict[str, float]], written: Path) -> dict[str, object]:
    from estimators.trust.intervals import interval_document
    from robotmodels.common.plain_data import json_data

    return {
        "schema": "deflection/1",
        "intervals": [interval_document(one) for one in fit.intervals()],
        "systematic": fit.systematic_shifts(),
        "missing": [json_data(term) for term in fit.missing],
        "explained": shares,
        "file": str(written),
    }
