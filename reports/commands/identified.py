"""What commands about identified robots are told: whose fit, in which positions."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from reports.commands.export import is_study
from reports.commands.options import robot_names
from reports.commands.studies import compute_study
from reports.commands.workers import one_thread_each

if TYPE_CHECKING:
    from estimators.fitting.fitted_model import FittedModel
    from robotmodels import ElasticRobot
    from robotmodels.common.arrays import Array

Source = Annotated[
    str,
    typer.Argument(
        help="A study file, whose fit is taken, or a robot file with standard deviations.",
        autocompletion=robot_names,
    ),
]
Position = Annotated[
    list[str] | None,
    typer.Option(
        help="One number per motor, in degrees (m if prismatic): 0,-90,90,0,45,0; several times "
        "for several. Default: those of a study's plan; mid-range of a robot."
    ),
]
Output = Annotated[
    Path | None,
    typer.Option("-o", "--output", help="Folder; by default that of the study, or this one."),
]
Seed = Annotated[int, typer.Option(min=0, help="Of the draws.")]
Map = Annotated[
    int,
    typer.Option("--map", min=0, max=100_000, help="So many positions all over the joint ranges."),
]


def read_source(
    source: str, position: Sequence[str] | None, spread: int, workers: int
) -> "tuple[FittedModel | ElasticRobot, ElasticRobot, Array, Path]":
    """Return a fit or a robot with standard deviations, its robot, positions (Q, n), and a folder.

    Positions are those named, or `spread` of them over the joint ranges, or those of the study.

    Raises
    ------
    IdentificationError
        If there is no such file, or the study cannot be computed.
    """
    one_thread_each()
    import numpy as np

    from oed.candidates.grids import sobol_positions
    from oed.study.pipeline import fit_study
    from reports.commands.check_options import read_position
    from robotmodels import load_robot
    from robotmodels.elastic.tool_response import underlying_robot

    fitted: FittedModel | ElasticRobot
    if is_study(source):
        results = compute_study(Path(source), fit_study, workers, False)
        fitted, positions = results.fits.result, results.plan.positions
        robot, folder = underlying_robot(fitted.model), results.study.output
    else:
        fitted = robot = load_robot(source)
        positions, folder = read_position(robot, None)[None], Path()
    if position:
        positions = np.array([read_position(robot, words) for words in position])
    elif spread:
        positions = sobol_positions(robot, spread)
    return fitted, robot, positions, folder
