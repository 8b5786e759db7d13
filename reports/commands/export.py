"""``oed export``: a robot, or that of a study's fit, in the format of another program."""

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from reports.commands.options import WORKERS, AsJson, Workers, robot_names, say
from reports.commands.studies import compute_study, end_with_failures
from reports.commands.workers import one_thread_each
from robotmodels.common.errors import IdentificationError, InvalidInput, check_word
from robotmodels.exports.formats import ENDINGS, Format

if TYPE_CHECKING:
    from estimators.fitting.fitted_model import FittedModel
    from oed.study.results import FittedStudy
    from robotmodels import ElasticRobot
    from robotmodels.common.arrays import Array

FORMATS: dict[str, Format] = {name.replace("_", "-"): name for name in ENDINGS}


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
            help="One number per motor, in degrees (m if prismatic): 0,-90,90,0,45,0; "
            "repeatable. Default: those of a study's plan; mid-range of a robot."
        ),
    ] = None,
    draws: Annotated[
        int,
        typer.Option(
            min=0,
            max=10_000,
            help="Number of robots to write too, sampled from the uncertainty of the fit or of the "
            "robot file, with the table of their parameters.",
        ),
    ] = 0,
    seed: Annotated[
        int | None,
        typer.Option(min=0, help="Seed of the draws; by default that of the study, or 0."),
    ] = None,
    table_only: Annotated[bool, typer.Option(help="With --draws: write only the table.")] = False,
    workers: Workers = WORKERS,
    as_json: AsJson = False,
) -> None:
    """Write the identified model for MuJoCo, MATLAB, ROS, a controller, or the next study.

    Example: oed export studies/ur10.yaml --to mjcf -o ur10.xml
    """
    _check_options(to, draws, table_only)
    one_thread_each()
    from oed.study.pipeline import fit_study

    results = compute_study(Path(source), fit_study, workers, False) if is_study(source) else None
    model = _of_robot(source) if results is None else _of_study(results)
    if position:
        model = _at(model, position)
    if draws:
        _check_draws(model, draws)
    target = output or model.folder / f"{_file_name(model.robot)}{ENDINGS[FORMATS[to]]}"
    left_out = _written(model, target, FORMATS[to])
    files = [target]
    if draws:
        model = model if seed is None else replace(model, seed=seed)
        files += _drawn(model, target, FORMATS[to], draws, not table_only)
    say(
        lambda: "\n".join(
            [f"written  {_range(files)}{_of(model, draws)}", *(f"left out {x}" for x in left_out)]
        ),
        lambda: {
            "schema": "export/1",
            "files": list(map(str, files)),
            "left_out": left_out,
            "spread": _of(model, draws).removeprefix(", draws of the ") or None,
        },
        as_json,
    )
    if results is not None:
        end_with_failures(Path(source), results)


def _check_options(to: str, draws: int, table_only: bool) -> None:
    """Refuse options before a study is computed."""
    check_word("--to:", to, FORMATS)
    if table_only and not draws:
        raise InvalidInput("--table-only: there is no table without draws, such as --draws 20")


@dataclass(frozen=True, eq=False)
class _Model:
    """A robot, default positions (Q, n), covariance of ln theta or why not, folder of its files.

    It is drawn from the posterior (N, p) that the study has stored, or its source, by a seed.
    """

    robot: "ElasticRobot"
    source: "FittedModel | ElasticRobot"
    positions: "Array | None"
    covariance: "Array | None"
    folder: Path
    seed: int = 0
    no_covariance: tuple[str, ...] = ()
    posterior: "Array | None" = None


def _of_robot(name: str) -> _Model:
    from robotmodels import load_robot

    robot = load_robot(name)
    return _Model(robot, robot, None, None, Path())


def _of_study(results: "FittedStudy") -> _Model:
    """Return the robot of the fit that is a study's result."""
    from estimators.uncertainty.covariance import covariance

    fit, positions = results.fits.result, results.plan.positions
    folder, seed = results.study.output, results.study.seed
    stored = results.fits.posterior
    drawn = None if stored is None else stored.draws
    try:
        matrix = covariance(fit).covariance
    except IdentificationError as error:  # the model can be written all the same
        robot = fit.robot(results.trust)
        return _Model(robot, fit, positions, None, folder, seed, (f"covariance: {error}",), drawn)
    robot = fit.robot(results.trust, matrix)
    return _Model(robot, fit, positions, matrix, folder, seed, (), drawn)


def _at(model: _Model, position: list[str]) -> _Model:
    """Return the model with positions from the command line."""
    import numpy as np

    from reports.commands.check_options import read_position

    rows = np.array([read_position(model.robot, words) for words in position])
    return replace(model, positions=rows)


def _written(model: _Model, target: Path, format: Format) -> tuple[str, ...]:
    """Write a model and return what is left out."""
    from robotmodels import export as write

    left_out = write(model.robot, target, format, model.positions, model.covariance)
    return (*left_out, *model.no_covariance)


def _check_draws(model: _Model, count: int) -> None:
    """Refuse draws of what has none, before anything is written."""
    from estimators import recommended_uncertainty

    if model.posterior is not None:
        if len(model.posterior) < count:
            raise InvalidInput(f"--draws: {count}; the posterior has {len(model.posterior)} draws")
        return
    try:
        recommended_uncertainty(model.source)
    except IdentificationError as error:
        raise InvalidInput(f"--draws: {error}") from None


def _drawn(
    model: _Model, target: Path, format: Format, count: int, models: bool
) -> "tuple[Path, ...]":
    """Write robots drawn about a fit, the same ones every time for a seed, and their table."""
    import numpy as np

    from estimators.sampling.exported_draws import export_draws

    rng = np.random.default_rng(model.seed)
    return export_draws(
        model.source,
        target,
        format,
        count=count,
        rng=rng,
        draws=model.posterior,
        position=model.positions,
        models=models,
        table=True,
    )


def _of(model: _Model, draws: int) -> str:
    """Return in words of what draws are."""
    if not draws:
        return ""
    return f", draws of the {'covariance' if model.posterior is None else 'posterior'}"


def _range(files: list[Path]) -> str:
    """Return the robot's file, first and last file of draws, and their table."""
    draws = [f"{files[1]} to {files[-2].name}"] if len(files) > 2 else []
    return ", ".join([str(files[0]), *draws, *map(str, files[1:][-1:])])


def is_study(source: str) -> bool:
    """Whether a name is that of a study file, by what the file says of itself."""
    path = Path(source)
    if path.suffix not in (".yaml", ".yml") or not os.path.isfile(path):
        return os.path.isdir(path) and os.path.isfile(path / "study.yaml")
    return stated_schema(path).startswith("study/")


def stated_schema(path: Path) -> str:
    """Return the schema that a YAML file says it has, nothing if it says none."""
    from robotmodels.common.yaml_files import MOST_CHARACTERS, read_text, yaml_document

    text = read_text(path, MOST_CHARACTERS, "a study or a robot file")
    content = yaml_document(text, str(path), "a study or a robot file").content
    schema = content.get("schema") if isinstance(content, dict) else None
    return schema if isinstance(schema, str) else ""


def _file_name(robot: "ElasticRobot") -> str:
    """Return a robot's name as that of a file."""
    return "".join(c if c.isalnum() or c in "-_" else "_" for c in robot.name)[:80] or "robot"
