"""One process at a time uses a folder, and nothing that was made in vain is left."""

import fcntl
import os
import subprocess
import sys

import pytest

from robotmodels.common import atomic_files
from robotmodels.common.atomic_files import created_folder, exclusive_folder, remove, staged_folder
from robotmodels.common.errors import InvalidInput

LOOP = """
import os, sys
from pathlib import Path
from robotmodels.common.atomic_files import exclusive_folder
from robotmodels.common.atomic_files import staged_folder
from robotmodels.common.errors import InvalidInput

folder, mark = Path(sys.argv[1]), sys.argv[2]
held = 0
while held < 400:
    try:
        with exclusive_folder(folder):
            os.close(os.open(mark, os.O_CREAT | os.O_EXCL))  # fails if another is inside
            os.unlink(mark)
            held += 1
    except InvalidInput:
        pass
"""


def test_processes_in_a_loop_are_never_inside_together(tmp_path):
    words = [sys.executable, "-c", LOOP, str(tmp_path / "a" / "stages"), str(tmp_path / "mark")]
    runs = [subprocess.Popen(words, stderr=subprocess.PIPE, text=True) for _ in range(4)]
    for run in runs:
        _, err = run.communicate()
        assert run.returncode == 0, err
    assert not any(path.is_file() for path in tmp_path.rglob("*"))


def test_a_lock_whose_file_was_taken_away_does_not_count(tmp_path, monkeypatch):
    flock, others = fcntl.flock, []

    def late(descriptor, how):
        """Lock after another process has taken the file away, and a third has made a new one."""
        if not others:
            (tmp_path / ".lock").unlink()
            others.append(os.open(tmp_path / ".lock", os.O_RDWR | os.O_CREAT))
            flock(others[0], fcntl.LOCK_EX)
        flock(descriptor, how)

    monkeypatch.setattr(atomic_files.fcntl, "flock", late)
    with pytest.raises(InvalidInput, match="in use by another run"), exclusive_folder(tmp_path):
        pass
    (tmp_path / ".lock").unlink()
    os.close(others[0])
    with exclusive_folder(tmp_path):
        assert (tmp_path / ".lock").exists()


def test_a_folder_that_another_process_takes_away_is_made_again(tmp_path, monkeypatch):
    folder, opened = tmp_path / "stages", os.open

    def late(path, flags, *mode):
        monkeypatch.setattr(atomic_files.os, "open", opened)
        folder.rmdir()
        return opened(path, flags, *mode)

    monkeypatch.setattr(atomic_files.os, "open", late)
    with exclusive_folder(folder):
        assert folder.is_dir()
    assert not folder.exists()


@pytest.mark.parametrize("wrong", ["folder", "link", "dangling link"])
def test_a_lock_that_is_no_file_is_one_line(tmp_path, wrong):
    lock, target = tmp_path / ".lock", tmp_path / "target"
    if wrong == "folder":
        lock.mkdir()
    else:
        lock.symlink_to(target)
    if wrong == "link":
        target.write_text("another's")
    with pytest.raises(InvalidInput, match="cannot be written to"), exclusive_folder(tmp_path):
        pass
    assert (not target.exists()) or target.read_text() == "another's"


def test_only_what_was_made_in_vain_is_taken_away(tmp_path):
    with created_folder(tmp_path / "a" / "b"):
        (tmp_path / "a" / "x").write_text("")
    assert [p.name for p in (tmp_path / "a").iterdir()] == ["x"]
    with created_folder(tmp_path / "a"):
        (tmp_path / "a" / "x").unlink()
    assert (tmp_path / "a").exists()


def test_whatever_has_a_name_is_removed(tmp_path):
    target = tmp_path / "target"
    target.mkdir()
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "file").write_text("")
    (tmp_path / "file").write_text("")
    (tmp_path / "link").symlink_to(target)
    (tmp_path / "dangling").symlink_to(tmp_path / "nowhere")
    for name in ("folder", "file", "link", "dangling", "absent"):
        remove(tmp_path / name)
    assert [p.name for p in tmp_path.iterdir()] == ["target"]


def test_a_folder_in_the_place_of_a_result_is_named(tmp_path):
    (tmp_path / "design.json").mkdir()
    named = rf"{tmp_path}/design.json cannot be written to \(it is a folder, a file is needed\)"
    with pytest.raises(InvalidInput, match=named), staged_folder(tmp_path) as stage:
        (stage / "design.json").write_text("{}")
    assert [path.name for path in tmp_path.iterdir()] == ["design.json"]
