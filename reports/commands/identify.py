"""``oed identify``: springs and dampers from records, without a study."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from reports.commands.options import (
    AsJson,
    BesideRecords,
    Delay,
    Hold,
    robot_names,
    say,
    warn,
)
from reports.commands.workers import one_thread_each
from robotmodels.common.errors import InvalidInput

if TYPE_CHECKING:
    from collections.abc import Mapping

    from estimators import RunFit, RunSpectra
    from estimators.fitting.run_fit import FrictionLevel
    from robotmodels import ElasticRobot, Records as RecordsOfRuns
    from robotmodels.common.arrays import Array

_SEED = 1  # of the starts


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(identify)


def identify(
    robot: Annotated[
        str,
        typer.Argument(help="Built-in robot, or a robot file.", autocompletion=robot_names),
    ],
    records: Annotated[
        list[Path],
        typer.Argument(help="Records: .h5, .mat or .csv; several files are fitted together."),
    ],
    noise: Annotated[
        str, typer.Option(help="Source of the noise estimate: auto, blocks, periods or detection.")
    ] = "auto",
    rows: Annotated[
        str, typer.Option(help="Weighting of the outputs: auto, joint or row_wise.")
    ] = "auto",
    states: Annotated[
        str,
        typer.Option(
            help="Of runs that do not end as they began: auto, yes (the model's), no, polynomial."
        ),
    ] = "auto",
    starts: Annotated[int, typer.Option(min=1, max=10_000, help="Number of starts.")] = 4,
    decades: Annotated[
        float, typer.Option(min=0, max=2.9, help="Starts are perturbed by 10^U(-decades, decades).")
    ] = 0.3,
    coulomb: Annotated[
        bool, typer.Option(help="Count Coulomb friction as dampers at the speeds of the records.")
    ] = False,
    friction: Annotated[
        bool,
        typer.Option(help="Estimate the level of the motors' Coulomb friction in each position."),
    ] = False,
    delay: Delay = 0.0,
    hold: Hold = True,
    output: BesideRecords = None,
    as_json: AsJson = False,
) -> None:
    """Fit a robot to records by maximum likelihood, with one or more runs in each position.

    Noise on torques and angles is modelled. Writes the identified robot as a robot file, beside
    the first records by default.

    Example: oed identify manutec_r3 out/manutec_r3_experiment/records.h5
    """
    one_thread_each()
    from estimators import covariance, read_records
    from estimators.frf.frf_from_records import collected_warnings
    from robotmodels import save_robot

    runs = {path: read_records(path) for path in records}
    model = _model(robot, [*runs.values()], coulomb, friction)
    with collected_warnings() as warnings:
        loops = _torque_loops(model, *next(iter(runs.items())))
        options: dict[str, Any] = {"noise": noise, "delay": delay, "hold": hold, "states": states}
        begun = _starts(model, starts, decades)
        fit, searches = _fit(model, runs, begun, rows, friction, **options)
    reached = sum(other.cost <= searches[0].cost * (1 + 1e-6) for other in searches)
    target = (output or records[0].parent) / f"{model.name}_identified.yaml"
    uncertainty = covariance(fit).covariance
    levels = fit.friction_levels(uncertainty)
    save_robot(fit.robot(covariance=uncertainty), target)
    warn(warnings)
    say(
        lambda: _summary(fit, levels, reached, starts, target, loops[0]),
        lambda: {**_json(fit, levels, reached, target), "torque_loop": loops[1]},
        as_json,
    )


def _fit(
    model: "ElasticRobot",
    runs: "Mapping[Path, RecordsOfRuns]",
    starts: "Array",
    rows: str,
    friction: bool,
    **options: Any,
) -> "tuple[RunFit, tuple[RunFit, ...]]":
    """Return the fit to the records of all files and the searches from `starts`, the best first."""
    from estimators import check_rigid_runs, multistart, settled_fit
    from robotmodels.common.errors import naming

    data = _joined(runs, **options)
    with naming(_files([*runs])):
        if friction:
            fit, searches = settled_fit(model, [*runs.values()], starts, weights=rows, **options)
        else:
            searches = multistart(model, data, starts, weights=rows)
            fit = searches[0]
        check_rigid_runs(fit.data, model)  # after the fit has refused data of other robots
    return fit, searches


def _starts(model: "ElasticRobot", count: int, decades: float) -> "Array":
    """Return where searches begin, (count, p) [SI]."""
    import numpy as np

    from estimators import perturbed_starts

    return perturbed_starts(model.parameters, count, decades, np.random.default_rng(_SEED))


def _files(records: list[Path]) -> str:
    """Return the first file, and how many more there are."""
    more = len(records) - 1
    return f"{records[0]} and {more} more" if more else str(records[0])


def _joined(runs: "Mapping[Path, RecordsOfRuns]", **options: Any) -> "RunSpectra":
    """Return the spectra of the records of all files."""
    from estimators import RunSpectra, run_spectra
    from robotmodels.common.errors import naming

    parts = []
    for path, records in runs.items():
        with naming(path):
            parts.append(run_spectra(records, **options))
    with naming(_files([*runs])):
        return parts[0] if len(parts) == 1 else RunSpectra.join(parts)


def _model(
    name: str, records: "list[RecordsOfRuns]", coulomb: bool, friction: bool
) -> "ElasticRobot":
    """Return the robot; with `coulomb` friction counts as dampers, and it is said as what."""
    from robotmodels import at_recorded_speeds, load_robot
    from robotmodels.description.friction import friction_sentences

    if not coulomb:
        return load_robot(name)
    if friction:
        raise InvalidInput(
            "--coulomb, --friction: friction is modelled as a damper or as a level; give one"
        )
    if len(records) > 1:
        raise InvalidInput(f"--coulomb: {len(records)} files of records; speeds of one are needed")
    counted = at_recorded_speeds(load_robot(name), records[0])
    warn(friction_sentences(counted.file))
    return counted


def _torque_loops(
    robot: "ElasticRobot", path: Path, records: "RecordsOfRuns"
) -> tuple[list[str], list[dict[str, object]] | None]:
    """Return the loops between commanded and measured torques in words and for scripts."""
    from estimators.frf.torque_loop import torque_loop
    from reports.summaries.frf_summary import loop_json, loop_words
    from robotmodels.common.errors import naming

    if records.commanded:
        return [], None
    with naming(path):
        loop = torque_loop(records)
    return loop_words(loop, robot.motor_names), loop_json(loop, robot.motor_names)


def _summary(
    fit: "RunFit",
    levels: "tuple[FrictionLevel, ...]",
    reached: int,
    starts: int,
    written: Path,
    loops: list[str],
) -> str:
    from reports.sections.verdict import interval_words
    from reports.summaries.columns import described, plain
    from reports.summaries.friction_levels import level_words

    ratio = fit.cost / fit.expected_cost
    lines = [
        ("data", str(fit.data)),
        *(("loop", words) for words in loops),
        *((f"friction of {one.motor}", level_words(one)) for one in levels),
        ("fit", f"cost {ratio:.3f} times its expectation; {reached} of {starts} starts"),
        *(
            (one.name, plain(f"{interval_words(one)} {unit}"))
            for one, unit in zip(fit.intervals(), fit.parameters.units, strict=True)
        ),
        ("verdict", f"{fit.verdict}: {fit.verdict.reason}"),
        ("written", str(written)),
    ]
    return "\n".join([getattr(fit.model, "name", "model"), *described(lines)])


def _json(
    fit: "RunFit", levels: "tuple[FrictionLevel, ...]", reached: int, written: Path
) -> dict[str, object]:
    from reports.summaries.friction_levels import levels_json

    trust = fit.trust.document()
    return {
        "schema": "identify/1",
        "cost": fit.cost,
        "expected_cost": fit.expected_cost,
        "row_wise": fit.row_wise,
        "reached": reached,
        **{key: trust[key] for key in ("verdict", "reason", "intervals")},
        **({} if fit.coulomb is None else {"coulomb": fit.coulomb.tolist()}),
        "friction": levels_json(levels),
        "file": str(written),
    }
