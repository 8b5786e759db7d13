"""The command line: ``oed run``, ``oed simulate``, ``oed frf`` and ``oed check``."""

import multiprocessing
import os
import signal
import sys
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from robotmodels.errors import IdentificationError

_WORKERS = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Optimal experiment design and uncertainty for elastic robots.",
)


@app.command()
def run(
    study: Annotated[Path, typer.Argument(help="Study file, such as studies/ur10.yaml.")],
    workers: Annotated[
        int, typer.Option(min=1, help="Processes for fits and sampling; 1 works in this one.")
    ] = _WORKERS,
) -> None:
    """Compute a study and write its report: where to measure, what comes out, how certain it is.

    Example: oed run studies/ur10.yaml
    """
    _one_thread_each()
    # Imported here: `oed --help` need not wait for the numerics.
    from oed.study import run_study
    from oed.study_file import load_study
    from oed.study_output import staged_folder, write_results
    from reports.page import write_report
    from reports.progress import progress_bars
    from reports.summary import study_summary

    content = load_study(study)
    with (
        staged_folder(content.output) as folder,
        progress_bars() as progress,
        _pool(workers) as executor,
    ):
        results = run_study(content, progress, chains=folder / "posterior.h5", executor=executor)
        write_results(results, folder)
        write_report(results, folder / "report.html", progress)
    typer.echo(study_summary(results, content.output / "report.html"))


@app.command()
def simulate(
    experiment: Annotated[
        Path, typer.Argument(help="Experiment file, such as studies/manutec_r3_experiment.yaml.")
    ],
    workers: Annotated[
        int, typer.Option(min=1, help="Processes for the simulation; 1 works in this one.")
    ] = _WORKERS,
) -> None:
    """Plan an experiment inside its limits and simulate it: multisines, closed loop, records.

    Example: oed simulate studies/manutec_r3_experiment.yaml
    """
    _one_thread_each()
    from oed.experiment import prepare, run_experiment
    from oed.experiment_file import load_experiment
    from oed.study_output import staged_folder
    from reports.experiment_summary import experiment_summary
    from reports.progress import progress_bars

    content = load_experiment(experiment)
    with (
        staged_folder(content.output) as folder,
        progress_bars() as progress,
        _pool(workers) as executor,
    ):
        prepared = prepare(content, progress)
        outcome = run_experiment(prepared, folder, progress, executor)
    typer.echo(experiment_summary(prepared, outcome, content.output))


@app.command()
def frf(
    records: Annotated[Path, typer.Argument(help="Records: .h5, .mat or .csv.")],
    method: Annotated[str, typer.Option(help="ari, har, log, h1 or jio.")] = "ari",
    delay: Annotated[float, typer.Option(help="Of the angles after the torques, in s.")] = 0.0,
    hold: Annotated[
        bool,
        typer.Option("--hold/--no-hold", help="Commanded torques are held, measured ones not."),
    ] = True,
    covariance: Annotated[
        str, typer.Option(help="total (from blocks) or noise (from periods, misses distortion).")
    ] = "total",
    robot: Annotated[
        str | None, typer.Option(help="Robot (name or file) whose linear model is shown beside.")
    ] = None,
    compare: Annotated[
        bool, typer.Option("--compare", help="Rank the methods by simulating the measured loop.")
    ] = False,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Folder; by default that of the records.")
    ] = None,
) -> None:
    """Estimate frequency responses from records, with covariance, noise and distortion.

    Example: oed frf out/manutec_r3_experiment/records.h5 --robot manutec_r3
    """
    _one_thread_each()
    from estimators.exchange import write_frf
    from oed.measured_frf import measured_frf
    from oed.study_output import staged_folder
    from reports.frf_page import frf_summary, write_frf_page
    from reports.progress import progress_bars

    target = (records.parent if output is None else output).resolve()
    with progress_bars() as progress:
        found = measured_frf(
            records,
            method,
            covariance=covariance,
            delay=delay,
            hold=hold,
            robot=robot,
            compare=compare,
            progress=progress,
        )
        with staged_folder(target) as folder:
            write_frf(folder / "frf.h5", found.estimate)
            write_frf_page(found, records, folder / "frf.html", progress)
    for warning in found.warnings:
        typer.echo(f"warning: {warning}", err=True)
    typer.echo(frf_summary(found, [target / "frf.h5", target / "frf.html"]))


@app.command()
def check(
    robot: Annotated[str, typer.Argument(help="A built-in robot, or the path of a robot file.")],
    position: Annotated[
        str | None,
        typer.Option(
            help="One per motor, in degrees (m if prismatic): 0,-90,90,0,45,0; default: mid-range."
        ),
    ] = None,
    band: Annotated[str, typer.Option(help="Frequencies of interest, LOW,HIGH in Hz.")] = "2,80",
    as_json: Annotated[
        bool, typer.Option("--json", help="Print it as JSON, in SI units (rad, rad/s).")
    ] = False,
) -> None:
    """Show a robot: its bodies, motors, springs, equilibrium and modes, and what looks wrong.

    Example: oed check ur10 --position 0,-90,90,0,45,0
    """
    from reports.check_options import read_band, read_position
    from reports.robot_summary import robot_json, robot_summary
    from robotmodels import load_robot
    from robotmodels.diagnosis import diagnose
    from robotmodels.suspicions import suspicions

    model = load_robot(robot)
    diagnosis = diagnose(model, read_position(model, position), read_band(band))
    show = robot_json if as_json else robot_summary
    typer.echo(show(diagnosis, suspicions(diagnosis), model.file))


def main() -> None:
    """Run the command line; a user's mistake ends in one line and exit code 2."""
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) == signal.SIG_DFL:  # not under nohup
            signal.signal(number, _end)
    try:
        app()
    except IdentificationError as error:
        sys.stderr.write(f"error: {error}\n")
        sys.exit(2)
    except BrokenProcessPool:
        sys.stderr.write(
            "error: a worker process was killed, perhaps for want of memory; try --workers 1\n"
        )
        sys.exit(1)


def _end(number: int, _: object) -> None:
    """End as at an error, so that what is half-written is taken away."""
    sys.exit(128 + number)


def _one_thread_each() -> None:
    """Keep BLAS to one thread: the matrices are small and every core has a process."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")


@contextmanager
def _pool(workers: int) -> Iterator[Executor | None]:
    if workers == 1:
        yield None
        return
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_die_quietly)
    try:
        yield pool
    except BaseException:
        for process in multiprocessing.active_children():
            process.terminate()  # what they compute is not wanted any more
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _die_quietly() -> None:
    """Let an interrupt end a worker without a traceback; the parent reports."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


if __name__ == "__main__":
    main()
