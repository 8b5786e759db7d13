"""A small study, killed at random moments and its files damaged: it must end with the same bytes.

Every attempt is a process forked from one that has loaded the libraries.
"""

import contextlib
import importlib
import os
import shutil
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from random import Random

import conftest  # of tests/e2e
import killed

RESULTS = Path("results") / "here"
OUTPUT = "design.json", "fit.json", "uncertainty.json"
CHANGES = 180
"""That a whole run makes to its folder."""
LIBRARIES = "pinocchio", "cvxpy", "iminuit", "robotmodels.kernel", "oed.study.pipeline"
LIBRARIES += ("estimators.sampling.posterior", "reports.summaries.study_summary")


@dataclass
class Tally:
    """How often something was done, and the times that the results differed."""

    done: int
    faults: list[str]


class DamagedStudy:
    """The undisturbed study in a folder of its own, with which all others are compared."""

    def __init__(self, folder: Path) -> None:
        for name in LIBRARIES:
            importlib.import_module(name)
        self.folder = folder
        self.seconds = 0.0
        begun = time.monotonic()
        self.compute(conftest.write_study(folder / "undisturbed"))
        self.seconds = time.monotonic() - begun

    @property
    def reference(self) -> Path:
        """The results of the undisturbed run."""
        return self.folder / "undisturbed" / RESULTS

    def compute(self, study: Path) -> None:
        """Run a study to its end.

        Raises
        ------
        RuntimeError : if it ends with an error.
        """
        status = attempt(study, lambda: None)
        if status:
            raise RuntimeError(f"the study ended with {status}")

    def killed(self, until: float, rng: Random) -> tuple[Tally, int]:
        """Return kills and cycles: each study is killed again and again, and then left to end.

        Half of the kills come right before a change to its folder, half at any time.
        """
        kills, cycles = Tally(0, []), 0
        while time.monotonic() < until:
            study = conftest.write_study(self.folder / "killed")
            folder = str(study.parent / RESULTS)
            status = 1
            while status:
                if rng.random() < 0.5:
                    change = rng.randrange(1, CHANGES // 2)
                    status = attempt(study, partial(killed.die_before, change, folder))
                else:
                    status = attempt(study, lambda: None, rng.uniform(0, self.seconds))
                kills.done += status == -signal.SIGKILL
                if status not in (0, -signal.SIGKILL):
                    kills.faults.append(f"exit code {status}")
                    break
            else:
                kills.faults += self.differences(study)
            cycles += 1
            shutil.rmtree(study.parent)
        return kills, cycles

    def finished_files(self, until: float, rng: Random) -> Tally:
        """Return what came of damage to a file of a finished stage."""
        files = sorted(p for p in (self.reference / "stages").rglob("*") if p.is_file())
        return self._damaged(until, rng, self.reference.parents[1], files)

    def unfinished_files(self, until: float, rng: Random) -> Tally:
        """Return what came of damage to a file of a stage that was killed before its end."""
        study = conftest.write_study(self.folder / "halfway")
        folder = study.parent / RESULTS
        for change in (150, 15, 8, 4):  # so far into the posterior
            attempt(study, partial(killed.die_before, change, str(folder)))
            files = sorted(p for p in folder.glob("stages/*.part/*") if p.stat().st_size)
            if files and files[0].parent.name.startswith("posterior"):
                break
        return self._damaged(until, rng, study.parent, files)

    def _damaged(self, until: float, rng: Random, origin: Path, files: list[Path]) -> Tally:
        tally = Tally(0, [])
        while files and time.monotonic() < until:
            file = rng.choice(files)
            copy = self.folder / "damaged"
            shutil.copytree(origin, copy)
            how = damage(copy / file.relative_to(origin), rng)
            status = attempt(copy / "study.yaml", lambda: None)
            differ = [f"exit code {status}"] if status else self.differences(copy / "study.yaml")
            where = file.relative_to(origin / RESULTS)
            tally.faults += [f"{where} {how}: {one}" for one in differ]
            tally.done += 1
            shutil.rmtree(copy)
        return tally

    def differences(self, study: Path) -> list[str]:
        """Return the files of results that are not those of the undisturbed run, to the last bit.

        Files of stages that say how long they took are left out.
        """
        here = study.parent / RESULTS
        names = [Path(name) for name in OUTPUT]
        for path in (self.reference / "stages").rglob("*"):
            if path.is_file() and path.name != "stage.json":
                names.append(path.relative_to(self.reference))
        return [
            f"{name} differs"
            for name in names
            if not (here / name).is_file()
            or (here / name).read_bytes() != (self.reference / name).read_bytes()
        ]


def damage(file: Path, rng: Random) -> str:
    """Flip a bit of a file, cut it short or remove it; return which."""
    content = bytearray(file.read_bytes())
    how = rng.choice(("flipped", "flipped", "cut", "removed")) if content else "removed"
    if how == "removed":
        file.unlink()
    elif how == "cut":
        file.write_bytes(content[: rng.randrange(len(content))])
    else:
        content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
        file.write_bytes(content)
    return how


def attempt(study: Path, prepare: Callable[[], object], seconds: float | None = None) -> int:
    """Compute a study in a process of its own; return its exit code, minus a signal's number.

    Parameters
    ----------
    prepare : called in that process before.
    seconds : after which it is killed.
    """
    child = os.fork()
    if child == 0:
        code = 1
        with contextlib.suppress(BaseException):
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            prepare()
            code = conftest.oed("sample", study, "--workers", 1)[0]
        os._exit(code)
    begun = time.monotonic()
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status)
        if seconds is not None and time.monotonic() > begun + seconds:
            os.kill(child, signal.SIGKILL)
            seconds = None
        time.sleep(0.01)
