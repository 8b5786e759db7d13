"""``oed frf``: frequency responses from records."""

from math import pi
from typing import Annotated

import typer

from reports.commands.options import (
    AsJson,
    BesideRecords,
    Delay,
    Hold,
    Records,
    robot_names,
    say,
    warn,
)
from reports.commands.workers import one_thread_each


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(frf)


def frf(
    records: Records,
    method: Annotated[str, typer.Option(help="ari, har, log, h1 or jio.")] = "ari",
    delay: Delay = 0.0,
    hold: Hold = True,
    covariance: Annotated[
        str, typer.Option(help="total (from blocks) or noise (from periods, misses distortion).")
    ] = "total",
    structure: Annotated[
        str,
        typer.Option(help="Structure of the covariance of an FRF's elements: full or diagonal."),
    ] = "full",
    local: Annotated[
        bool | None,
        typer.Option(
            "--local/--no-local",
            help="Use neighbouring lines too (local model); default: if there are fewer runs than "
            "motors.",
        ),
    ] = None,
    band: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="LOW HIGH", help="Frequencies, in Hz; by default all excited lines."),
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option(
            help="Robot (name or file) whose linear model is plotted too.",
            autocompletion=robot_names,
        ),
    ] = None,
    compare: Annotated[
        bool, typer.Option("--compare", help="Rank the methods by simulating the measured loop.")
    ] = False,
    output: BesideRecords = None,
    as_json: AsJson = False,
) -> None:
    """Estimate frequency responses from records, with covariance, noise and distortion.

    Example: oed frf out/manutec_r3_experiment/records.h5 --robot manutec_r3
    """
    one_thread_each()
    from estimators.frf.file_formats import write_frf
    from estimators.frf.frf_from_records import measured_frf
    from reports.pages.frf_page import write_frf_page
    from reports.summaries.frf_summary import frf_json, frf_summary
    from reports.summaries.progress import progress_bars
    from robotmodels.common.atomic_files import staged_folder

    target = (records.parent if output is None else output).resolve()
    with progress_bars() as progress:
        measurement = measured_frf(
            records,
            method,
            covariance=covariance,
            structure=structure,
            local=local,
            delay=delay,
            hold=hold,
            band=None if band is None else (2 * pi * band[0], 2 * pi * band[1]),
            robot=robot,
            compare=compare,
            progress=progress,
        )
        with staged_folder(target) as folder:
            write_frf(folder / "frf.h5", measurement.estimate)
            write_frf_page(measurement, records, folder / "frf.html", progress)
    warn(measurement.warnings)
    files = [target / "frf.h5", target / "frf.html"]
    say(lambda: frf_summary(measurement, files), lambda: frf_json(measurement, files), as_json)
