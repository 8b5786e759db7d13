"""Commands run one by one, each in a child of a process that has everything loaded.

The child may write inside its folder only, and has limits of its own: processor time, memory, size
of files. What it printed, and how it ended, is all that is judged.
"""

import contextlib
import importlib
import io
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import seeds

SECONDS = 20
"""Processor time of a command, more than which is a hang."""

PATIENCE = 5
"""Time of the clock for which a command may sleep [s]."""

MEMORY = 2 << 30
"""Address space of a command beyond what is loaded before [bytes]."""

FILE_SIZE = 1 << 30

LIBRARIES = """cvxpy clarabel iminuit emcee pyuff scipy.io mujoco pinocchio
    reports.application oed.study.pipeline estimators.sampling.posterior reports.commands.schemas
    reports.summaries.study_summary reports.pages.study_page reports.pages.comparison
    reports.commands.init_files oed.replication.json_output reports.pages.replication_page
    oed.experiment.experiment_plan estimators.chain_dampers.chains_from_records
    estimators.frf.frf_from_records reports.pages.frf_page reports.pages.chains_page"""


@dataclass(frozen=True)
class Outcome:
    """How a command ended.

    Attributes
    ----------
    code : exit code, minus the signal's number where one ended it.
    out, err : what it printed.
    late : whether its time was up.
    seconds : processor time.
    """

    code: int
    out: str
    err: str
    late: bool
    seconds: float


class Runner:
    """A process that runs commands; a context manager."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        program = [sys.executable, str(Path(__file__).resolve()), str(folder)]
        self._server = subprocess.Popen(
            program, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        if self._line() != "ready":
            raise RuntimeError("no process to run commands")

    def __enter__(self) -> "Runner":
        return self

    def __exit__(self, *_: object) -> None:
        self._server.communicate()  # closes what it reads, which ends it

    def run(self, words: Sequence[str], folder: Path, draws: bool = False) -> Outcome:
        """Return how ``oed WORDS`` ended in a folder.

        Parameters
        ----------
        words : of the command; "python:module:function" in place of it calls that with the others.
        folder : where it runs, which is the only one that it may write to.
        draws : whether pages have their pictures, which take most of their time.
        """
        job = {"words": list(words), "folder": str(folder), "draws": draws}
        self._server.stdin.write(json.dumps(job) + "\n")
        self._server.stdin.flush()
        return Outcome(**json.loads(self._line()))

    def _line(self) -> str:
        line = self._server.stdout.readline()
        if not line:
            code = self._server.wait()
            raise RuntimeError(f"the process that runs commands has ended: {code}")
        return line.strip()


def serve(folder: Path) -> None:
    """Load everything, make the folders of seeds in `folder`, then run commands one by one."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    for name in LIBRARIES.split():
        importlib.import_module(name)
    with without_pictures():
        seeds.make_seeds(folder)  # which also compiles, and reads, what is needed once
    _spend_little()
    answers.write("ready\n")
    answers.flush()
    for line in sys.stdin:
        answers.write(json.dumps(asdict(_run(**json.loads(line)))) + "\n")
        answers.flush()


def _spend_little() -> None:
    """Take cheap settings for those that a file leaves out."""
    from oed.study.settings.fit_settings import FitChoice
    from oed.study.settings.study_file import CompareChoice, PosteriorChoice, Study

    cheap = {"ensembles": 2, "walkers": 16, "steps": 120, "starts": 1, "runs": 7, "random": 1}
    for section in (CompareChoice, FitChoice, PosteriorChoice):
        for name in section.model_fields.keys() & cheap.keys():
            section.model_fields[name].default = cheap[name]
        section.model_rebuild(force=True)
    for name, section in (("compare", CompareChoice), ("fit", FitChoice)):
        Study.model_fields[name].default = section()
    Study.model_fields["posterior"].default = PosteriorChoice()
    Study.model_rebuild(force=True)


def _run(words: list[str], folder: str, draws: bool) -> Outcome:
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        child = os.fork()
        if not child:
            _child(words, folder, draws, out.fileno(), err.fileno())
        late, code, seconds = _ended(child)
        out.seek(0)
        err.seek(0)
        text, errors = (f.read(1 << 20).decode("utf-8", "backslashreplace") for f in (out, err))
    return Outcome(code, text, errors, late, seconds)


def _ended(child: int) -> tuple[bool, int, float]:
    """Wait for a child; return whether it had to be killed, its exit code and processor time."""
    pause, watch, late = 0.001, _Watch(child), False
    while True:
        done, status, usage = os.wait4(child, os.WNOHANG)
        if done:
            break
        if watch.waits_for_nothing():
            late = True
            os.kill(child, signal.SIGXCPU)  # says where it is
            time.sleep(0.5)
            os.kill(child, signal.SIGKILL)
            _, status, usage = os.wait4(child, 0)
            break
        time.sleep(pause)
        pause = min(1.5 * pause, 0.05)
    seconds = usage.ru_utime + usage.ru_stime
    return late or seconds >= SECONDS, os.waitstatus_to_exitcode(status), seconds


class _Watch:
    """Tells a process that sleeps, such as at a pipe, from one that others keep from working."""

    def __init__(self, process: int) -> None:
        self.status = Path(f"/proc/{process}/stat")
        self.used, self.since = "", time.monotonic()

    def waits_for_nothing(self) -> bool:
        """Whether the process has slept for long."""
        fields = self.status.read_text().rpartition(")")[2].split()
        state, used = fields[0], f"{fields[11]} {fields[12]}"
        if state not in "SD" or used != self.used:
            self.used, self.since = used, time.monotonic()
        return time.monotonic() - self.since > PATIENCE


def _child(words: list[str], folder: str, draws: bool, out: int, err: int) -> None:
    """Run a command and end this process."""
    code = 70
    try:
        os.dup2(out, 1)
        os.dup2(err, 2)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        sys.stdout = io.TextIOWrapper(os.fdopen(1, "wb", closefd=False), encoding="utf-8")
        sys.stderr = io.TextIOWrapper(
            os.fdopen(2, "wb", closefd=False), encoding="utf-8", errors="backslashreplace"
        )
        os.chdir(folder)
        _limit()
        _confine(folder)
        code = _command(words, draws)
    except BaseException:
        import traceback

        traceback.print_exc()
        code = 1
    finally:
        with contextlib.suppress(Exception):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def _limit() -> None:
    import faulthandler

    faulthandler.enable(file=2)
    faulthandler.register(signal.SIGXCPU, file=2)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    memory = pages * resource.getpagesize() + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 1))
    resource.setrlimit(resource.RLIMIT_FSIZE, (FILE_SIZE, FILE_SIZE))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


_CHANGES = (
    "os.mkdir",
    "os.rename",
    "os.remove",
    "os.rmdir",
    "os.link",
    "os.symlink",
    "os.truncate",
)
_WRITING = os.O_WRONLY | os.O_RDWR


def _confine(folder: str) -> None:
    """Refuse changes of files elsewhere, as a file system would."""
    inside = (folder, tempfile.gettempdir() + "/tmp", "/dev/")

    def refuse(event: str, arguments: tuple[Any, ...]) -> None:
        writes = event == "open" and isinstance(arguments[2], int) and arguments[2] & _WRITING
        if not writes and event not in _CHANGES:
            return
        for path in arguments[: 2 if event == "os.rename" else 1]:
            if not isinstance(path, str | bytes | os.PathLike):
                continue
            real = os.path.realpath(os.fsdecode(path))
            if not real.startswith(inside) and "__pycache__" not in real:
                raise PermissionError(13, os.strerror(13), os.fsdecode(path))

    sys.addaudithook(refuse)


def _command(words: list[str], draws: bool) -> int:
    """Run a command here; return its exit code."""
    try:
        with contextlib.nullcontext() if draws else without_pictures():
            if words[0].startswith("python:"):
                _call(*words)
            else:
                from reports import cli

                sys.argv = ["oed", "--quiet", *words]
                cli.main()
    except SystemExit as ended:
        return int(ended.code or 0)
    return 0


@contextlib.contextmanager
def without_pictures() -> Iterator[None]:
    """Leave pictures out of pages: drawing takes most of their time."""
    from markupsafe import Markup

    from reports.figures import svg

    inline = svg.inline
    svg.inline = lambda draw, name, alt: Markup('<svg id="{}"></svg>').format(name)
    try:
        yield
    finally:
        svg.inline = inline


def _call(function: str, *words: str) -> None:
    """Call a function of the library, and end as a command would."""
    from robotmodels.common.errors import IdentificationError

    _, module, name = function.split(":")
    work: Any = importlib.import_module(module)
    for part in name.split("."):
        work = getattr(work, part)
    try:
        work(*words)
    except IdentificationError as error:
        sys.stderr.write(f"error: {error}\n")
        sys.exit(2)


if __name__ == "__main__":
    serve(Path(sys.argv[1]))
