"""``oed structure``: which springs the data of a study ask for."""

from typing import Annotated

import typer

from reports.commands.options import WORKERS, AsJson, Workers, say
from reports.commands.studies import Fresh, StudyFile, read_study, working

_FILES = ("structure.json", "structure.html", "structure.yaml")


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(structure)


def structure(
    study: StudyFile,
    level: Annotated[
        float, typer.Option(help="Probability of a false alarm of all score tests of a step.")
    ] = 0.01,
    most: Annotated[int, typer.Option(help="Springs that are added at most.", min=0)] = 8,
    workers: Workers = WORKERS,
    fresh: Fresh = False,
    as_json: AsJson = False,
) -> None:
    """Identify which springs a robot has in addition to those of its file, from a study's data.

    Reads or simulates the data and fits them, as oed fit does. Writes structure.json, a page
    structure.html, and structure.yaml: the robot file with the springs, all values fitted.

    Example: oed structure study.yaml --level 0.01
    """
    content = read_study(study)
    from oed.study.pipeline import structure_study
    from reports.pages.structure_page import write_structure_page
    from reports.summaries.structure_summary import structure_json, structure_summary
    from robotmodels import save_robot
    from robotmodels.common.atomic_files import staged_folder
    from robotmodels.common.plain_data import write_json

    with working(study, workers, None) as (progress, executor):
        fitted, results = structure_study(
            content, progress, executor=executor, fresh=fresh, level=level, most=most
        )
        files = [content.output / name for name in _FILES]
        with staged_folder(content.output) as folder:
            write_json(folder / files[0].name, structure_json(results, []))
            write_structure_page(fitted, results, folder / files[1].name)
        save_robot(results.choice.fit.robot(), files[2])  # its paths are relative to where it lies
    say(lambda: structure_summary(results, files), lambda: structure_json(results, files), as_json)
