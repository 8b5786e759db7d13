"""``oed hammer``: springs and dampers from forces at a point, beside what motors have told."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from reports.commands.options import AsJson, robot_names, say
from reports.commands.predict import read_frame
from reports.commands.workers import one_thread_each
from robotmodels.common.errors import InvalidInput, check_word

if TYPE_CHECKING:
    from estimators import Fit, Prior
    from robotmodels import ElasticRobot, Frame, HammerTest


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(hammer)


def hammer(
    robot: Annotated[
        str,
        typer.Argument(
            help="Robot file with accelerometers. Standard deviations in it, as oed export --to "
            "robot and oed identify write them, count as estimates from other data.",
            autocompletion=robot_names,
        ),
    ],
    hits: Annotated[
        Path,
        typer.Argument(
            help="FRFs from forces to the accelerometers, .h5, .mat, .csv or .uff: rows in the "
            "order of the robot file, columns in that of the directions."
        ),
    ],
    direction: Annotated[list[str], typer.Option(help="Direction of the hits: 0,0,1; repeatable.")],
    link: Annotated[
        str | None, typer.Option(help="Link that is hit; the last one by default.")
    ] = None,
    at: Annotated[str, typer.Option(help="Point in the link's frame, in m: 0,0,0.1.")] = "0,0,0",
    axes: Annotated[str, typer.Option(help="Axes of the directions: base or link.")] = "link",
    motors: Annotated[str, typer.Option(help="clamped (brakes) or free.")] = "clamped",
    alone: Annotated[
        bool,
        typer.Option(
            help="Fit to the hits alone: ignore the standard deviations in the robot file."
        ),
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Robot file to write; by default beside the hits."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Fit a robot to hammer tests: forces at a point of a link, accelerometers out.

    Combined with estimates from motor-side data where the robot file has their standard deviations.

    Example: oed hammer identified.yaml hits.h5 --link tool0 --at 0,0,0.1 --direction 0,0,1
    """
    frame = read_frame(link or "", at, axes)  # refused before anything is read
    check_word("--motors:", motors, ("clamped", "free"))
    one_thread_each()
    from estimators import covariance
    from robotmodels import load_robot, save_robot

    model = load_robot(robot)
    prior = None if alone else _prior(model)
    fit = _fit(_test(model, frame, direction, motors), hits, prior)
    target = output or hits.parent / f"{model.name}_identified.yaml"
    save_robot(fit.robot(covariance=covariance(fit).covariance), target)
    say(lambda: _summary(fit, prior, target), lambda: _json(fit, prior, target), as_json)


def _prior(robot: "ElasticRobot") -> "Prior | None":
    """Return the estimates in a robot file with their standard deviations; None without any."""
    from estimators import robot_prior

    has_deviations = robot.file.fitted is not None or bool(robot.file.guessed)
    return robot_prior(robot) if has_deviations else None


def _test(robot: "ElasticRobot", frame: "Frame", direction: list[str], motors: str) -> "HammerTest":
    import numpy as np

    from reports.commands.check_options import read_numbers
    from robotmodels import HammerTest, tool_frame

    frame = frame if frame.link else replace(frame, link=tool_frame(robot).link)
    rows = [read_numbers("--direction", words, "0,0,1") for words in direction]
    if wrong := [words for words, row in zip(direction, rows, strict=True) if len(row) != 3]:
        raise InvalidInput(f"--direction: {wrong[0]!r}; three numbers are needed, such as 0,0,1")
    return HammerTest(robot, frame, np.array(rows), "free" if motors == "free" else "clamped")


def _fit(test: "HammerTest", hits: Path, prior: "Prior | None") -> "Fit":
    from estimators import fit, read_frf
    from robotmodels.common.errors import naming

    data = read_frf(hits)
    shape, needed = data.response.shape[2:], (len(test.output_names), len(test.directions))
    if shape != needed:
        raise InvalidInput(
            f"{hits}: FRFs of {shape[0]} sensors by {shape[1]} forces; the robot file has "
            f"{needed[0]} sensors on links ({', '.join(test.output_names)}), and {needed[1]} "
            "directions are given"
        )
    with naming(hits):
        return fit(test, data, residual="nls", weights="optimal", prior=prior)


def _summary(fit: "Fit", prior: "Prior | None", written: Path) -> str:
    from reports.sections.verdict import interval_words
    from reports.summaries.columns import described, plain, plural

    beside = "alone"
    if prior is not None:
        count = plural(len(prior.names), "parameter")
        beside = f"with the standard deviations in the robot file ({count})"
    lines = [
        ("data", f"{plural(len(fit.problem.positions), 'position')}, {beside}"),
        ("fit", f"cost {fit.cost:.6g}, {'converged' if fit.converged else 'NOT converged'}"),
        *(
            (one.name, plain(f"{interval_words(one)} {unit}"))
            for one, unit in zip(fit.intervals(), fit.parameters.units, strict=True)
        ),
        ("verdict", f"{fit.verdict}: {fit.verdict.reason}"),
        ("written", str(written)),
    ]
    return "\n".join(described(lines))


def _json(fit: "Fit", prior: "Prior | None", written: Path) -> dict[str, object]:
    trust = fit.trust.document()
    return {
        "schema": "hammer/1",
        "cost": fit.cost,
        "converged": fit.converged,
        "prior": [] if prior is None else list(prior.names),
        **{key: trust[key] for key in ("verdict", "reason", "intervals")},
        "file": str(written),
    }
