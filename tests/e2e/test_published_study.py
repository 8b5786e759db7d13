"""The published study in small: two joints that harden, six estimators, judged on a page."""

import json
import re

import numpy as np
import pytest
from conftest import ROBOT, STUDY, drawn, oed, write_study

import estimators
import robotmodels
from oed.replication.paper import CONCLUSIONS
from oed.study.settings.study_file import ESTIMATORS
from oed.study.stages.data import Data
from robotmodels.common.dataclass_files import read_dataclass

MODEL = ROBOT + "  - {name: b3x, joint: elbow_joint, axis: x, stiffness: 5.0e4, damping: 50}\n"
PLANT = MODEL.replace("stiffness: 4.0e4", "stiffness: {low: 3.4e4, high: 5.0e4, torque: 300}")
FITS = """\
fit:
  decades: 0.5
  starts: 2
  estimators:
    - {name: LLSM15U, residual: lls_magnitude, weights: user}
    - {name: LLS15U, residual: lls, weights: user}
    - {name: LLS15O, residual: lls, weights: optimal}
    - {name: NLS15U, residual: nls, weights: user}
    - {name: NLS15O, residual: nls, weights: optimal}
    - {name: LLS1U, residual: lls, weights: user, positions: best}
  result: LLS15U
compare_with: wernholt_moberg_2008
truth: plant.yaml
"""
FIT = re.search(r"^fit: .*\n", STUDY, re.M)[0]
COMPARE = re.search(r"^compare: .*\n", STUDY, re.M)[0]
PUBLISHED = (
    STUDY.replace(FIT, FITS)
    .replace(COMPARE, "compare: {runs: 0}\nprofiles: 0\n")
    .replace("steps: 400", "steps: 100")
)


DRAWN = ("3", "7b", "8", "9")
"""Figures that are drawn, one of each kind; the page has places for all."""


@pytest.fixture(scope="module")
def published(tmp_path_factory):
    """Folder of the study."""
    folder = tmp_path_factory.mktemp("published")
    path = write_study(folder, PUBLISHED, MODEL)
    (folder / "plant.yaml").write_text(PLANT, encoding="utf-8")
    with drawn(f"figure-({'|'.join(DRAWN)})"):
        code, _, err = oed("run", path, "--workers", 1)
    assert (code, err) == (0, "")
    return folder


def test_costs_are_those_of_plain_numpy(published):
    output = published / "results" / "here"
    found = json.loads((output / "published.json").read_text())["estimators"]
    robot = robotmodels.load_robot(published / "robot.yaml")
    data = read_dataclass(output / "stages" / "data" / "result.h5", Data).estimate
    snr = np.abs(data.response) / np.sqrt(data.variance)
    user = np.where(np.eye(2, dtype=bool), 1.0, 0.1) * (snr >= np.sqrt(10))
    optimal = np.where(snr >= np.sqrt(10), snr**2, 0.0)
    costs = {}
    for name in ESTIMATORS:
        runs = estimators.read_fits(output / "stages" / f"fit-{name}" / "runs.h5", robot, data)
        assert len(runs) == 2
        pairs = []
        for run in runs:
            values = run.parameters.values
            G = robotmodels.frequency_response(robot, data.positions, data.omega, values)
            error = np.abs(np.log(data.response / G)) ** 2
            pairs.append([(user * error).sum(), (optimal * error).sum()])
        costs[name] = np.array(sorted(pairs))
    reference, least = costs["LLS15U"][0, 0], costs["LLS15O"][:, 1].min()
    for name in ESTIMATORS:
        np.testing.assert_allclose(found[name]["cost"], costs[name][:, 0] / reference, rtol=1e-6)
        np.testing.assert_allclose(found[name]["optimal_cost"], costs[name][:, 1] / least, 1e-6)
        share = np.mean(costs[name][:, 0] / reference < 1.5)
        assert found[name]["reasonable"]["cost"] == pytest.approx(share)
        assert sorted(found[name]["start"]) == list(range(2))


def test_the_result_is_the_estimator_that_the_study_names(published):
    output = published / "results" / "here"
    fit = json.loads((output / "fit.json").read_text())
    best = fit["estimators"]["LLS15U"]
    assert [row["estimate"] for row in fit["parameters"]] == best["estimate"]
    assert (best["residual"], best["weights"], fit["cost"]) == ("lls", "user", best["cost"])
    truth = {row["name"]: row["truth"] for row in fit["parameters"]}
    assert truth["d2.stiffness"] is None  # it hardens: no single number
    assert truth["d3.stiffness"] == 2.5e4
    assert fit["estimators"]["LLS1U"]["positions"] == 1


def test_the_page_judges_seven_conclusions_and_shows_every_figure(published):
    output = published / "results" / "here"
    page = (output / "published.html").read_text(encoding="utf-8")
    judged = json.loads((output / "published.json").read_text())["conclusions"]
    assert [one["conclusion"] for one in judged] == list(CONCLUSIONS)
    for one in judged:
        assert one["verdict"] in ("supported", "not supported", "undecided")
        assert one["conclusion"][1:] in page
        assert f"<strong>{one['verdict']}</strong>" in page
    for number in ("3", "4", "5", "6", "7a", "7b", "8", "9"):
        picture = page.partition(f'id="figure-{number}"')[2].partition("</figure>")[0]
        assert ("<path" in picture) == (number in DRAWN)
    text = re.sub(r"<(script|style|svg).*?</\1>", "", page, flags=re.S)
    assert not re.search(r"\bnan\b", text)
    assert "http" not in text
    assert "report.html" in {p.name for p in output.iterdir()}


def test_a_comparison_without_all_six_estimators_is_refused(tmp_path):
    study = PUBLISHED.replace(
        "    - {name: LLS1U, residual: lls, weights: user, positions: best}\n", ""
    )
    code, _, err = oed("run", write_study(tmp_path, study, MODEL))
    assert code == 2
    assert "study.yaml: compare_with" in err
    assert "LLS1U missing in fit.estimators" in err


def test_an_estimator_name_twice_is_refused(tmp_path):
    study = PUBLISHED.replace("name: LLS15O", "name: LLS15U")
    code, _, err = oed("run", write_study(tmp_path, study, MODEL))
    assert code == 2
    assert "fit: estimators: the name 'LLS15U' is used twice" in err


def test_the_study_is_put_beside_the_paper_again_without_computing(published):
    output = published / "results" / "here"
    before = json.loads((output / "published.json").read_text())
    (output / "published.json").unlink()
    code, _, err = oed("replicate", published / "study.yaml", "--workers", 1)
    assert (code, err) == (0, "")
    assert json.loads((output / "published.json").read_text()) == before


def test_a_study_without_a_published_one_is_not_put_beside_it(tmp_path):
    code, _, err = oed("replicate", write_study(tmp_path, STUDY, MODEL))
    assert code == 2
    assert "study.yaml: compare_with: missing" in err
