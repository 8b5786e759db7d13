"""Progress where the output is piped: a line for each stage that is computed."""

import io
import re
import sys

import pytest
import yaml
from robots import HERE

from reports import cli
from reports.summaries import progress

LINE = r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d  "


def test_a_line_for_each_stage_that_is_computed():
    stream = io.StringIO()
    report = progress.stage_lines(stream)
    for call in (
        ("design", 0, 0),
        ("design", 1, 2),
        ("design", 2, 2),
        ("fit", 1, 1),
        ("page", 1, 3),
    ):
        report(*call)
    assert re.fullmatch(f"{LINE}design\n{LINE}page\n", stream.getvalue())


@pytest.mark.parametrize(
    ("words", "tells"),
    [
        (["init", "ur10"], True),
        (["init", "ur10", "--quiet"], False),
        (["--quiet", "init", "ur10"], False),
    ],
)
def test_quiet_before_or_after_the_command_silences_it(words, tells, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["oed", *words])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert not ended.value.code
    out, err = capsys.readouterr()
    assert "written" in out
    assert bool(re.search(f"^{LINE}collisions$", err, re.M)) == tells


def test_every_command_has_the_option(monkeypatch, capsys):
    for words in (["frf"], ["campaign", "ask"], ["schema"]):
        monkeypatch.setattr(sys, "argv", ["oed", *words, "--help"])
        with pytest.raises(SystemExit):
            cli.main()
        assert "--quiet" in capsys.readouterr().out


def test_predictions_tell_that_they_are_computed(tmp_path, monkeypatch, capsys):
    content = yaml.safe_load((HERE / "two_joints.yaml").read_text())
    content["guessed"] = {"d2.stiffness": 0.2, "d3.stiffness": 0.1}
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(content))
    monkeypatch.chdir(tmp_path)
    for quiet in ([], ["--quiet"]):
        monkeypatch.setattr(sys, "argv", ["oed", "predict", "robot.yaml", "--map", "3", *quiet])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        assert not ended.value.code
        _, err = capsys.readouterr()
        assert bool(re.fullmatch(f"{LINE}predictions\n", err)) != bool(quiet)
