"""Processes that are killed right before a chosen change to a folder: no moment is left to luck.

What is on disk changes by operations on files only, so a kill before an operation stands for all
moments since the one before it.
"""

import importlib
import os
import shutil
import signal
import subprocess
import sys
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path

CHANGES = {"open", "os.mkdir", "os.rename", "os.remove", "os.rmdir", "shutil.rmtree"}
WRITING = os.O_WRONLY | os.O_RDWR


def killed_again_and_again(
    work: Callable[..., object],
    words: Sequence[str],
    folder: Path,
    changes: Sequence[int],
    libraries: Sequence[str] = (),
) -> list[str]:
    """Run `work(*words)` once per entry of `changes`, each killed before that change to `folder`.

    `work` is a function of a test module that prints nothing. One process loads that and the
    libraries that `work` would load, and forks the others. Returned are the paths that each change
    was about.
    """
    found = sys.modules[work.__module__]
    path = [str(Path(found.__file__).parent), *filter(None, sys.path)]
    program = (
        f"import killed; killed._run({work.__module__!r}, {work.__qualname__!r}, {list(words)!r},"
        f" {str(folder)!r}, {list(changes)!r}, {list(libraries)!r})"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def killed_at_moments(
    work: Callable[..., object],
    words: Sequence[str],
    folder: Path,
    libraries: Sequence[str] = (),
) -> list[Path]:
    """Run `work(*words)` killed before each change to `folder`, then to its end.

    Each time it begins with the folder as it is now. Returned are copies of the folder at the ends.
    """
    ends, before = [], folder.with_name(f"before-{work.__name__}")
    shutil.copytree(folder, before)
    for change in range(1, 1000):
        shutil.rmtree(folder)
        shutil.copytree(before, folder)
        try:
            killed_again_and_again(work, words, folder, [change], libraries)
        except AssertionError as error:
            if "it came to its end" not in str(error):
                raise
            return ends
        work(*words)
        ends.append(folder.with_name(f"{work.__name__}-{change}"))
        shutil.copytree(folder, ends[-1])
    raise AssertionError("it has no end")


def _run(
    module: str,
    name: str,
    words: list[str],
    folder: str,
    changes: list[int],
    libraries: list[str],
) -> None:
    for library in libraries:
        importlib.import_module(library)
    work = getattr(importlib.import_module(module), name)
    for change in changes:
        child = os.fork()
        if child == 0:
            die_before(change, folder)
            try:
                work(*words)
            except BaseException:
                traceback.print_exc()
            os._exit(1)
        _, status = os.waitpid(child, 0)
        if not (os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGKILL):
            sys.exit(f"it came to its end before change {change}")


def die_before(change: int, folder: str) -> None:
    left = change

    def watch(event: str, arguments: tuple) -> None:
        nonlocal left
        if event not in CHANGES or not str(arguments[0]).startswith(folder):
            return
        if event == "open" and not arguments[2] & WRITING:
            return
        left -= 1
        if left == 0:
            os.write(1, f"{arguments[0]}\n".encode())
            os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(watch)
