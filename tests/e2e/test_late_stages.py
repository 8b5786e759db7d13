"""What comes after the fit may fail: the report has the rest and says so."""

import json
import re
import shutil
from html import unescape

import pytest
from command_line import oed
from conftest import ROBOT, STUDY, drawn, write_study

from robotmodels.common.errors import NotIdentifiable

WHOLE = STUDY + "profiles: 1\nvalidation: {count: 2}\n"

DUMP = "minimum invalid:\n┌────┐\n│ no │\n└────┘"
FAILING = {
    "comparison": "oed.study.stages.comparison.compare_plans",
    "uncertainty": "oed.study.stages.uncertainty.covariance",
    "posterior": "oed.study.stages.posterior.sample_posterior",
    "profiles": "oed.study.stages.profiles.profile_likelihood",
    "importance": "oed.study.stages.cross_check.importance_sample",
    "cross-check": "oed.study.stages.cross_check.compare_methods",
    "validation": "oed.study.stages.validation.validate",
    "tool": "oed.study.stages.tool.predict_tool",
    "residuals": "oed.study.stages.residuals.standardised_residuals",
    "responses": "oed.study.stages.responses.log_frf_gradients",
    "section summary": "reports.sections.summary.filled",
    "section fit": "reports.sections.fit.run_table",
    "section provenance": "reports.sections.provenance.input_table",
}


def raising(error):
    def fail(*_, **__):
        raise error

    return fail


def words(page):
    return " ".join(unescape(re.sub(r"<[^>]*>", " ", page.read_text(encoding="utf-8"))).split())


@pytest.fixture(scope="module")
def whole(small_study, tmp_path_factory):
    """Return the folder of a study whose every late stage is computed."""
    folder = tmp_path_factory.mktemp("whole")
    shutil.copytree(small_study[0], folder / "results" / "here")
    with drawn():
        code, _, err = oed("run", write_study(folder, WHOLE), "--workers", 1)
    assert (code, err) == (0, "")
    return folder


def one_less(whole, folder, stage):
    """Return a study of which all is computed but a stage and what rests on it."""
    shutil.copytree(whole, folder, dirs_exist_ok=True)
    stages = folder / "results" / "here" / "stages"
    for name in {stage, "cross-check", *(["profiles", "validation"] * (stage == "uncertainty"))}:
        shutil.rmtree(stages / name, ignore_errors=True)
    (folder / "results" / "here" / "report.html").unlink()
    return folder / "study.yaml"


@pytest.mark.parametrize("stage", FAILING)
@pytest.mark.parametrize("mistake", [False, True], ids=["a fault", "a mistake"])
def test_a_late_stage_that_fails_costs_nothing_else(whole, tmp_path, monkeypatch, stage, mistake):
    path, results = one_less(whole, tmp_path, stage), tmp_path / "results" / "here"
    error = NotIdentifiable(["d2.damping"], "measure more") if mistake else RuntimeError(DUMP)
    with monkeypatch.context() as patch, drawn():
        patch.setattr(FAILING[stage], raising(error))
        code, out, err = oed("run", path, "--workers", 1)
    reason = (
        "not identifiable: d2.damping; measure more" if mistake else "RuntimeError: minimum inv"
    )
    assert code == (2 if mistake else 1)
    assert len(err.splitlines()) == 1
    assert f"{path}: " in err
    assert f"{stage}: {reason}" in err
    assert f"FAILED   {stage}" in out or stage.startswith("section")
    said = words(results / "report.html")
    assert "What failed" in said
    assert f"{stage} {reason[:1].upper()}{reason[1:]}" in said
    for heading in ("Parameters", "Residuals", "Design", "Weak directions"):
        assert f"{heading}</h2>" in (results / "report.html").read_text(encoding="utf-8")
    document = json.loads((results / "uncertainty.json").read_text(encoding="utf-8"))
    assert stage.startswith("section") or reason in document["failures"][stage]
    # Once its cause is gone, the same command goes on.
    with drawn():
        code, out, err = oed("run", path, "--workers", 1, "--json")
    assert (code, err) == (0, "")
    assert {"candidates", "information", "data", "fit-nls", "result"} <= set(
        json.loads(out)["kept"]
    )
    assert "What failed" not in words(results / "report.html")
    assert json.loads((results / "uncertainty.json").read_text())["failures"] == {}


def test_scripts_are_told_what_failed(whole, tmp_path, monkeypatch):
    path = one_less(whole, tmp_path, "profiles")
    monkeypatch.setattr(FAILING["profiles"], raising(RuntimeError(DUMP)))
    code, out, err = oed("sample", path, "--workers", 1, "--json")
    assert code == 1
    assert json.loads(out)["failures"] == {"profiles": f"RuntimeError: {' '.join(DUMP.split())}"}
    assert len(err.splitlines()) == 1


def test_an_interrupt_is_no_failure(whole, tmp_path, monkeypatch):
    path = one_less(whole, tmp_path, "profiles")
    monkeypatch.setattr(FAILING["profiles"], raising(KeyboardInterrupt()))
    code, out, err = oed("run", path, "--workers", 1)
    assert (code, out, err) == (130, "", "interrupted; run the same command again to continue\n")


BOUND = STUDY.replace("seed: 3", "seed: 3\ntruth: truth.yaml") + "profiles: 4\n"


def test_a_parameter_at_a_bound_is_a_finding(tmp_path):
    (tmp_path / "truth.yaml").write_text(ROBOT.replace("damping: 60", "damping: 0.006"))
    path, results = write_study(tmp_path, BOUND), tmp_path / "results" / "here"
    with drawn():
        code, out, err = oed("fit", path, "--workers", 1)
        assert (code, err) == (0, "")
        assert "AT A BOUND: d2.damping, the lower one" in out
        assert re.search(r"d2\.damping +< [\d.]+ \(not identifiable\)", out)
        code, out, err = oed("run", path, "--workers", 1, "--json")
    assert (code, err) == (0, "")
    assert json.loads(out)["at_bounds"] == {"d2.damping": "lower"}
    fitted = json.loads((results / "fit.json").read_text(encoding="utf-8"))["parameters"]
    assert {row["name"]: row["at_bound"] for row in fitted if row["at_bound"]} == {
        "d2.damping": "lower"
    }
    said = words(results / "report.html")
    assert "stopped at the lower bound of d2.damping" in said
    assert "What failed" not in said
    # Its numbers are struck out, its upper end is plain, and so are those of the others.
    rows = dict(rows_of(results / "report.html", "estimates"))
    assert rows["d2.damping"].count("<s ") == 5
    assert re.search(r'>–</td><td class="n" data-v="[\d.e-]+">[\d.]+</td>', rows["d2.damping"])
    assert "<s " not in rows["d2.stiffness"]


def rows_of(page, table):
    """Return name and HTML of each row of a table."""
    text = page.read_text(encoding="utf-8")
    text = text[text.index(f'id="{table}"') :]
    text = text[: text.index("</table>")]
    return re.findall(r"<tr><th scope=row><code>(.*?)</code></th>(.*?)</tr>", text)


WRONG = STUDY.replace("seed: 3", "seed: 3\ntruth: truth.yaml").replace("runs: 12", "runs: 0")


def test_numbers_of_a_wrong_model_are_struck_out(tmp_path):
    (tmp_path / "truth.yaml").write_text(ROBOT.replace("inertia: 2.0e-4", "inertia: 2.2e-4"))
    path, results = write_study(tmp_path, WRONG), tmp_path / "results" / "here"
    with drawn():
        code, out, err = oed("run", path, "--workers", 1)
    assert (code, err) == (0, "")
    assert "verdict  model error: m3.inertia" in out
    assert "no interval to quote" in out
    said = words(results / "report.html")
    assert "Model error: do not quote these numbers m3.inertia" in said
    assert "Quote no standard deviation of this study." in said
    assert "smallest rel. std" not in said
    rows = rows_of(results / "report.html", "estimates")
    assert len(rows) == 4
    assert all(row.count("<s ") == 5 for _, row in rows)
    trust = json.loads((results / "uncertainty.json").read_text(encoding="utf-8"))["trust"]
    assert trust["verdict"] == "model error"
    assert all(one["low"] is one["high"] is None for one in trust["intervals"])
    named = min(trust["directions"], key=lambda one: one["probability"])
    assert named["name"] == "m3.inertia"
    assert named["estimate"] == pytest.approx(0.1, abs=0.02)
