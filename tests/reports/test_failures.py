"""What ends a command that is not its user's mistake, and what names the file at fault."""

import errno
import resource
from concurrent.futures import CancelledError
from pathlib import Path
from types import SimpleNamespace

import pytest
from command_line import oed

from reports import application, cli
from reports.commands.options import about
from reports.commands.workers import cluster
from robotmodels.common.atomic_files import write_text
from robotmodels.common.errors import IdentificationError, InvalidInput, NotIdentifiable
from robotmodels.common.file_paths import disk_full, reason


@pytest.fixture
def ends(monkeypatch, capsys):
    def run(error):
        def app(**_):
            raise error

        monkeypatch.setattr(application, "app", app)
        with pytest.raises(SystemExit) as ended:
            cli.main()
        out, err = capsys.readouterr()
        assert out == ""
        assert len(err.splitlines()) == 1
        return ended.value.code, err

    return run


def caused(error, by):
    error.__cause__ = by
    return error


HDF5 = (
    "Can't decrement id ref count (unable to extend file properly, errno = 28, "
    "error message = 'No space left on device')"
)


@pytest.mark.parametrize(
    "error",
    [
        OSError(errno.ENOSPC, "No space left on device"),
        RuntimeError(HDF5),
        caused(InvalidInput("chains.h5 cannot be written"), by=OSError(HDF5)),
    ],
)
def test_a_full_disk_is_one_line(ends, error):
    assert ends(error) == (
        1,
        "error: the disk is full; free some space and run the same command again\n",
    )


def test_a_file_that_may_not_be_read_is_named(ends):
    code, err = ends(PermissionError(errno.EACCES, "Permission denied", "out/x.h5"))
    assert (code, err) == (1, "error: out/x.h5: Permission denied\n")


def test_a_file_that_cannot_be_written_is_named(ends, tmp_path):
    """An error of a write, unlike that of opening a file, names none itself."""
    path = tmp_path / "page.html"
    path.write_text("old", encoding="utf-8")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, limits[1]))
    try:
        with pytest.raises(OSError, match="too large") as caught:
            write_text(path, "new" * 10_000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert ends(caught.value) == (1, f"error: {path}: File too large\n")
    assert [p.read_text(encoding="utf-8") for p in tmp_path.iterdir()] == ["old"]


def test_a_fault_of_the_program_keeps_its_traceback(monkeypatch):
    def app(**_):
        raise RuntimeError("a bug")

    monkeypatch.setattr(application, "app", app)
    with pytest.raises(RuntimeError, match="a bug"):
        cli.main()


def test_errors_name_the_file_once():
    study = Path("here/study.yaml")
    unnamed = NotIdentifiable(["k1"], "measure more")
    message = r"^here/study\.yaml: not identifiable: k1"
    with pytest.raises(IdentificationError, match=message), about(study):
        raise unnamed
    with pytest.raises(InvalidInput, match=r"^here/study\.yaml: unknown key"), about(study):
        raise InvalidInput("here/study.yaml: unknown key")


@pytest.mark.parametrize(
    ("name", "words"), [("", "it is a folder, a file is needed"), ("x", "No such file")]
)
def test_reasons_are_words(name, words, tmp_path):
    with pytest.raises(OSError, match="Errno") as caught:
        (tmp_path / name).read_text(encoding="utf-8")
    assert reason(caught.value).startswith(words)
    assert "Errno" not in reason(caught.value)


def test_hdf5_tells_of_a_full_disk_in_words():
    assert reason(OSError(HDF5)) == "No space left on device"
    assert not disk_full(OSError(errno.EACCES, "no"))
    assert not disk_full(None)


@pytest.mark.parametrize("command", ["check", "run", "simulate", "frf"])
def test_a_folder_is_no_file(command, tmp_path):
    folder = tmp_path / "robot.yaml"
    folder.mkdir()
    code, out, err = oed(command, folder)
    assert (code, out) == (2, "")
    assert str(folder) in err
    assert "Errno" not in err
    assert len(err.splitlines()) == 1


@pytest.mark.parametrize("gone", ["KilledWorker", "CancelledError"])
def test_a_cluster_that_dies_is_told_without_a_traceback(gone, monkeypatch):
    class KilledWorker(Exception):
        pass

    closed = []
    client = SimpleNamespace(get_executor=lambda retries: None, close=lambda: closed.append(gone))
    dask = SimpleNamespace(Client=lambda address, timeout: client, KilledWorker=KilledWorker)
    monkeypatch.setattr("reports.commands.workers.import_module", lambda name: dask)
    error = {"KilledWorker": KilledWorker, "CancelledError": CancelledError}[gone]
    told = pytest.raises(IdentificationError, match="--cluster tcp://x: its workers died")
    with told, cluster("tcp://x"):
        raise error
    assert closed == [gone]
