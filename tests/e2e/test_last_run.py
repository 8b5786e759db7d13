"""`oed run` of a study of which nothing has changed says what it said, and computes nothing."""

import json
import logging
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from command_line import oed
from conftest import drawn, write_study

from oed.study import last_run, sources
from oed.study.last_run import LastRun
from reports.commands.run import last_run as last_run_of
from reports.commands.studies import compile_ahead

NUMERICS = ("scipy", "pinocchio", "numba", "matplotlib", "emcee", "oed.study.pipeline")


@pytest.fixture(scope="module")
def first(small_study, tmp_path_factory):
    """File of a study that was run once more after all of its stages, and what that said."""
    folder = tmp_path_factory.mktemp("last") / "run"
    shutil.copytree(small_study[0], folder / "results" / "here")
    path = write_study(folder)
    with drawn():
        code, out, err = oed("run", path, "--workers", 1)
    assert (code, err) == (0, "")
    shutil.copytree(folder, folder.with_name("backup"))
    return path, out


@pytest.fixture
def finished(first):
    """The same, with all files as they were."""
    folder = first[0].parent
    shutil.rmtree(folder)
    shutil.copytree(folder.with_name("backup"), folder)
    return first


def test_it_says_the_same_and_loads_no_numerics(finished):
    path, out = finished
    report = path.parent / "results" / "here" / "report.html"
    before = report.stat().st_mtime_ns
    program = (
        f"import sys; sys.argv = ['oed', 'run', {str(path)!r}]\n"
        "from reports import application\n"
        "try:\n    application.run()\n"
        f"finally:\n    print([name for name in {NUMERICS} if name in sys.modules])"
    )
    again = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (again.stdout, again.stderr) == (f"{out}[]\n", "")
    document = json.loads(oed("run", path, "--json")[1])
    assert set(document["kept"]) == set(document["seconds"])
    assert report.stat().st_mtime_ns == before


def _edit(path: Path) -> None:
    path.write_text(path.read_text() + "\n# edited\n")


def _forge(path: Path) -> None:
    path.write_text(path.read_text().replace("NLS cost", "NLS lost"))


HERE = "results/here"
CHANGES = {
    "study": ("study.yaml", _edit),
    "robot file": ("robot.yaml", _edit),
    "page": (f"{HERE}/report.html", _edit),
    "page away": (f"{HERE}/report.html", Path.unlink),
    "numbers": (f"{HERE}/fit.json", _edit),
    "stage": (f"{HERE}/stages/data/stage.json", _edit),
    "stage away": (f"{HERE}/stages/data", shutil.rmtree),
    "record": (f"{HERE}/.last-run.json", _forge),
    "record no JSON": (f"{HERE}/.last-run.json", _edit),
}


@pytest.mark.parametrize(("name", "change"), CHANGES.values(), ids=CHANGES)
def test_a_changed_file_is_seen(finished, name, change):
    path, _ = finished
    assert last_run_of(path).recall() is not None
    change(path.parent / name)
    assert last_run_of(path).recall() is None


def test_other_code_versions_commands_and_folders_are_seen(finished, monkeypatch):
    path, _ = finished
    last = last_run_of(path)
    command, output = last.made_by["command"], last.output
    assert LastRun(f"{command} ", path, output).recall() is None
    shutil.copytree(output, path.parent / "copy")
    assert LastRun(command, path, path.parent / "copy").recall() is None
    monkeypatch.setattr(last_run, "versions", lambda: {"python": "3.10"})
    assert last_run_of(path).recall() is None
    monkeypatch.undo()
    monkeypatch.setattr(last_run, "_code_digest", lambda: "of an edited module")
    assert last_run_of(path).recall() is None


def test_a_file_that_changes_while_it_is_computed_is_not_remembered(finished):
    path, _ = finished
    _edit(path)
    later = time.time() + 600
    os.utime(path, (later, later))
    with drawn():
        assert oed("run", path, "--workers", 1)[0] == 0
    assert last_run_of(path).recall() is None


def test_warnings_are_said_again(finished, monkeypatch):
    path, _ = finished
    _edit(path)

    def warn(*_):
        logging.getLogger("oed.study").warning("few data")

    monkeypatch.setattr(sources, "warn_of_weak_combinations", warn)
    with drawn():
        told = [oed("run", path, "--workers", 1)[2] for _ in range(2)]
    assert told == 2 * ["warning: few data\n"]


def test_who_watches_is_told_of_compiling(monkeypatch, capsys):
    for compiled, terminal in ((False, True), (True, True), (False, False)):
        monkeypatch.setattr("robotmodels.kernel.is_compiled", lambda compiled=compiled: compiled)
        monkeypatch.setattr(sys.stderr, "isatty", lambda terminal=terminal: terminal)
        compile_ahead(None)
        err = capsys.readouterr().err
        assert ("compiling for this processor" in err) == (terminal and not compiled)
