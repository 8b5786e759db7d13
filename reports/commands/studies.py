"""What the commands on a study share."""

import logging
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from reports.commands.options import about, fail, say, warn
from reports.commands.stopping import INTERRUPTED, stoppable, stopping_at_steps
from reports.commands.workers import one_thread_each, shared
from robotmodels.common.errors import IdentificationError, InvalidInput
from robotmodels.common.process_pool import ProcessPool, call, collect_rarely, load_ahead

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from oed.study.results import PlannedStudy
    from oed.study.settings.study_file import Study
    from oed.study.stage_cache import Failure
    from robotmodels.common.progress import StageProgress

StudyFile = Annotated[Path, typer.Argument(help="Study file, such as studies/ur10.yaml.")]
Fresh = Annotated[
    bool,
    typer.Option("--fresh", help="Compute all stages again, also those with unchanged inputs."),
]

Cluster = Annotated[
    str | None,
    typer.Option(
        help="Scheduler of a Dask cluster to compute on, such as tcp://host:8786.",
        show_default=False,
    ),
]

_OF_VISITS = frozenset({"minutes", "targets", "excitations", "spectra"})
"""Keys of a design of visits. Its settings are not asked, which load the numerics."""

_OTHER_COMMANDS = {
    "chains": "chains: coupled chains have neither design nor posterior; use oed run",
    "movements": (
        "data.movements: movements have neither design nor posterior; use oed run or oed fit"
    ),
    "visits": (
        "design: visits within minutes or to targets have neither fit nor posterior; "
        "oed design or oed run plans them, oed simulate carries them out"
    ),
}
"""What to do with studies of other kinds."""

_MODULES = (
    "reports.cli",
    "oed.study.pipeline",
    "estimators.validation.predictive_band",
)
"""What the processes of a study load at once."""

_COMPILING = "compiling for this processor, once after an installation: some 15 s more than later\n"

_Step = TypeVar("_Step", bound="PlannedStudy")
Pages = Callable[[Any, Path, Any], "tuple[Failure, ...]"]
"""Writes pages of results into a folder, tells its progress, returns what could not be made."""


@contextmanager
def _told_when_interrupted() -> Iterator[None]:
    """Say that nothing is lost by an interrupt."""
    try:
        with stoppable():
            yield
    except KeyboardInterrupt:
        sys.stderr.write(INTERRUPTED)
        raise


@contextmanager
def warnings_to(take: Callable[[str], object]) -> Iterator[None]:
    """Hand over what the stages of a study warn of, when they do."""
    handler, logger = logging.Handler(logging.WARNING), logging.getLogger("oed")
    handler.emit = lambda record: take(record.getMessage())  # type: ignore[method-assign,assignment]
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)


@contextmanager
def working(
    study: Path, workers: int, cluster: str | None, modules: Sequence[str] = ()
) -> "Iterator[tuple[StageProgress, Executor | None]]":
    """Give progress bars and processes to work on a study; an interrupt loses nothing.

    Parameters
    ----------
    modules : sequence of str
        As of `process_pool`.
    """
    from reports.summaries.progress import progress_bars

    with (
        _told_when_interrupted(),
        warnings_to(lambda warning: warn([warning])),
        about(study),
        progress_bars() as bars,
        shared(workers, cluster, modules) as executor,
    ):
        yield stopping_at_steps(bars), executor


def study_content(study: Path) -> dict[str, Any]:
    """Return what stands in a file, unchecked: nothing of one that cannot be read."""
    from robotmodels.common.yaml_files import MOST_CHARACTERS, read_text, yaml_document

    try:
        text = read_text(study, MOST_CHARACTERS, "a study")
        content = yaml_document(text, str(study), "a study").content
    except IdentificationError:
        return {}
    return content if isinstance(content, dict) else {}


def study_kind(study: Path) -> str:
    """Return which study a file says that it is: "chains", "movements", "visits" or "robot".

    It is "robot" for a file that cannot be read; the reader of studies names its error.
    """
    from oed.study.settings.deflection_settings import is_deflection_study

    content = study_content(study)
    if str(content.get("schema")).startswith("chain_study"):
        return "chains"
    design = content.get("design")
    if isinstance(design, dict) and not _OF_VISITS.isdisjoint(design):
        return "visits"
    return "movements" if is_deflection_study(content) else "robot"


def read_study(study: Path) -> "Study":
    """Return the study of a file.

    Raises
    ------
    InvalidInput
        If it cannot be read.
    """
    one_thread_each()  # before anything loads the numerics
    from oed.study.settings.study_file import load_study

    if study.is_dir() and (study / "study.yaml").is_file():
        raise InvalidInput(f"{study} is a folder; did you mean {study / 'study.yaml'}?")
    reason = _OTHER_COMMANDS.get(study_kind(study))
    if reason is not None:
        raise InvalidInput(f"{study}: {reason}")
    return load_study(study)


def compile_ahead(executor: "Executor | None") -> None:
    """Compile what later stages call, if it is not; who watches is told that it takes longer.

    The other process is asked whether it is: this one does not load the compiler.
    """
    if isinstance(executor, ProcessPool):
        if sys.stderr.isatty():
            executor.submit(call, "robotmodels.kernel", "is_compiled").add_done_callback(
                lambda asked: tell_of_compiling(
                    asked.cancelled() or bool(asked.exception()) or asked.result()
                )
            )
        executor.submit(call, "oed.study.compile_ahead", "compile_ahead")
    elif sys.stderr.isatty():
        tell_of_compiling(call("robotmodels.kernel", "is_compiled"))


def tell_of_compiling(compiled: bool) -> None:
    """Tell who watches that the first run takes longer, unless code is compiled."""
    if not compiled:
        sys.stderr.write(_COMPILING)


def compute_study(
    study: Path,
    step: Callable[..., _Step],
    workers: int,
    fresh: bool,
    pages: Pages | None = None,
    cluster: str | None = None,
) -> _Step:
    """Return a study computed as far as `step` goes, its files written.

    Parameters
    ----------
    study : Path
        File.
    step : callable
        `oed.study.pipeline.design_study`, `fit_study` or `run_study`.
    workers : int
        As the options say.
    fresh : bool
        As the options say.
    pages : Pages, optional
        Writes pages beside the files.
    cluster : str, optional
        Address of a scheduler, whose workers compute instead.

    Raises
    ------
    InvalidInput
        If the study cannot be read or no scheduler answers; and what `step` raises.
    """
    _load_ahead(workers, cluster)
    content = read_study(study)
    import oed.study.pipeline  # noqa: F401  # while another process loads it for the workers
    from robotmodels.common.atomic_files import staged_folder

    collect_rarely()
    new = fresh or not (content.output / "stages").exists()
    with working(study, workers, cluster, _MODULES if new else ()) as (progress, executor):
        if new:
            compile_ahead(executor)
        results = step(content, progress, executor=executor, fresh=fresh)
        if isinstance(executor, ProcessPool):
            executor.shutdown(wait=False)  # they end while the pages are drawn
        from oed.study.json_output import write_results

        with staged_folder(content.output) as folder:
            write_results(results, folder)
            if pages is not None:
                failed = pages(results, folder, progress)
                results = results.with_failures(*failed)
    return results


def _load_ahead(workers: int, cluster: str | None) -> None:
    """Let another process load what workers need while this one does the same."""
    if workers != 1 and cluster is None:
        one_thread_each()  # before anything loads the numerics
        load_ahead(_MODULES)


def end_with_failures(study: Path, results: "PlannedStudy") -> None:
    """End with an error if something could not be computed; all else is written by now.

    Exit code 2 if all of it is a user's to mend, 1 if not.
    """
    failures = results.run.failures
    if not failures:
        return
    reasons = "; ".join(f"{one.name}: {one.reason}" for one in failures)
    remedy = "everything else is written; run the same command again to continue"
    fail(f"{study}: {reasons}; {remedy}", 2 if all(one.mistake for one in failures) else 1)


def answer_study(
    study: Path, results: "PlannedStudy", files: Sequence[str], as_json: bool
) -> list[Path]:
    """Say what was computed, and end with an error if something could not be.

    Return the paths of the files, which lie in the study's output folder.
    """
    from reports.summaries.study_summary import study_json, study_summary

    written = [results.study.output / file for file in files]
    say(lambda: study_summary(results, written), lambda: study_json(results, written), as_json)
    end_with_failures(study, results)
    return written
