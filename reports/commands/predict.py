"""``oed predict``: how stiff the tool is, and how far to trust that."""

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

from reports.commands.identified import Answer, Map, Output, Position, Seed, Source, read_source
from reports.commands.options import WORKERS, AsJson, Workers
from robotmodels.common.errors import InvalidInput, check_word

if TYPE_CHECKING:
    from robotmodels import Frame
    from robotmodels.common.arrays import Array

_OF_POSTERIOR = 200
"""Draws of a stored posterior."""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(predict)


def predict(
    source: Source,
    position: Position = None,
    spread: Map = 0,
    link: Annotated[
        str | None, typer.Option(help="Link of the URDF; the last one by default.")
    ] = None,
    at: Annotated[str, typer.Option(help="Point in the link's frame, in m: 0,0,0.1.")] = "0,0,0",
    axes: Annotated[str, typer.Option(help="Axes of forces and motions: base or link.")] = "base",
    frequencies: Annotated[
        str | None, typer.Option(help="LOW,HIGH or LOW,HIGH,COUNT in Hz, for responses to forces.")
    ] = None,
    motion: Annotated[
        str, typer.Option(help="Quantity of the responses: displacement, velocity or acceleration.")
    ] = "displacement",
    motors: Annotated[
        str, typer.Option(help="clamped (brakes) or free, in responses and modes.")
    ] = "clamped",
    modes: Annotated[int, typer.Option(min=1, max=100, help="Resonances.")] = 2,
    draws: Annotated[
        int,
        typer.Option(
            min=0,
            max=400,
            help="Bands from this number of parameter samples, more accurate than linearisation "
            "where standard deviations exceed some 20 %; 0: linearisation, or 200 draws of a "
            "study's posterior where oed run or oed sample has stored one.",
        ),
    ] = 0,
    seed: Seed = 0,
    output: Output = None,
    workers: Workers = WORKERS,
    as_json: AsJson = False,
) -> None:
    """Predict compliance, resonances, damping and responses of the tool, with their bands.

    Example: oed predict studies/ur10.yaml --at 0,0,0.1 --frequencies 2,80 --map 200
    """
    words: dict[str, Any] = {"modes": modes, **_checked(motion, motors)}
    frame = read_frame(link or "", at, axes)  # refused before a study is computed
    omega = None if frequencies is None else read_frequencies(frequencies)
    model = read_source(source, position, spread, workers)
    from estimators.validation.predict_workspace import predict_workspace
    from reports.pages.prediction_page import write_prediction_page
    from reports.summaries import prediction_summary as summaries
    from reports.summaries.progress import progress_of
    from robotmodels.elastic.tool_response import tool_frame

    frame = frame if link else replace(frame, link=tool_frame(model.robot).link)
    count = draws or (0 if model.posterior is None else _OF_POSTERIOR)
    drawn = model.draws(max(count, 2), seed) if count else None
    with progress_of("predictions") as progress:
        prediction = predict_workspace(
            model.source,
            model.positions,
            omega,
            frame=frame,
            spread=drawn,
            progress=progress,
            **words,
        )
    robot, rests_on = model.robot, model.spread
    tables = {"prediction.csv": summaries.tool_csv(prediction, robot.motor_names)}
    if prediction.response is not None:
        tables["response.csv"] = summaries.response_csv(prediction)
    answer = Answer(
        "prediction",
        tables,
        summaries.tool_document(prediction, rests_on),
        lambda path: write_prediction_page(prediction, robot.name, rests_on, path, model.trust),
        lambda files: summaries.tool_summary(prediction, rests_on, files),
    )
    model.answer(answer, output, as_json)


def _checked(motion: str, motors: str) -> dict[str, str]:
    """Return what moves and whether motors are free, refused before a study is computed."""
    check_word("--motion:", motion, ("displacement", "velocity", "acceleration"))
    check_word("--motors:", motors, ("clamped", "free"))
    return {"motion": motion, "motors": motors}


def read_frame(link: str, at: str, axes: str) -> "Frame":
    """Return the frame of the options."""
    from reports.commands.check_options import read_numbers
    from robotmodels import Frame

    point = read_numbers("--at", at, "0,0,0.1")
    if len(point) != 3:
        raise InvalidInput(f"--at: {len(point)} given, 3 needed: x,y,z in the link's frame [m]")
    check_word("--axes:", axes, ("base", "link"))
    x, y, z = point
    return Frame(link, (x, y, z), "link" if axes == "link" else "base")


def read_frequencies(words: str) -> "Array":
    """Return angular frequencies [rad/s] of ``LOW,HIGH`` or ``LOW,HIGH,COUNT`` in Hz.

    Raises
    ------
    InvalidInput
        If these are not two rising positive numbers, and a count.
    """
    import numpy as np

    from reports.commands.check_options import read_band

    parts = words.split(",")
    low, high = read_band(",".join(parts[:2]), "--frequencies")
    count = parts[2] if len(parts) == 3 else "200"
    if len(parts) > 3 or not count.isdigit() or not 2 <= int(count) <= 100_000:
        raise InvalidInput(
            f"--frequencies: {words!r}; LOW,HIGH or LOW,HIGH,COUNT is needed, such as 2,80,200"
        )
    return np.geomspace(low, high, int(count))
