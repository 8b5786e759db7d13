"""Stages are computed once, recomputed where something changed, and survive kills."""

import itertools
import json
import os
import threading
from pathlib import Path

import numpy as np
import pytest
from killed import killed_again_and_again

from oed.study.stage_cache import Files, open_stages
from robotmodels.common.atomic_files import remove
from robotmodels.common.checkpoint_file import CheckpointFile
from robotmodels.common.errors import InvalidInput

ARRAY = Files(
    lambda value, folder: np.save(folder / "result.npy", value, allow_pickle=False),
    lambda folder: np.load(folder / "result.npy", allow_pickle=False),
)


class Chain:
    """Three stages: a -> b -> c, which adds up; counts what it computes."""

    def __init__(self, folder, **settings):
        self.folder = folder
        self.settings = {"a": 1.0, "b": 2.0, "c": 3.0} | settings
        self.computed = []

    def run(self, fresh=False):
        self.computed.clear()
        with open_stages(self.folder, fresh=fresh) as stages:
            before = None
            for name, value in self.settings.items():
                below = 0.0 if before is None else before.value
                inputs = {"setting": value, "below": before and before.digest}
                before = stages.run(name, inputs, self.computing(name, value + below), ARRAY)
            self.loaded = stages.loaded
        return float(before.value[0])

    def computing(self, name, value):
        def compute(folder, report):
            self.computed.append(name)
            return np.array([value]).ravel()

        return compute


def test_a_second_run_computes_nothing(tmp_path):
    chain = Chain(tmp_path / "stages")
    assert chain.run() == 6.0
    assert chain.computed == ["a", "b", "c"]
    assert chain.loaded == ()
    assert chain.run() == 6.0
    assert chain.computed == []
    assert chain.loaded == ("a", "b", "c")
    assert {p.name for p in (tmp_path / "stages").iterdir()} == {"a", "b", "c"}


def test_a_changed_setting_recomputes_what_rests_on_it(tmp_path):
    Chain(tmp_path).run()
    later = Chain(tmp_path, b=5.0)
    assert later.run() == 9.0
    assert later.computed == ["b", "c"]
    back = Chain(tmp_path, b=5.0, c=1.0)
    assert back.run() == 7.0
    assert back.computed == ["c"]


def test_the_same_result_of_another_setting_changes_nothing_below(tmp_path):
    Chain(tmp_path, a=0.0, b=-0.0).run()
    again = Chain(tmp_path, a=0, b=-0.0)
    again.run()
    assert again.computed == ["a"]


def test_another_version_of_the_package_recomputes_all(tmp_path, monkeypatch):
    chain = Chain(tmp_path)
    chain.run()
    monkeypatch.setattr("oed.study.stage_cache.version", lambda package: "9.9")
    chain.run()
    assert chain.computed == ["a", "b", "c"]


def test_fresh_recomputes_all(tmp_path):
    chain = Chain(tmp_path)
    chain.run()
    chain.run(fresh=True)
    assert chain.computed == ["a", "b", "c"]


def test_a_stage_whose_files_were_changed_is_computed_again(tmp_path):
    chain = Chain(tmp_path)
    chain.run()
    np.save(tmp_path / "b" / "result.npy", np.array([99.0]))
    assert chain.run() == 6.0
    assert chain.computed == ["b"]
    (tmp_path / "c" / "stage.json").write_text("{")
    chain.run()
    assert chain.computed == ["c"]


def without(key):
    return lambda record: {name: value for name, value in record.items() if name != key}


SPOILED = {
    "no seconds": without("seconds"),
    "no digest": without("digest"),
    "seconds in words": lambda record: record | {"seconds": "3"},
    "seconds that are none": lambda record: record | {"seconds": float("nan")},
    "seconds that are true": lambda record: record | {"seconds": True},
    "a list": lambda record: [record],
}


@pytest.mark.parametrize("spoiled", SPOILED.values(), ids=SPOILED)
def test_a_stage_without_its_record_is_computed_again(tmp_path, spoiled):
    chain = Chain(tmp_path)
    chain.run()
    record = tmp_path / "b" / "stage.json"
    record.write_text(json.dumps(spoiled(json.loads(record.read_text()))))
    for computed in (["b"], []):
        assert chain.run() == 6.0
        assert chain.computed == computed


@pytest.mark.parametrize("text", ["", "[" * 100_000, "\0", "9" * 5000, '{"key":' * 50_000])
def test_a_record_that_is_no_json_is_that_of_no_stage(tmp_path, text):
    chain = Chain(tmp_path)
    chain.run()
    (tmp_path / "b" / "stage.json").write_text(text)
    assert chain.run() == 6.0
    assert chain.computed == ["b"]


@pytest.mark.parametrize("kind", ["device", "pipe", "huge"])
@pytest.mark.parametrize("name", ["b/stage.json", "b.part/key"])
def test_a_device_is_no_record(tmp_path, name, kind):
    chain = Chain(tmp_path)
    chain.run()
    if name == "b.part/key":
        (tmp_path / "b").rename(tmp_path / "b.part")
        (tmp_path / "b.part" / "stage.json").unlink()
    record = tmp_path / name
    record.unlink(missing_ok=True)
    if kind == "device":
        record.symlink_to("/dev/zero")
    elif kind == "pipe":
        os.mkfifo(record)
    else:
        with record.open("wb") as file:
            file.truncate(2**40)
    assert chain.run() == 6.0
    assert chain.computed == ["b"]


@pytest.mark.parametrize("name", ["b", "b.part", "b.old"])
@pytest.mark.parametrize("wrong", ["file", "dangling link", "link to a file", "link to itself"])
def test_what_has_the_name_of_a_stage_and_is_none_gives_way(tmp_path, name, wrong):
    chain = Chain(tmp_path / "stages")
    chain.run()
    remove(tmp_path / "stages" / "b")
    place, target = tmp_path / "stages" / name, tmp_path / "target"
    if wrong == "file":
        place.write_text("no stage")
    else:
        place.symlink_to(place if "itself" in wrong else target)
    if wrong == "link to a file":
        target.write_text("another's")
    assert chain.run() == 6.0
    assert chain.computed == ["b"]
    assert chain.run() == 6.0
    assert chain.computed == []
    assert not target.exists() or target.read_text() == "another's"


@pytest.mark.parametrize("wrong", ["bit", "empty", "cut", "of other work"])
def test_an_unfinished_stage_goes_on_from_undamaged_files_only(tmp_path, wrong):
    def compute(folder, report):
        kept = CheckpointFile(folder / "half.h5", "this work", "numbers", "other work")
        if kept.path.exists():
            with kept.reading() as file:
                return 2 * file["half"][:]
        with kept.writing() as file:
            file["half"] = np.array([1.5])
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), open_stages(tmp_path) as stages:
        stages.run("a", {}, compute, ARRAY)
    path = tmp_path / "a.part" / "half.h5"
    content = bytearray(path.read_bytes())
    if wrong == "bit":
        content[-3] ^= 4
    path.write_bytes({"empty": b"", "cut": content[:-1]}.get(wrong, content))
    if wrong == "of other work":
        with CheckpointFile(path, "other", "numbers", "").writing() as file:
            file["half"] = np.array([7.0])
    # What is damaged is not there: it begins anew, and is interrupted as before.
    with pytest.raises(KeyboardInterrupt), open_stages(tmp_path) as stages:
        stages.run("a", {}, compute, ARRAY)
    with open_stages(tmp_path) as stages:
        assert stages.run("a", {}, compute, ARRAY).value == [3.0]


def test_a_stage_that_cannot_be_read_is_computed_again(tmp_path):
    def unreadable(folder):
        raise InvalidInput("of another form")

    def compute(folder, report):
        computed.append(1)
        return np.zeros(1)

    computed = []
    with open_stages(tmp_path) as stages:
        stages.run("a", {}, compute, ARRAY)
    with open_stages(tmp_path) as stages, pytest.raises(InvalidInput):
        stages.run("a", {}, compute, Files(ARRAY.save, unreadable))
    assert computed == [1, 1]


def test_a_mistake_leaves_no_trace_of_its_stage(tmp_path):
    def wrong(folder, report):
        (folder / "half").write_text("x")
        raise InvalidInput("no")

    with pytest.raises(InvalidInput, match="no"), open_stages(tmp_path / "new" / "s") as stages:
        stages.run("a", {}, wrong, ARRAY)
    assert list(tmp_path.iterdir()) == []


def test_what_an_interrupted_stage_left_is_given_to_the_next_run(tmp_path):
    def interrupted(folder, report):
        (folder / "so far").write_text("half")
        raise KeyboardInterrupt

    def goes_on(folder, report):
        return np.array([len((folder / "so far").read_text())], dtype=float)

    with pytest.raises(KeyboardInterrupt), open_stages(tmp_path) as stages:
        stages.run("a", {"n": 1}, interrupted, ARRAY)
    with open_stages(tmp_path) as stages:
        assert stages.run("a", {"n": 1}, goes_on, ARRAY).value == [4.0]
    with pytest.raises(KeyboardInterrupt), open_stages(tmp_path) as stages:
        stages.run("a", {"n": 2}, interrupted, ARRAY)
    # Of other settings, nothing is taken over.
    with pytest.raises(FileNotFoundError), open_stages(tmp_path) as stages:
        stages.run("a", {"n": 3}, goes_on, ARRAY)


def test_two_runs_do_not_share_a_folder(tmp_path):
    with (
        open_stages(tmp_path),
        pytest.raises(InvalidInput, match="in use by another run"),
        open_stages(tmp_path),
    ):
        pass


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(InvalidInput, match=r"file.*cannot be written to"),
        open_stages(tmp_path / "file" / "stages"),
    ):
        pass


NUMBER = Files(
    lambda value, folder: (folder / "sum").write_text(repr(value)),
    lambda folder: float((folder / "sum").read_text()),
)


def four_stages(folder, log):
    """Four stages of ten steps, each step kept in a file as the stages of a study do."""

    def steps(name, before):
        def compute(folder, report):
            done = sorted(folder.glob("step_*"))
            for i in range(len(done), 10):
                # Noted when begun: a step that a kill cuts off is noted twice, none is noted never.
                with open(log, "a") as notes:
                    notes.write(name)
                part = folder / "writing"
                part.write_text(str(before + i))
                part.rename(folder / f"step_{i:02d}")
            return sum(float(p.read_text()) for p in folder.glob("step_*"))

        return compute

    with open_stages(Path(folder)) as stages:
        total, digest = 0.0, ""
        for name in "abcd":
            stage = stages.run(name, {"below": digest}, steps(name, total), NUMBER)
            total, digest = stage.value, stage.digest
    return total


def test_killed_again_and_again_it_ends_with_the_same_result(tmp_path):
    whole, killed, log = tmp_path / "whole", tmp_path / "killed", tmp_path / "log"
    # Each step is two changes; each run begins with one, that of the lock.
    changes = [2, 3, 4, 5, 7, 8, 11, 6, 9, 10, 3]
    killed_again_and_again(four_stages, [str(killed), str(log)], killed, changes)
    assert four_stages(killed, log) == four_stages(whole, tmp_path / "other log")
    digests = [
        {name: json.loads((folder / name / "stage.json").read_text())["digest"] for name in "abcd"}
        for folder in (whole, killed)
    ]
    assert digests[0] == digests[1]
    # Nothing was computed twice but the step that each kill cut off.
    assert 0 < len(log.read_text()) - 40 <= len(changes)


def test_a_stage_killed_before_its_last_renaming_is_found(tmp_path):
    chain = Chain(tmp_path)
    chain.run()
    (tmp_path / "b").rename(tmp_path / "b.part")
    assert chain.run() == 6.0
    assert chain.computed == []
    assert (tmp_path / "b" / "stage.json").exists()


def test_results_are_always_loaded_as_a_later_run_would(tmp_path):
    rounded = Files(
        save=lambda value, folder: (folder / "x").write_text(f"{value:.1f}"),
        load=lambda folder: float((folder / "x").read_text()),
    )
    for _ in range(2):
        with open_stages(tmp_path) as stages:
            assert stages.run("a", {}, lambda folder, report: 0.123, rounded).value == 0.1


def test_progress_names_the_stage(tmp_path):
    said = []

    def compute(folder, report):
        report(1, 2)
        return np.zeros(1)

    with open_stages(Path(tmp_path), lambda *words: said.append(words)) as stages:
        stages.run("a", {}, compute, ARRAY)
        stages.run("a", {}, compute, ARRAY)
    assert said == [("a", 0, 0), ("a", 1, 2), ("a", 1, 1), ("a", 1, 1)]


def test_a_stage_beside_others_comes_in_the_order_of_its_result(tmp_path):
    for at_once in (True, False):
        chain = Chain(tmp_path / f"stages {at_once}")
        begun = threading.Event()

        def compute(folder, report, begun=begun):
            begun.set()
            return np.array([4.0])

        with open_stages(chain.folder) as stages:
            with stages.beside(
                "beside", lambda: stages.run("beside", {}, compute, ARRAY), at_once
            ) as result:
                if at_once:
                    assert begun.wait(60)
                stages.run("a", {}, chain.computing("a", 1.0), ARRAY)
                assert begun.is_set() == at_once
                assert result.result().value == 4.0
            assert list(stages.seconds) == ["a", "beside"]


def test_a_stage_beside_others_fails_alone(tmp_path):
    def fails():
        raise InvalidInput("no such plan")

    with (
        open_stages(tmp_path / "stages") as stages,
        stages.beside("beside", fails, True) as result,
    ):
        assert result.result() is None
        assert [(one.name, one.reason) for one in stages.failures] == [("beside", "no such plan")]


def test_a_stage_beside_others_ends_with_their_error(tmp_path):
    begun, ended = threading.Event(), threading.Event()

    def endless(folder, report):
        try:
            for step in itertools.count():
                begun.set()
                report(step, 0)
        finally:
            ended.set()

    def failing(stages):
        with stages.beside("beside", lambda: stages.run("beside", {}, endless, ARRAY), True):
            assert begun.wait(60)
            raise InvalidInput("no data")

    with open_stages(tmp_path / "stages") as stages:
        with pytest.raises(InvalidInput, match="no data"):
            failing(stages)
        assert ended.is_set()
        assert not (tmp_path / "stages" / "beside").exists()
