"""A study step by step, each command going on from the last; studies side by side."""

import json
import re

import pytest
from command_line import oed
from conftest import STUDY, drawn, write_study

SMALL = STUDY.replace("steps: 400", "steps: 200").replace("count: 12", "count: 8")
SMALL = SMALL.replace("compare: {random: 1, runs: 12}", "compare: {runs: 0}\nprofiles: 0")


@pytest.fixture(scope="module")
def steps(tmp_path_factory):
    """Folder, and what each command said and left behind."""
    folder = tmp_path_factory.mktemp("steps")
    study, said = write_study(folder, SMALL), {}
    for command in ("design", "fit", "sample", "report"):
        with drawn():
            code, out, err = oed(command, study, "--workers", 1)
        assert (code, err) == (0, "")
        files = {p.name for p in (folder / "results" / "here").iterdir()} - {"stages"}
        said[command] = out, files
    return folder, said


def test_each_command_adds_its_file(steps):
    _, said = steps
    assert [sorted(files) for _, files in said.values()] == [
        ["design.html", "design.json"],
        ["design.html", "design.json", "fit.json"],
        ["design.html", "design.json", "fit.json", "uncertainty.json"],
        ["design.html", "design.json", "fit.json", "report.html", "uncertainty.json"],
    ]


def test_each_command_keeps_what_the_last_computed(steps):
    _, said = steps
    lines = [" ".join(out.split()) for out, _ in said.values()]
    kept = [re.search(r" reused (.*) \(inputs", line) for line in lines]
    assert kept[0] is None
    assert kept[1][1] == "candidates, information, design"
    assert kept[2][1].endswith("fit-lls, fit-nls, result")
    assert {"result", "uncertainty", "posterior"} <= set(kept[3][1].split(", "))


def test_summaries_say_what_there_is(steps):
    _, said = steps
    words = {name: out for name, (out, _) in said.items()}
    assert "certified gap" in words["design"]
    assert "NLS cost" not in words["design"]
    assert "NLS cost" in words["fit"]
    assert "R-hat" not in words["fit"]
    assert "5 visits, 10 runs, at least" in words["design"]
    assert "next     measure in position" in words["design"]
    std = r"d\d\.\w+ [\d.]+ %"
    assert re.search(rf"expected std best {std}, worst {std}", words["design"])
    assert "verdict" not in words["design"]
    for step in ("fit", "sample", "report"):
        assert "verdict  trustworthy: noise explains the residuals" in words[step]
        lines = re.findall(r"^ .* (d\d\.\w+) +\S.* to .* \(std [\d.]+ %\)$", words[step], re.M)
        assert sorted(lines) == ["d2.damping", "d2.stiffness", "d3.damping", "d3.stiffness"]
    assert "report.html" in words["report"]


def test_scripts_get_the_same_verdict_and_intervals(steps):
    folder, _ = steps
    study, results = folder / "study.yaml", folder / "results" / "here"
    design, fit, whole = (
        json.loads(oed(command, study, "--workers", 1, "--json")[1])
        for command in ("design", "fit", "sample")
    )
    written = {
        name: json.loads((results / f"{name}.json").read_text(encoding="utf-8"))
        for name in ("design", "fit", "uncertainty")
    }
    assert (design["experiments"], design["runs"]) == (5, 10)
    assert written["design"]["exact"]["runs"] == 10
    assert design["predicted"] == written["design"]["predicted"]
    assert all(0 < std < 0.1 for std in design["predicted"]["std"])
    assert "verdict" not in design
    for said, name in ((fit, "fit"), (whole, "uncertainty")):
        trust = written[name]["trust"]
        for key in ("verdict", "reason", "intervals"):
            assert said[key] == trust[key]
        assert said["verdict"] == "trustworthy"
        assert said["next_step"]["action"] == "none"
        assert said["robot_time"]["bound"]
    for one, predicted in zip(whole["intervals"], design["predicted"]["std"], strict=True):
        assert one["low"] < one["value"] < one["high"]
        assert one["std"] / one["value"] == pytest.approx(predicted, rel=0.1)


def test_fresh_keeps_nothing(steps):
    folder, _ = steps
    code, out, _ = oed("design", folder / "study.yaml", "--fresh", "--json", "--workers", 1)
    assert code == 0
    assert json.loads(out)["kept"] == []
    code, out, _ = oed("fit", folder / "study.yaml", "--json", "--workers", 1)
    document = json.loads(out)
    assert {"candidates", "information", "design"} <= set(document["kept"])
    assert {"fit-lls", "fit-nls"} <= set(document["seconds"])
    assert document["files"] == [str(folder / "results" / "here" / "fit.json")]


def test_studies_side_by_side(steps):
    folder, _ = steps
    other = folder / "more.yaml"
    text = SMALL.replace("experiments: 5", "experiments: 20").replace(
        "results/here", "results/more"
    )
    other.write_text(text, encoding="utf-8")
    page = folder / "both.html"
    code, out, err = oed("report", folder / "study.yaml", other, "-o", page, "--workers", 1)
    assert (code, err) == (0, "")
    name = folder.name  # of study.yaml
    assert re.search(rf"{name} +\d+ +5 +10 .* trustworthy", out)
    assert re.search(r"more +\d+ +20 +40 .* trustworthy", out)
    text = page.read_text(encoding="utf-8")
    assert "design.experiments" in text
    assert f"more / {name}" in text
    assert "noise.relative" not in text  # the same in both
    ratios = re.findall(r'data-v="([\d.]+)"[^>]*>[^<]*</td></tr>', text[text.index("std-table") :])
    assert ratios
    assert all(0.3 < float(ratio) < 0.8 for ratio in ratios[:4])  # four times the experiments


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("study.yaml", "study.yaml"), "given twice"),
        (("study.yaml", "-o", "x.html"), "--output"),
        (("study.yaml", "none.yaml"), "none.yaml"),
    ],
)
def test_mistakes_with_report(steps, monkeypatch, words, said):
    monkeypatch.chdir(steps[0])
    code, out, err = oed("report", *words)
    assert (code, out) == (2, "")
    assert len(err.splitlines()) == 1
    assert said in err
