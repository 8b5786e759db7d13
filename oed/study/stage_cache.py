"""Stages of a long computation: each is computed once and stored while its inputs do not change.

A stage lives in a folder of its name::

    design/            the files that the stage saved
        stage.json     ``key``, ``digest``, ``seconds``, ``versions``
    posterior.part/    a stage that is not finished: what it needs to go on

The key is a hash of the stage's settings, of the results it rests on (their digests) and of this
package's version; the digest is a hash of the stage's files. A stage whose key fits is loaded
instead of computed. A run may be killed at any moment: a finished stage appears under its name by
one renaming, and an unfinished one resumes from its files.
"""

import json
import logging
import math
import os
import platform
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, Generic, TypeVar

from robotmodels.common.atomic_files import exclusive_folder, remove, write_text
from robotmodels.common.checkpoint_file import UnusableCheckpoint
from robotmodels.common.dataclass_files import read_dataclass, write_dataclass
from robotmodels.common.errors import IdentificationError, InvalidInput
from robotmodels.common.file_paths import check_file
from robotmodels.common.fingerprints import folder_digest, json_digest
from robotmodels.common.progress import Progress, StageProgress

T = TypeVar("T")
Result = TypeVar("Result", covariant=True)

PACKAGE = "elastic-robot-oed"
_LOG = logging.getLogger(__name__)
_PACKAGES = (
    PACKAGE,
    "numpy",
    "scipy",
    "pin",
    "mujoco",
    "cvxpy",
    "clarabel",
    "scs",
    "emcee",
    "numba",
)
_RECORD, _KEY, _RESULT = "stage.json", "key", "result.h5"
_MOST_BYTES = 2**20
_CACHE_FILES = frozenset({_RECORD, "stage.part.json", _KEY})


@dataclass(frozen=True)
class Files(Generic[T]):
    """How a stage's result is saved to a folder and loaded from it, bit for bit."""

    save: Callable[[T, Path], None]
    load: Callable[[Path], T]


def dataclass_files(kind: type[T]) -> Files[T]:
    """Return how a dataclass is stored."""
    return Files(
        save=lambda value, folder: write_dataclass(folder / _RESULT, value),
        load=lambda folder: read_dataclass(folder / _RESULT, kind),
    )


@dataclass(frozen=True)
class Failure:
    """What could not be computed, though the results go on without it.

    Attributes
    ----------
    name : str
        Name of the stage, or of a section of a page.
    reason : str
        In one line.
    mistake : bool
        Whether a user can mend it: an `IdentificationError`.
    """

    name: str
    reason: str
    mistake: bool

    @classmethod
    def of(cls, name: str, error: Exception) -> "Failure":
        """Return the failure that an error means."""
        _LOG.debug("%s failed", name, exc_info=error)
        mistake, words = isinstance(error, IdentificationError), " ".join(str(error).split())
        reason = words if mistake and words else f"{type(error).__name__}: {words}"
        return cls(name, reason, mistake)


@dataclass(frozen=True, eq=False)
class Stage(Generic[Result]):
    """A finished stage.

    Attributes
    ----------
    name : str
        Name of the stage.
    value : Result
        Its result.
    digest : str
        Hash of its files, for the keys of stages that depend on it.
    seconds : float
        Seconds that its computation took.
    loaded : bool
        Whether it was loaded rather than computed.
    """

    name: str
    value: Result
    digest: str
    seconds: float
    loaded: bool


class _EndedError(Exception):
    """Another stage failed, without which this one is of no use."""


@dataclass(frozen=True, eq=False)
class Beside(Generic[Result]):
    """A stage that may be computed in a thread of its own.

    Attributes
    ----------
    result : callable
        Returns what `Stages.attempt` would, when it is there.
    done : callable
        Tells whether nothing goes on in the thread.
    """

    result: Callable[[], Result | None]
    done: Callable[[], bool]


class Stages:
    """Stages in one folder.

    Attributes
    ----------
    finished : dict of str to Stage[Any]
        All stages so far, by name.
    failures : list of Failure
        Failures of stages that the results do without.
    """

    def __init__(
        self, folder: Path, progress: StageProgress | None = None, fresh: bool = False
    ) -> None:
        self.folder = folder
        self.progress = progress
        self.fresh = fresh
        self.finished: dict[str, Stage[Any]] = {}
        self.failures: list[Failure] = []
        self._ended = False

    def run(
        self,
        name: str,
        inputs: Mapping[str, Any],
        compute: Callable[[Path, Progress | None], T],
        files: Files[T],
    ) -> Stage[T]:
        """Return a stage, loaded if it fits, computed and saved otherwise.

        Parameters
        ----------
        name : str
            Name of the stage and its folder.
        inputs : mapping of str to Any
            Plain data that decide its result: settings, digests of other stages.
        compute : callable
            Is given a folder, whose files outlive an interruption, and the progress.
        files : Files[T]
            Saves and loads the result; what is returned was always loaded.
        """
        stage, key = self.stored(name, inputs, files), _key(name, inputs)
        if stage is None:
            target, part = self.folder / name, self.folder / f"{name}.part"
            record = self._compute(name, key, part, compute, files)
            _rename(part, target)
            stage = Stage(name, files.load(target), record["digest"], record["seconds"], False)
        self.finished[name] = stage
        if self.progress is not None:
            self.progress(name, 1, 1)
        return stage

    def stored(self, name: str, inputs: Mapping[str, Any], files: Files[T]) -> Stage[T] | None:
        """Return a stage that an earlier run finished; None where there is none that fits."""
        return None if self.fresh else self._load(name, _key(name, inputs), files)

    def attempt(self, name: str, run: Callable[[], T]) -> T | None:
        """Return what `run` returns; None where it fails, which is then among the failures.

        A late stage must not cost what came before: whatever its error, the results go on without.
        """
        try:
            return run()
        except Exception as error:  # also one that nobody foresaw: see above
            self.failures.append(Failure.of(name, error))
            return None

    @contextmanager
    def beside(self, name: str, run: Callable[[], T], at_once: bool) -> Iterator["Beside[T]"]:
        """Give a stage that others do not need.

        Parameters
        ----------
        at_once : bool
            Whether the stage is begun in a thread of its own, as other processes do its work, or
            when its result is asked for. It ends early where the block ends with an error.
        """
        if not at_once:
            yield Beside(lambda: self.attempt(name, run), lambda: True)
            return
        with ThreadPoolExecutor(1) as thread:
            future = thread.submit(run)

            def wait() -> T:
                result = future.result()
                if name in self.finished:
                    self.finished[name] = self.finished.pop(name)  # the same order at any time
                return result

            try:
                yield Beside(lambda: self.attempt(name, wait), future.done)
            except BaseException:
                self._ended = True
                raise

    @property
    def seconds(self) -> dict[str, float]:
        """What each stage took when it was computed."""
        return {name: stage.seconds for name, stage in self.finished.items()}

    @property
    def loaded(self) -> tuple[str, ...]:
        """Stages that did not need computing."""
        return tuple(name for name, stage in self.finished.items() if stage.loaded)

    def _report(self, name: str, done: int, total: int) -> None:
        """Tell how far a stage is, and end one whose result nobody waits for any more."""
        if self._ended:
            raise _EndedError
        if self.progress is not None:
            self.progress(name, done, total)

    def _load(self, name: str, key: str, files: Files[T]) -> Stage[T] | None:
        """Return what an earlier run finished, if it fits and can be read."""
        target, part = self.folder / name, self.folder / f"{name}.part"
        record = _fitting(target, key)
        if record is None:
            record = _fitting(part, key)
            if record is None:
                return None
            _rename(part, target)  # it was killed just before
        try:
            value = files.load(target)
        except Exception:  # of another form of this package, though of the same version
            return None  # whatever the reason: a stage that cannot be read is computed again
        return Stage(name, value, record["digest"], record["seconds"], True)

    def _compute(
        self,
        name: str,
        key: str,
        part: Path,
        compute: Callable[[Path, Progress | None], T],
        files: Files[T],
    ) -> dict[str, Any]:
        _prepare(part, key, self.fresh)
        begun = time.perf_counter()
        report = partial(self._report, name)
        report(0, 0)
        try:
            try:
                files.save(compute(part, report), part)
            except UnusableCheckpoint:  # what cannot be gone on from is not there
                _prepare(part, key, fresh=True)
                files.save(compute(part, report), part)
        except IdentificationError:
            remove(part)  # it would fail again: there is nothing to go on from
            raise
        record = {
            "key": key,
            "digest": folder_digest(part, _CACHE_FILES),
            "seconds": time.perf_counter() - begun,
            "versions": versions(),
        }
        write_text(part / _RECORD, json.dumps(record, indent=1) + "\n")
        return record


@contextmanager
def open_stages(
    folder: Path, progress: StageProgress | None = None, fresh: bool = False
) -> Iterator[Stages]:
    """Give the stages in `folder`, which no other process can use meanwhile.

    Parameters
    ----------
    folder : Path
        Is made, and taken away again where nothing came to be in it.
    progress : StageProgress, optional
        Told how far each stage is.
    fresh : bool
        Compute every stage again.

    Raises
    ------
    InvalidInput
        If the folder cannot be written to, or another process is using it.
    """
    with exclusive_folder(folder):
        yield Stages(folder, progress, fresh)


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that compute."""
    return {"python": platform.python_version()} | {p: version(p) for p in _PACKAGES}


def _key(name: str, inputs: Mapping[str, Any]) -> str:
    return json_digest({"stage": name, "package": version(PACKAGE), "inputs": inputs})


def _fitting(folder: Path, key: str) -> dict[str, Any] | None:
    """Return the record of a finished stage if it has that key and its files are as they were."""
    try:
        record = json.loads(_read_small(folder / _RECORD))
        fits = record["key"] == key and record["digest"] == folder_digest(folder, _CACHE_FILES)
        timed = type(record["seconds"]) is float and 0 <= record["seconds"] < math.inf
    except (OSError, InvalidInput, ValueError, RecursionError, KeyError, TypeError):
        return None
    return record if fits and timed else None


def _read_small(path: Path) -> str:
    """Return the text of a stage's file; a device, or a longer file, is none of them."""
    check_file(path, _MOST_BYTES)
    return path.read_text(encoding="utf-8")


def _prepare(part: Path, key: str, fresh: bool) -> None:
    """Make the folder of an unfinished stage; keep files of an interrupted run."""
    try:
        same = _read_small(part / _KEY) == key
    except (OSError, InvalidInput, ValueError):
        same = False
    if same and not fresh:
        return
    remove(part)
    part.mkdir()
    write_text(part / _KEY, key)


def _rename(part: Path, target: Path) -> None:
    """Replace an older stage by a finished one."""
    (part / _KEY).unlink(missing_ok=True)
    old = target.with_name(f"{target.name}.old")
    remove(old)
    if os.path.lexists(target):
        os.replace(target, old)
    os.replace(part, target)
    remove(old)
